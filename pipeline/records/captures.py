"""A capture: a folder of photos of objects on a support, with tags in view (docs/capture.md).

Layout::

    images/            photos, JPEG, PNG or HEIC, any sizes; EXIF orientation is honoured
    tags.yaml          family and size of the tags, and where they lie (``tag_layouts.py``); not with a known length
    scene.yaml         the support plane, per object where it stands and the box that encloses it, and perhaps a known
                       length that takes the place of tags
    intrinsics.yaml    optional: a calibrated camera; estimated from the photos when absent
    masks/             optional: <image stem>.png, white where the photo may be used
    normals/           optional: <image stem>.npy or .png, unit normals in the camera frame (x right, y down, z forward)
    gt/                optional: <object>.ply, the true surface in the scene frame, and cameras.json: only for measuring

The scene frame is the one in which ``tags.yaml`` and ``scene.yaml`` give positions: metres, z up. With a known length
its origin is the first of the two points, dropped onto the support, and x points to the second.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from pipeline.records import paths
from pipeline.records.errors import UserError, first_mistake
from pipeline.records.poses import pose_matrix
from pipeline.records.tag_layouts import Strict, TagLayout
from pipeline.records.texts import parse_json, parse_yaml

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".heic", ".heif")
BESIDE_SUFFIXES = {"masks": (".png",), "normals": (".npy", ".png")}  # the first that exists is taken
# How many of a lens model's parameters are focal lengths, and how many there are in all; the principal point follows
# the focal lengths (https://colmap.github.io/cameras.html).
LENS_PARAMETERS = {
    "SIMPLE_PINHOLE": (1, 3),
    "PINHOLE": (2, 4),
    "SIMPLE_RADIAL": (1, 4),
    "RADIAL": (1, 5),
    "OPENCV": (2, 8),
}
LARGEST_OVERLAP = 0.1  # of two boxes, in parts of the sum of their half extents: places are known to a centimetre


class SceneObject(Strict):
    """The approximate pose of an object, and its maximum size."""

    position: tuple[float, float]  # m, middle of the object on the support plane
    yaw_degrees: float = 0.0  # turns the object's canonical frame, and the box, about z
    box: tuple[float, float, float]  # m, extents of the object along its own axes

    def matrix(self, support: float) -> NDArray[np.float64]:
        """Return (4, 4) the pose of the object's box: origin in the middle of its base, on the plane z = support."""
        half = np.radians(self.yaw_degrees) / 2
        return pose_matrix((*self.position, support), (np.cos(half), 0.0, 0.0, np.sin(half)))

    def corners(self, support: float, margin: float) -> NDArray[np.float64]:
        """Return the corners (8, 3) of the box with ``margin`` (m) on all sides but the lower one, scene frame."""
        x, y, z = self.box[0] / 2 + margin, self.box[1] / 2 + margin, self.box[2] + margin
        local = np.array([[i, j, k] for i in (-x, x) for j in (-y, y) for k in (0.0, z)])
        T = self.matrix(support)
        return np.asarray(local @ T[:3, :3].T + T[:3, 3])


class KnownLength(Strict):
    """The scale of a capture without tags: two points that photos show, and how far apart they are."""

    # per photo (name without suffix) where it shows the point: pixels from the top left corner of the upright photo
    between: tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float]]]
    metres: float = Field(gt=0.005, le=5.0)

    @model_validator(mode="after")
    def _marked_twice(self) -> KnownLength:
        for which, marks in zip(("first", "second"), self.between, strict=True):
            if len(marks) < 2:
                raise ValueError(f"between: mark the {which} point in two photos or more, from different directions")
        return self


class Scene(Strict):
    """``scene.yaml``."""

    support_plane: float = 0.0  # m, z on which the objects stand
    scale: KnownLength | None = None  # in place of tags.yaml
    objects: dict[str, SceneObject] = Field(min_length=1)


