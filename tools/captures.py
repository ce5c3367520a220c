"""`./dev capture`: print a sheet of AprilTags, or check a folder of photos."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from pipeline.records.captures import read_capture
from pipeline.records.errors import UserError
from pipeline.records.parameters import read_parameters
from pipeline.records.writing import whole_file
from pipeline.stages.running import command

DOUBTFUL = 1  # exit code of `check` when it finds a problem


def print_tags(target: Path, count: int, first: int, size: float, page: str) -> None:
    """Write the PDF and say how to print it."""
    from pipeline.capture.sheet import tag_sheet

    sheet = tag_sheet(range(first, first + count), size, page)
    with whole_file(target) as temporary:
        temporary.write_bytes(sheet)
    print(
        f"{target}: tags {first} to {first + count - 1} of tag36h11, {1000 * size:g} mm; "
        "print at 100 % and check the ruler."
    )


def check(folder: Path) -> int:
    """Print the problems of a capture and return the exit code."""
    capture = read_capture(folder)
    from pipeline.compute.progress import watched
    from pipeline.reconstruct.inspection import sentences
    from pipeline.reconstruct.normal_maps import normal_files
    from pipeline.reconstruct.photos import read_photos
    from pipeline.reconstruct.tags import detect_tags

    photos = read_photos(capture, read_parameters().reconstruct.largest_side)
    if capture.intrinsics is not None:
        capture.intrinsics.check_sizes({photo.name: photo.file_size for photo in photos})
    normal_files(capture, photos)
    sightings = {
        photo.name: detect_tags(photo, capture.tags) for photo in watched(photos, len(photos), "looking for tags")
    }
    found = sentences(capture, photos, sightings)
    for sentence in found:
        print(sentence)
    tags = sum(len(seen) for seen in sightings.values())
    print(
        f"{folder}: {len(photos)} photos, {tags} sightings of {len(capture.tags.tags)} tags, "
        f"{len(capture.scene.objects)} objects; {'see above' if found else 'no problems found'}."
    )
    return DOUBTFUL if found else 0


@command("capture")
def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="./dev capture", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    printing = commands.add_parser("print-tags", help="write a PDF of AprilTags in true size, with a ruler")
    printing.add_argument("--out", type=Path, default=Path("tags.pdf"))
    printing.add_argument("--count", type=int, default=6, choices=range(1, 101), metavar="1..100")
    printing.add_argument("--first", type=int, default=0, help="number of the first tag")
    printing.add_argument("--size-mm", type=float, default=60.0, help="edge of the black square")
    printing.add_argument("--page", choices=["a4", "letter"], default="a4")
    checking = commands.add_parser("check", help="report problems of a capture folder (exit code 1 if there are any)")
    checking.add_argument("folder", type=Path)
    chosen = parser.parse_args(arguments)
    if chosen.command == "check":
        return check(chosen.folder)
    if not 5 <= chosen.size_mm <= 200:
        raise UserError(f"--size-mm {chosen.size_mm:g} is out of range; choose 5 to 200.")
    print_tags(chosen.out, chosen.count, chosen.first, chosen.size_mm / 1000, chosen.page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
