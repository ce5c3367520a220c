"""`./dev capture`: print a sheet of tags, take photos out of a video, check a folder of photos, and more."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import yaml
from pydantic import ValidationError

from pipeline.records.captures import KnownLength, read_capture, read_intrinsics, read_scene, read_tags
from pipeline.records.errors import UserError, first_mistake
from pipeline.records.parameters import read_parameters
from pipeline.records.tag_layouts import TAG_FAMILIES, TagLayout
from pipeline.records.writing import check_writable, whole_file, whole_folder
from pipeline.stages.running import command

DOUBTFUL = 1  # exit code of `check` when it finds a problem
TEMPLATES = {
    "tags.yaml": """\
family: aruco_6x6_250   # as ./dev capture print-tags printed it
size: 0.024             # m, measured on the paper
board: {kind: grid, columns: 5, rows: 7, gap: 0.007}
""",
    "scene.yaml": """\
objects:
  apple:                      # one entry per object
    position: [0.0, 0.0]      # m, its middle on the sheet
    box: [0.09, 0.09, 0.09]   # m, a box around it
""",
}

KINDS = {  # family, convention and border that are printed unless the user says otherwise
    "tags": ("tag36h11", "opencv", 1),
    "grid": ("aruco_6x6_250", "opencv", 1),
    "charuco": ("aruco_5x5_1000", "opencv", 1),
    "aprilgrid": ("tag36h11", "apriltag", 2),
}


def _layout(chosen: argparse.Namespace) -> TagLayout:
    """Return the layout that the options describe.

    Raises:
        UserError: they contradict each other.
    """
    family, convention, border = KINDS[chosen.kind]
    size = chosen.size_mm if chosen.size_mm is not None else 60.0 if chosen.kind == "tags" else 24.0
    if not 5 <= size <= 200:
        raise UserError(f"--size-mm {size:g} is out of range; choose 5 to 200.")
    content: dict[str, object] = {
        "family": chosen.family or family,
        "size": size / 1000,
        "convention": convention,
        "border": border,
    }
    if chosen.kind == "tags":
        content["tags"] = "anywhere"
    else:
        gap = chosen.gap_mm / 1000 if chosen.gap_mm is not None else round(0.3 * size) / 1000
        length = {"square": size / 1000 + gap} if chosen.kind == "charuco" else {"gap": gap}
        content["board"] = {
            "kind": chosen.kind,
            "columns": chosen.columns,
            "rows": chosen.rows,
            "first": chosen.first,
            **length,
        }
    try:
        return TagLayout.model_validate(content)
    except ValidationError as error:
        raise UserError(f"such a sheet cannot be: {first_mistake(error, 'key')}.") from error


def print_tags(chosen: argparse.Namespace) -> None:
    """Write the PDF, say how to print it, and what to write into tags.yaml."""
    from pipeline.capture.sheet import board_sheet, tag_sheet

    layout = _layout(chosen)
    numbers = range(chosen.first, chosen.first + chosen.count)
    sheet = tag_sheet(numbers, layout, chosen.page) if layout.solved else board_sheet(layout, chosen.page)
    with whole_file(chosen.out) as temporary:
        temporary.write_bytes(sheet)
    what = f"tags {numbers[0]} to {numbers[-1]} of {layout.family}" if layout.solved else f"a {chosen.kind} board"
    print(f"{chosen.out}: {what}, {1000 * layout.size:g} mm; print at 100 % and check the ruler. For tags.yaml:")
    print(yaml.safe_dump(layout.model_dump(mode="json", exclude_none=True), sort_keys=False), end="")


def check(folder: Path, picture: Path) -> int:
    """Print the problems of a capture, draw it, and return the exit code."""
    capture = read_capture(folder)
    from pipeline.compute.progress import watched
    from pipeline.reconstruct.check_picture import Shown, check_picture, shown_best
    from pipeline.reconstruct.coverage import coverage_sentences, looks_at_all, posed_photos
    from pipeline.reconstruct.inspection import camera_sentences, cameras_told, sentences
    from pipeline.reconstruct.known_length import marks_as_worked_with
    from pipeline.reconstruct.normal_maps import normal_files
    from pipeline.reconstruct.photos import read_colours, read_photos, shrunk
    from pipeline.reconstruct.reconstruction import tags_in_photos

    check_writable(picture)
    photos = read_photos(capture, read_parameters().reconstruct.largest_side)
    if capture.intrinsics is not None:
        capture.intrinsics.check_sizes({photo.name: photo.file_size for photo in photos})
    normal_files(capture, photos)
    if isinstance(capture.tags, KnownLength):
        marks_as_worked_with(capture.tags, photos)
        found = sentences(capture, photos, {})
        for sentence in found:
            print(sentence)
        print(f"{folder}: {len(photos)} photos, a known length; {'see above' if found else 'no problems found'}.")
        print("No picture: without tags, only the reconstruction finds cameras.")
        return DOUBTFUL if found else 0
    seen = tags_in_photos(capture, capture.tags, list(watched(photos, len(photos), "looking for tags")))
    cameras, layout = cameras_told(photos, seen, capture.tags)
    doubts, told = camera_sentences(photos, cameras)
    posed = posed_photos(photos, cameras)
    looks = looks_at_all(capture.scene, posed)
    found = sentences(capture, photos, seen) + doubts + (coverage_sentences(looks) if posed else [])
    for sentence in found:
        print(sentence)
    tags = sum(len(its.tags) for its in seen.values())
    known = "tags" if capture.tags.solved else f"{len(capture.tags.numbers())} tags"
    if told:
        print(f"By the tags: {told}.")
    shown = Shown(capture.scene, layout, posed, seen, looks)
    name = shown_best([photo.name for photo in photos], posed, seen)
    times = next(photo.times for photo in photos if photo.name == name)
    colours = read_colours(next(path for path in capture.images if path.stem == name))
    drawn = check_picture(shown, name, np.asarray(shrunk(colours, times).round(), np.uint8))
    with whole_file(picture) as temporary:
        temporary.write_bytes(drawn)
    print(f"{picture}: cameras, tags and boxes, and from where each object is seen.")
    print(
        f"{folder}: {len(photos)} photos, {tags} sightings of {known}, "
        f"{len(capture.scene.objects)} objects; {'see above' if found else 'no problems found'}."
    )
    return DOUBTFUL if found else 0


def from_video(chosen: argparse.Namespace) -> None:
    """Write photos out of a video, and say what to do next."""
    images = chosen.out / "images"
    if images.exists() and not chosen.force and (not images.is_dir() or any(images.iterdir())):
        raise UserError(f"{images} exists; choose another --out, or add --force to replace these photos.")
    check_writable(images)
    from pipeline.compute.progress import watched
    from pipeline.reconstruct.video import check_survey, chosen_frames, survey, write_frames

    found = survey(chosen.video, lambda frames, total: watched(frames, total, "looking at frames"))
    check_survey(chosen.video, found, chosen.count)
    numbers = chosen_frames(found, chosen.count)
    with whole_folder(images) as temporary:
        write_frames(chosen.video, numbers, temporary)
    print(f"{images}: {len(numbers)} of {len(found.moved)} frames.")
    if len(numbers) < chosen.count:
        print(f"The camera moved too fast for {chosen.count} photos; film more slowly, or ask for fewer.")
    for name, text in TEMPLATES.items():
        if not (chosen.out / name).exists():
            print(f"Write {chosen.out / name}, such as:\n{text}", end="")
    print(f"Then run ./dev capture check {chosen.out}")


def from_depth(chosen: argparse.Namespace) -> None:
    """Write the points of every object of a scene that one depth picture shows."""
    if (chosen.photo is None) != (chosen.tags is None):
        raise UserError("--photo and --tags belong together; give both, or neither.")
    scene, intrinsics = read_scene(chosen.scene), read_intrinsics(chosen.intrinsics)
    layout = read_tags(chosen.tags) if chosen.tags else None
    there = next((name for name in scene.objects if (chosen.out / name).exists()), None)
    if there is not None and not chosen.force:
        raise UserError(f"{chosen.out / there} exists; choose another --out, or add --force to replace it.")
    check_writable(chosen.out / "points")
    from pipeline.reconstruct.depth import lifted, partial_clouds, pose_by_support, pose_by_tags, read_depth
    from pipeline.reconstruct.lens import Lens
    from pipeline.reconstruct.photos import read_grey
    from pipeline.records.partial_clouds import write_partial_cloud

    depth, lens = read_depth(chosen.depth), Lens.calibrated(intrinsics)
    grey = read_grey(chosen.photo) if layout else None
    intrinsics.check_sizes({str(chosen.depth): depth.shape[::-1]})
    points, settings = lifted(depth, lens), read_parameters()
    if layout is None or grey is None:
        T = pose_by_support(points, settings.seed)
    else:
        intrinsics.check_sizes({str(chosen.photo): grey.shape[::-1]})
        T = pose_by_tags(grey, layout, lens, depth)
    for name, cloud in partial_clouds(points, T, scene, settings.reconstruct.surface).items():
        write_partial_cloud(chosen.out / name, cloud.points, cloud.normals, cloud.T_scene_object)
        print(f"{chosen.out / name}/points.npy: {len(cloud.points)} points of {name}, as one camera sees it.")
    print("For grasps: ./dev sample --object0 FILE --object1 FILE, with two of these files.")


def normals(chosen: argparse.Namespace) -> None:
    """Write the normal maps of a capture's photos."""
    capture, folder = read_capture(chosen.folder), chosen.folder / "normals"
    if folder.is_dir() and any(folder.iterdir()) and not chosen.force:
        raise UserError(f"{folder} exists; add --force to replace what is there.")
    check_writable(folder)
    from pipeline.compute.progress import watched
    from pipeline.reconstruct.normal_network import convention, load_network, normals_of
    from pipeline.reconstruct.photos import read_colours

    network = load_network(chosen.model, convention(chosen.scale, chosen.axes))
    with whole_folder(folder) as temporary:
        for path in watched(capture.images, len(capture.images), "normals"):
            np.save(temporary / f"{path.stem}.npy", normals_of(network, read_colours(path), path.name))
    print(f"{folder}: normals of {len(capture.images)} photos; `reconstruct.method: 2dgs` uses them.")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="./dev capture", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    printing = commands.add_parser("print-tags", help="write a PDF of tags in true size, with a ruler")
    printing.add_argument("--kind", choices=list(KINDS), default="tags", help="single tags, or a board of them")
    printing.add_argument("--family", choices=list(TAG_FAMILIES), metavar="FAMILY", help="such as aruco_6x6_250")
    printing.add_argument("--out", type=Path, default=Path("tags.pdf"))
    printing.add_argument("--count", type=int, default=6, choices=range(1, 101), metavar="1..100")
    printing.add_argument("--first", type=int, default=0, help="number of the first tag")
    printing.add_argument("--size-mm", type=float, help="edge of the black square (60; 24 on a board)")
    printing.add_argument("--columns", type=int, default=5, help="of a board: tags, or squares of a chessboard")
    printing.add_argument("--rows", type=int, default=7, help="of a board")
    printing.add_argument("--gap-mm", type=float, help="between the black squares of a board")
    printing.add_argument("--page", choices=["a4", "letter"], default="a4")
    checking = commands.add_parser("check", help="report problems of a capture folder (exit code 1 if there are any)")
    checking.add_argument("folder", type=Path)
    checking.add_argument("--picture", type=Path, help="PNG to write (reports/captures/<name of the folder>.png)")
    filming = commands.add_parser("from-video", help="take sharp, evenly spread frames of a video as photos")
    filming.add_argument("video", type=Path)
    filming.add_argument(
        "--out", type=Path, required=True, help="folder of the capture; the photos go to images/ in it"
    )
    filming.add_argument("--count", type=int, default=40, choices=range(3, 501), metavar="3..500")
    filming.add_argument("--force", action="store_true", help="replace photos that are there")
    depths = commands.add_parser("from-depth", help="take the points of objects out of one depth picture")
    depths.add_argument("--depth", type=Path, required=True, help="PNG of 16 bits in mm, or .npy in m")
    depths.add_argument("--intrinsics", type=Path, required=True, help="its camera, an intrinsics.yaml")
    depths.add_argument("--scene", type=Path, required=True, help="where the objects are, a scene.yaml")
    depths.add_argument("--photo", type=Path, help="by the same camera, as large as the depth picture, with tags")
    depths.add_argument("--tags", type=Path, help="where they lie, a tags.yaml; without: the largest plane is z = 0")
    depths.add_argument("--out", type=Path, required=True, help="folder to write to, one folder per object")
    depths.add_argument("--force", action="store_true", help="replace objects that are there")
    mapping = commands.add_parser("normals", help="make the normal maps of a capture by an ONNX network")
    mapping.add_argument("folder", type=Path)
    mapping.add_argument("--model", type=Path, required=True, help="the network, an .onnx file")
    mapping.add_argument("--axes", default="right,down,forward", help="where the network's x, y and z point")
    mapping.add_argument("--scale", choices=["imagenet", "zero-one", "minus-one-one"], default="imagenet")
    mapping.add_argument("--force", action="store_true", help="replace normals that are there")
    return parser


@command("capture")
def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    chosen = _parser().parse_args(arguments)
    if chosen.command == "check":
        name = f"{chosen.folder.resolve().name}.png"
        return check(chosen.folder, chosen.picture or Path("reports/captures") / name)
    if chosen.command == "from-video":
        from_video(chosen)
    elif chosen.command == "from-depth":
        from_depth(chosen)
    elif chosen.command == "normals":
        normals(chosen)
    else:
        print_tags(chosen)
    return 0


if __name__ == "__main__":
    sys.exit(main())