class Intrinsics(Strict):
    """``intrinsics.yaml``: a calibrated camera in COLMAP's terms (pixel centres at .5)."""

    model: Literal["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"]
    width: int = Field(ge=16)  # pixels, after EXIF orientation
    height: int = Field(ge=16)
    parameters: list[float]  # pixels and COLMAP's coefficients, in its order

    @model_validator(mode="after")
    def _parameters_fit(self) -> Intrinsics:
        focal, count = LENS_PARAMETERS[self.model]
        if len(self.parameters) != count:
            raise ValueError(f"parameters: {self.model} has {count} of them, not {len(self.parameters)}")
        x, y = self.parameters[focal : focal + 2]
        if min(self.parameters[:focal]) <= 0 or not (0 < x < self.width and 0 < y < self.height):
            raise ValueError("parameters: focal lengths are positive and the principal point lies in the picture")
        return self

    def shrunk(self, times: int) -> Intrinsics:
        """Return the camera of photos that were shrunk by an integer factor, leftover pixels cropped."""
        focal, _ = LENS_PARAMETERS[self.model]
        lengths, lens = self.parameters[: focal + 2], self.parameters[focal + 2 :]
        return Intrinsics(
            model=self.model,
            width=self.width // times,
            height=self.height // times,
            parameters=[length / times for length in lengths] + lens,
        )

    def check_sizes(self, sizes: Mapping[str, tuple[int, int]]) -> None:
        """Refuse photos whose size is not this camera's.

        Args:
            sizes: width and height of every photo by its name, pixels.

        Raises:
            UserError: a photo has another size.
        """
        for name, (width, height) in sizes.items():
            if (width, height) != (self.width, self.height):
                raise UserError(
                    f"intrinsics.yaml is for {self.width} x {self.height} pixels, but {name} has {width} x {height}; "
                    "remove intrinsics.yaml or that photo."
                )


@dataclass(frozen=True)
class Capture:
    """A capture whose text files were read and checked; its photos are listed but not opened."""

    folder: Path
    images: tuple[Path, ...]  # in the order of their names
    tags: TagLayout | KnownLength  # or the known length that takes the place of tags
    scene: Scene
    intrinsics: Intrinsics | None

    def beside(self, kind: Literal["masks", "normals"], image: Path) -> Path | None:
        """Return the file of ``masks/`` or ``normals/`` that belongs to an image, or None if there is none."""
        for suffix in BESIDE_SUFFIXES[kind]:
            path = self.folder / kind / f"{image.stem}{suffix}"
            if path.exists():
                return path
        return None


Model = TypeVar("Model", bound=Strict)


class _Loader(yaml.SafeLoader):
    """The safe loader, except that it refuses duplicate keys: the second would silently replace the first."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return a mapping, as the safe loader does."""
        keys = [(key.tag, key.value) for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        double = next((value for (_, value), count in Counter(keys).items() if count > 1), None)
        if double is not None:
            raise yaml.constructor.ConstructorError(None, None, f"{double} occurs twice", node.start_mark)
        return super().construct_mapping(node, deep)


def _read_yaml(path: Path, model: type[Model]) -> Model:
    try:
        content: Any = parse_yaml(path.read_text(encoding="utf-8"), _Loader)
    except FileNotFoundError as error:
        raise UserError(f"{path} is missing; docs/capture.md shows what it holds.") from error
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror}; docs/capture.md shows what it holds.") from error
    except (yaml.YAMLError, ValueError) as error:
        raise UserError(f"{path} is not valid YAML: {' '.join(str(error).split())}; correct it there.") from error
    if not isinstance(content, dict):
        raise UserError(f"{path} is empty or not a mapping; docs/capture.md shows what it holds.")
    try:
        return model.model_validate(content)
    except ValidationError as error:
        # Of a value that may be one of several kinds, pydantic also names the kind, such as dict[int,TagPose].
        mistake = re.sub(r"\w+\[[^:]*\]\.?", "", first_mistake(error, "key"), count=1)
        raise UserError(f"{path}: {mistake}; docs/capture.md shows what it holds.") from error


def _images(folder: Path) -> tuple[Path, ...]:
    if not (folder / "images").is_dir():
        raise UserError(f"{folder} has no folder images/; create it and put the photos there.")
    present = sorted(path for path in (folder / "images").iterdir() if not path.name.startswith("."))
    foreign = [path for path in present if path.suffix.lower() not in IMAGE_SUFFIXES or path.is_dir()]
    if foreign:
        raise UserError(
            f"{foreign[0]} is neither JPEG nor PNG nor HEIC ({len(foreign)} such files); "
            "convert photos of other kinds to JPEG, and put other files elsewhere."
        )
    stems = [path.stem for path in present]
    double = next((stem for stem in stems if stems.count(stem) > 1), None)
    if double is not None:
        raise UserError(f"{folder}/images has two photos named {double}; rename one.")
    return tuple(present)


def _check_beside(folder: Path, images: tuple[Path, ...]) -> None:
    stems = {image.stem for image in images}
    for kind, suffixes in BESIDE_SUFFIXES.items():
        if (folder / kind).exists() and not (folder / kind).is_dir():
            raise UserError(f"{folder / kind} is not a folder; remove it, or make it one.")
        present = sorted((folder / kind).glob("[!.]*"))
        lost = [path for path in present if path.stem not in stems]
        if lost:
            raise UserError(f"{lost[0]} belongs to no photo; give it the name of its photo, or remove it.")
        foreign = [path for path in present if path.suffix not in suffixes]
        if foreign:
            raise UserError(f"{foreign[0]} is not used; save it as {' or '.join(suffixes)}, or remove it.")


