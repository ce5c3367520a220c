"""The paper's sixteen objects in ten captures, photographed as by a phone: how far each is off, or why it is refused.

    python benchmarks/phone_captures.py FOLDER [--prepared data/prepare] [--only 0 3]

A capture shows one or two objects among six tags in 14 photos of 800 x 600 pixels, rendered as the stage `capture`
does, but as a phone takes them: a main camera of 26 mm with its distortion, EXIF data with the focal length in whole
millimetres, rows that are read one after another while the hand turns (rolling shutter), a focal length that changes
with the focus from photo to photo, shake, defocus, noise, changing exposure, highlights that clip and spread, JPEG of
quality 80. Rows are kept in FOLDER, so that a run goes on where it stopped. Bars: a chamfer of at most 1.5 mm for every
object, or a refusal that a person agrees with; never an unannounced error over 3 mm. Needs the sixteen objects
(`dvc repro prepare` at the scale `paper`).
"""

from __future__ import annotations

import argparse
import io
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from pipeline.capture.layout import camera_poses  # noqa: E402
from pipeline.capture.recipe import photo_name, placed_solids, render_capture  # noqa: E402
from pipeline.capture.rendering import Lens, Stage  # noqa: E402
from pipeline.capture.sensor import photograph  # noqa: E402
from pipeline.capture.texture import Print, foam_picture  # noqa: E402
from pipeline.reconstruct.lens import focal_of_film  # noqa: E402
from pipeline.reconstruct.photos import EXIF_FOLDER, FOCAL_AS_FILM  # noqa: E402
from pipeline.reconstruct.reconstruction import metrics_of, reconstruct  # noqa: E402
from pipeline.records.captures import read_capture, read_truth  # noqa: E402
from pipeline.records.errors import UserError  # noqa: E402
from pipeline.records.objects import PreparedObject, read_prepared_object  # noqa: E402
from pipeline.records.parameters import read_parameters  # noqa: E402
from pipeline.records.parameters.capture import RenderingParameters  # noqa: E402
from pipeline.records.writing import json_text  # noqa: E402
from pipeline.stages.cost import cost_so_far  # noqa: E402
from pipeline.stages.seeds import item_generator  # noqa: E402

GROUPS = (
    ("cube", "plum"),
    ("soup_can", "slender_cylinder"),
    ("duck",),
    ("bottle", "medicine_bottle_2"),
    ("boxed_beverage",),
    ("bunny", "lemon"),
    ("train", "small_cylinder"),
    ("canned_meat", "medicine_bottle_1"),
    ("soda_can",),
    ("shaving_foam",),
)
PLACES = {1: ((0.0, 0.0),), 2: ((-0.065, -0.035), (0.07, 0.03))}  # m
FILM_MM = 26  # focal length as on 35 mm film that the EXIF data tell
OTHER_LENS, BREATHING = 0.01, 0.007  # relative: of the true focal length to the told one, and from photo to photo
READ_OUT, TURNING = 0.02, np.radians(3.0)  # s from the first row to the last; rad/s, standard deviation about each axis
BLOOM, VEIL = 0.15, 0.02  # of what clips, spread around it, and of white over the whole picture
BLOOM_WIDTH = 10.0  # pixels, standard deviation
PHONE: dict[str, Any] = {
    "views": 14,
    "width": 800,
    "height": 600,
    "distance": 0.42,
    "gloss": 0.35,
    "blur": 0.7,
    "motion_blur": 1.5,
    "noise": 0.012,
    "exposure": 0.15,
    "distortion": (-0.08, 0.02, 0.0004, -0.0004),
    "jpeg_quality": 80,
}


@dataclass(frozen=True)
class RollingLens(Lens):
    """A lens whose rows are read one after another while the camera turns."""

    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rotation vector from the first row to the last, camera frame

    def directions(self, offset: tuple[float, float]) -> NDArray[np.float32]:
        """Return rays as :class:`Lens` does, turned by where the camera is when their row is read."""
        rays = super().directions(offset).reshape(self.height, self.width, 3)
        when = (np.arange(self.height) + offset[1]) / self.height - 0.5
        R = Rotation.from_rotvec(when[:, None] * np.array(self.turn)).as_matrix().astype(np.float32)
        return np.ascontiguousarray(np.einsum("hij,hwj->hwi", R, rays).reshape(-1, 3))


