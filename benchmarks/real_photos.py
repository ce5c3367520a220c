"""Sets of real photos: cameras, tags and sizes against independent figures, as a table for docs/capture.md.

    python benchmarks/real_photos.py FOLDER [--only mango] [--cameras] [--largest-side 1600]

FOLDER holds one folder per set: a capture (images/, tags.yaml, scene.yaml, perhaps masks/), which is reconstructed with
its masks and without; photos of a grid of 36 tags (aprilgrid_phone); or single photos, each with a list of corners
(apriltag_single: one tag a line, number and four corners). Independent figures come from the notes of the sets: the
camera by the board alone with one focal length, a hull from hand-made masks, a plane sweep with those cameras.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from pipeline.reconstruct.cameras import find_cameras  # noqa: E402
from pipeline.reconstruct.detection import all_tags, seen_tags  # noqa: E402
from pipeline.reconstruct.photos import read_grey, read_photos  # noqa: E402
from pipeline.reconstruct.reconstruction import metrics_of, reconstruct, tags_in_photos  # noqa: E402
from pipeline.records.captures import Capture, read_capture, read_tags  # noqa: E402
from pipeline.records.errors import UserError  # noqa: E402
from pipeline.records.parameters import read_parameters  # noqa: E402
from pipeline.records.parameters.reconstruct import ReconstructParameters  # noqa: E402
from pipeline.records.tag_layouts import Board, TagLayout  # noqa: E402


@dataclass(frozen=True)
class Independent:
    """What is known of a set from elsewhere."""

    focal: float  # pixels at the working size that the photos come in
    extents: tuple[float | None, float | None, float]  # mm: two widths and the height


KNOWN = {
    "mango": Independent(1033.0, (96.0, 105.0, 84.0)),
    "apple_turntable": Independent(1019.0, (71.0, 83.0, 79.0)),
}
GRID = TagLayout(
    family="tag36h11",
    size=0.03,
    convention="apriltag",
    board=Board(kind="aprilgrid", columns=6, rows=6, gap=0.009),
)


def without_masks(capture: Capture, folder: Path) -> Capture:
    """Return the capture as it would be had nobody made masks."""
    for name in ("images", "tags.yaml", "scene.yaml"):
        (folder / name).symlink_to((capture.folder / name).resolve())
    return read_capture(folder)


def cameras_line(capture: Capture, settings: ReconstructParameters) -> str:
    """Return what the cameras of a capture are."""
    photos = read_photos(capture, settings.largest_side)
    layout = read_tags(capture.folder / "tags.yaml")
    seen = tags_in_photos(capture, layout, photos)
    found = find_cameras(photos, seen, layout, capture.scene, capture.intrinsics, settings, 1)
    facts = found.facts
    known = KNOWN.get(capture.folder.name)
    scale = photos[0].size[0] / photos[0].file_size[0]
    off = "" if known is None else f" ({100 * (facts['focal_px'] / known.focal / scale - 1):+.1f} %)"
    return (
        f"{len(found.views)}/{found.photos} | {found.reprojection:.2f} px | f {facts['focal_px']:.0f}{off} "
        f"{facts['lens']} | tags {1000 * (found.alignment.residual if found.alignment else np.nan):.2f} mm | "
        f"{facts['camera_m_nearest']:.2f}-{facts['camera_m_farthest']:.2f} m | turntable {facts['turntable']} | "
        f"dropped {found.dropped or 'none'}"
    )


def objects_line(capture: Capture, settings: ReconstructParameters) -> str:
    """Return the cameras and the sizes of the objects of a capture."""
    result = reconstruct(capture, settings, 1, read_parameters().compute.workers)
    metrics = metrics_of(result, settings.method, None)
    lines = [
        f"{metrics['registered']}/{metrics['photos']} | {metrics['reprojection_px']:.2f} px | "
        f"f {metrics['cameras']['focal_px']:.0f} | tags {metrics['alignment_mm']:.2f} mm"
    ]
    known = KNOWN.get(capture.folder.name)
    for name, item in metrics["objects"].items():
        extents = " x ".join(f"{value:.0f}" for value in item["extents_mm"])
        wanted = "" if known is None else " (independently " + " x ".join(f"{v:.0f}" for v in known.extents if v) + ")"
        shares = ", ".join(f"{photos}: {share:.0%}" for photos, share in item["supported_by"].items())
        lines.append(f"{name} {extents} mm{wanted}; surface measured by photos {shares}")
    return " | ".join(lines)


def grid_lines(folder: Path, largest_side: int) -> list[str]:
    """Return how many of 36 tags are found in each photo of a grid at the product's working size."""
    lines = []
    for path in sorted((folder / "images").glob("*.jpg")):
        grey = read_grey(path)
        times = -(-max(grey.shape) // largest_side)
        lines.append(f"{path.name}: {len(seen_tags(grey, GRID, times).tags)} of 36")
    return lines


def listed_corners(path: Path) -> list[np.ndarray]:
    """Return the corners (4, 2) of every tag that a list names."""
    lines = [re.findall(r"\(([^)]*)\)", line) for line in path.read_text().splitlines() if line.strip()]
    return [np.array([[float(value) for value in corner.split()] for corner in line]) for line in lines]


def single_lines(folder: Path) -> list[str]:
    """Return how many listed tags are found in single photos, and how far their corners are from those listed."""
    lines, found, listed = [], 0, 0
    offsets: list[np.ndarray] = []
    for path in sorted(folder.glob("*_c.txt")):
        seen = [one.corners for one in all_tags(read_grey(path.with_suffix(".jpg")), "tag36h11")]
        own, hits = [], 0
        corners = listed_corners(path)
        for true in corners:
            near = [mine for mine in seen if np.linalg.norm(mine.mean(axis=0) - true.mean(axis=0)) < 3]
            hits += bool(near)
            turns = [np.roll(mine[::way], k, axis=0) for mine in near for k in range(4) for way in (1, -1)]
            if turns:
                own.append(min((np.linalg.norm(turn - true, axis=1) for turn in turns), key=np.sum))
        found, listed, offsets = found + hits, listed + len(corners), offsets + own
        lines.append(f"{path.stem}: {hits} of {len(corners)}, corners {np.median(own):.2f} px (median)")
    lines.append(f"all: {found} of {listed} ({found / listed:.0%}), corners {np.median(offsets):.2f} px (median)")
    return lines


def main(chosen: argparse.Namespace) -> None:
    """Print a line per set."""
    import tempfile

    settings = read_parameters().reconstruct.model_copy(update={"largest_side": chosen.largest_side})
    for folder in sorted(path for path in chosen.folder.iterdir() if path.is_dir()):
        if chosen.only and folder.name != chosen.only:
            continue
        if list(folder.glob("*_c.txt")):
            print(f"{folder.name}:", *single_lines(folder), sep="\n  ", flush=True)
            continue
        if not (folder / "tags.yaml").exists():
            print(f"{folder.name}:", *grid_lines(folder, chosen.largest_side), sep="\n  ", flush=True)
            continue
        capture, line = read_capture(folder), cameras_line if chosen.cameras else objects_line
        with tempfile.TemporaryDirectory() as temporary:
            cases = {"as it is": capture}
            if (folder / "masks").exists():
                bare = Path(temporary) / folder.name
                bare.mkdir()
                cases = {"with masks": capture, "without masks": without_masks(capture, bare)}
            for case, its in cases.items():
                begin = time.process_time()
                try:
                    said = line(its, settings)
                except UserError as error:
                    said = f"refused: {error}"
                print(f"{folder.name}, {case}: {said} ({time.process_time() - begin:.0f} CPU s)", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="name of one set")
    parser.add_argument("--cameras", action="store_true", help="stop at the cameras, before the surfaces")
    parser.add_argument("--largest-side", type=int, default=read_parameters().reconstruct.largest_side)
    main(parser.parse_args())