def _overlap(one: SceneObject, other: SceneObject) -> float:
    """Return how far two boxes overlap, seen from above, as a fraction of the sum of their half extents.

    The least over the axes of both, across which two rectangles can be told apart; negative where there is a gap.
    """
    axes = [item.matrix(0.0)[:2, :2] for item in (one, other)]  # columns: an object's own x and y
    halves = [np.array(item.box[:2]) / 2 for item in (one, other)]
    across = np.concatenate([axis.T for axis in axes])  # (4, 2)
    reach = sum(np.abs(across @ axis) @ half for axis, half in zip(axes, halves, strict=True))
    distance = np.abs(across @ np.subtract(one.position, other.position))
    return float((1 - distance / reach).min())


def _check_scene(path: Path, scene: Scene) -> None:
    for name, item in scene.objects.items():
        if not name.replace("_", "a").isalnum() or not name[0].isalpha() or name != name.lower():
            raise UserError(
                f"{path}: object name {name!r}: use lower-case letters, digits and underscores, and begin with a "
                f"letter."
            )
        if min(item.box) <= 0.003 or max(item.box) > 1.0:
            raise UserError(
                f"{path}: objects.{name}.box: {list(item.box)} is not a size in metres; give the object's extents in m."
            )
    for (first, one), (second, other) in combinations(scene.objects.items(), 2):
        if _overlap(one, other) > LARGEST_OVERLAP:
            gap = np.hypot(*np.subtract(one.position, other.position))
            raise UserError(
                f"{path}: the boxes of {first} and {second} overlap (centres {1000 * gap:.0f} mm apart); "
                "correct their positions, or move the objects apart and take the photos again."
            )


def _check_scale(folder: Path, scale: KnownLength, images: tuple[Path, ...]) -> None:
    if (folder / "tags.yaml").exists():
        raise UserError(
            f"{folder} has both tags.yaml and `scale` in scene.yaml; remove one (tags are the more accurate)."
        )
    lost = sorted({name for marks in scale.between for name in marks} - {image.stem for image in images})
    if lost:
        raise UserError(
            f"{folder}/scene.yaml: scale.between: {lost[0]} is no photo in images/; write its name without .jpg."
        )


def read_tags(path: Path) -> TagLayout:
    """Read ``tags.yaml``; raises as :func:`read_capture`."""
    return _read_yaml(path, TagLayout)


def read_scene(path: Path) -> Scene:
    """Read and check ``scene.yaml``; raises as :func:`read_capture`."""
    scene = _read_yaml(path, Scene)
    _check_scene(path, scene)
    return scene


def read_intrinsics(path: Path) -> Intrinsics:
    """Read ``intrinsics.yaml``; raises as :func:`read_capture`."""
    return _read_yaml(path, Intrinsics)


def read_capture(folder: Path) -> Capture:
    """Read and check the text files of a capture, and list its photos.

    Raises:
        UserError: something is missing, unreadable or contradicts itself.
    """
    if not folder.is_dir():
        mend = "put photos there as docs/capture.md says"
        if folder == paths.capture_folder(folder.name):
            mend = "run `dvc repro capture`"
        raise UserError(f"the capture folder {folder} is missing; {mend}.")
    images = _images(folder)
    _check_beside(folder, images)
    scene = read_scene(folder / "scene.yaml")
    if scene.scale is not None:
        _check_scale(folder, scene.scale, images)
    tags = scene.scale or read_tags(folder / "tags.yaml")
    source = folder / "intrinsics.yaml"
    return Capture(folder, images, tags, scene, read_intrinsics(source) if source.exists() else None)


@dataclass(frozen=True)
class Truth:
    """``gt/``: the ground truth of a synthetic capture, used for evaluation only."""

    surfaces: dict[str, Path]  # per object its true mesh in the scene frame
    rendered: bool  # the photos are pictures of a computer
    camera_centres: dict[str, NDArray[np.float64]]  # per image stem (3,), scene frame


def read_truth(folder: Path) -> Truth | None:
    """Return the ground truth of a capture, or None if it has none.

    Raises:
        UserError: ``gt/cameras.json`` is damaged.
    """
    if not (folder / "gt").is_dir():
        return None
    surfaces = {path.stem: path for path in sorted((folder / "gt").glob("*.ply"))}
    source = folder / "gt/cameras.json"
    if not source.exists():
        return Truth(surfaces, False, {})
    try:
        content = parse_json(source.read_text())
        centres = {name: np.asarray(centre, np.float64).reshape(3) for name, centre in content["centres"].items()}
        return Truth(surfaces, bool(content["rendered"]), centres)
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise UserError(f"{source} is damaged ({error}); remove it, or make the capture again.") from error