def with_glare(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a picture (h, w, 3) in linear light, what clips spread around it, and a veil over all of it."""
    clipped = np.maximum(light - 1, 0) + 0.3 * np.maximum(light - 0.85, 0)
    spread = cv2.GaussianBlur(clipped, (0, 0), BLOOM_WIDTH)
    return np.asarray((1 - VEIL) * (light + BLOOM * spread) + VEIL, np.float32)


def phone_jpeg(pixels: NDArray[np.uint8], quality: int) -> bytes:
    """Return a JPEG file with the EXIF data of a phone."""
    picture, target = Image.fromarray(pixels), io.BytesIO()
    exif = Image.Exif()
    exif[0x010F], exif[0x0112] = "Phone", 1  # maker; upright
    exif.get_ifd(EXIF_FOLDER)[FOCAL_AS_FILM] = FILM_MM
    picture.save(target, format="JPEG", quality=quality, exif=exif)
    return target.getvalue()


def make_capture(folder: Path, number: int, objects: dict[str, PreparedObject], seed: int) -> None:
    """Render capture ``number`` into ``folder``."""
    name = f"phone_{number}"
    random = item_generator(seed, name, "phone", 0)
    places = {
        item: {"position": place, "yaw_degrees": float(random.uniform(-90, 90))}
        for item, place in zip(objects, PLACES[len(objects)], strict=True)
    }
    settings = RenderingParameters.model_validate({**PHONE, "objects": places})
    # The texts and the truth are the stage's own; its photos, as small as can be, are replaced.
    render_capture(folder, name, objects, settings.model_copy(update={"width": 64, "height": 64}), seed, workers=1)
    stage = Stage(
        list(placed_solids(objects, settings).values()),
        foam_picture(settings.tags, settings.tag_size, item_generator(seed, "capture", "foam", 0)),
        Print.make(item_generator(seed, "capture", "print", 0)),
        settings.texture,
        settings.gloss,
    )
    told = focal_of_film(FILM_MM, settings.width, settings.height)
    usual = told * (1 + OTHER_LENS * random.standard_normal())
    centres = {}
    for view, T in enumerate(camera_poses(settings.views, settings.distance, random)):
        focal = usual * (1 + BREATHING * random.standard_normal())
        turn = READ_OUT * TURNING * random.standard_normal(3)
        lens = RollingLens(settings.width, settings.height, focal, settings.distortion, (turn[0], turn[1], turn[2]))
        pixels = photograph(with_glare(stage.picture(lens, T)), settings, random)
        (folder / "images" / photo_name(view)).write_bytes(phone_jpeg(pixels, settings.jpeg_quality))
        centres[Path(photo_name(view)).stem] = (-T[:3, :3].T @ T[:3, 3]).tolist()
    (folder / "gt/cameras.json").write_text(json_text({"rendered": True, "centres": centres}))


def measured(number: int, prepared: Path) -> dict[str, Any]:
    """Return the row of a capture: its metrics, or why it was refused, and CPU seconds of the reconstruction."""
    parameters = read_parameters()
    objects = {name: read_prepared_object(prepared / name) for name in GROUPS[number]}
    row: dict[str, Any] = {"capture": number, "shows": list(objects)}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "capture"
        make_capture(folder, number, objects, parameters.seed)
        settings, (before, _) = parameters.reconstruct, cost_so_far()
        try:
            result = reconstruct(read_capture(folder), settings, parameters.seed, parameters.compute.workers)
            row["metrics"] = metrics_of(result, settings.method, read_truth(folder))
        except UserError as error:
            row["refused"] = str(error)
        row["cpu_s"] = cost_so_far()[0] - before
    return row


def line(row: dict[str, Any]) -> str:
    """Return a row of the table for docs/capture.md."""
    if "refused" in row:
        return f"| {', '.join(row['shows'])} | refused: {row['refused']} | | | | {row['cpu_s']:.0f} |"
    own = row["metrics"]
    errors = ", ".join(f"{name} {its['chamfer_mm']:.2f}" for name, its in own["objects"].items())
    unseen = ", ".join(f"{its['supported_by']['0']:.0%}" for its in own["objects"].values())
    return (
        f"| {errors} | {own['registered']} of {own['photos']} | {own['reprojection_px']:.2f} px | "
        f"{own['camera_mm_mean']:.2f} mm | {unseen} | {row['cpu_s']:.0f} |"
    )


def main(chosen: argparse.Namespace) -> None:
    """Measure the captures that have no row yet, and print the table."""
    chosen.folder.mkdir(parents=True, exist_ok=True)
    print("| chamfer, mm | photos posed | features | cameras off | surface measured by no photo | CPU s |")
    print("|---|---|---|---|---|---|")
    for number in chosen.only if chosen.only else range(len(GROUPS)):
        kept = chosen.folder / f"{number}.json"
        if not kept.exists():
            kept.write_text(json_text(measured(number, chosen.prepared)))
        print(line(json.loads(kept.read_text())), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="where the rows are kept")
    parser.add_argument("--prepared", type=Path, default=Path("data/prepare"), help="folder of the prepared objects")
    parser.add_argument("--only", type=int, nargs="+", choices=range(len(GROUPS)), help="captures to measure")
    main(parser.parse_args())
