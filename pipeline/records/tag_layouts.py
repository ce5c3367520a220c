"""``tags.yaml`` of a capture: which tags there are, how large, and where they lie.

Three ways to say where: each tag by its pose (``tags``), a printed board by its rows and columns (``board``), or
nothing but their size (``tags: anywhere``), and then the photos tell.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from pipeline.records.poses import pose_matrix

ARUCO_COUNTS = (50, 100, 250, 1000)
# How many tags each family has, and how many cells the inside of one is wide. ArUco's families of one grid size are
# beginnings of the largest one, so that a number means the same tag in all of them.
TAG_FAMILIES = {
    "tag36h11": (587, 6),
    "tag25h9": (35, 5),
    "tag16h5": (30, 4),
    **{f"aruco_{n}x{n}_{count}": (count, n) for n in (4, 5, 6, 7) for count in ARUCO_COUNTS},
    "aruco_original": (1024, 5),
}
ANYWHERE = "anywhere"


def opencv_name(family: str) -> str:
    """Return the name of a family's dictionary in ``cv2.aruco``."""
    if family.startswith("tag"):
        return f"DICT_APRILTAG_{family.removeprefix('tag')}"
    return f"DICT_{(family if family == 'aruco_original' else family.removeprefix('aruco_')).upper()}"


class Strict(BaseModel):
    """A part of a YAML file: unknown keys are refused, values are read-only."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class TagPose(Strict):
    """Where one tag lies: its centre, and either a yaw (tag flat, facing up) or a full orientation."""

    position: tuple[float, float, float]  # m, centre of the tag in the scene frame
    yaw_degrees: float = 0.0  # counter-clockwise seen from above; 0: the tag's right is +x and its top is +y
    quaternion: tuple[float, float, float, float] | None = None  # wxyz instead of the yaw; tag frame x right, y up

    @field_validator("quaternion")
    @classmethod
    def _unit(cls, value: tuple[float, float, float, float] | None) -> tuple[float, float, float, float] | None:
        if value is not None and abs(np.linalg.norm(value) - 1) > 0.01:
            raise ValueError("a rotation's quaternion (w, x, y, z) has length 1")
        return value

    @model_validator(mode="after")
    def _one_orientation(self) -> TagPose:
        if self.quaternion is not None and "yaw_degrees" in self.model_fields_set:
            raise ValueError("give yaw_degrees or quaternion, not both")
        return self

    def matrix(self) -> NDArray[np.float64]:
        """Return ``T_scene_tag`` (4, 4): tag frame x to the right of the upright print, y to its top, z out of it."""
        half = np.radians(self.yaw_degrees) / 2
        return pose_matrix(self.position, self.quaternion or (np.cos(half), 0.0, 0.0, np.sin(half)))


class Board(Strict):
    """A printed sheet on which tags stand in rows and columns."""

    kind: Literal["grid", "charuco", "aprilgrid"]
    columns: int = Field(ge=1, le=100)  # of tags; of squares, for charuco
    rows: int = Field(ge=1, le=100)
    gap: float | None = Field(None, gt=0, le=1)  # m between the black squares of neighbours: grid, aprilgrid
    square: float | None = Field(None, gt=0, le=1)  # m, edge of a square of the chessboard: charuco
    first: int = Field(0, ge=0)  # number of the first tag
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, the board's middle in the scene frame
    yaw_degrees: float = 0.0  # counter-clockwise seen from above

    @model_validator(mode="after")
    def _one_length(self) -> Board:
        wanted, other = ("square", "gap") if self.kind == "charuco" else ("gap", "square")
        if getattr(self, wanted) is None or getattr(self, other) is not None:
            raise ValueError(f"a {self.kind} board has `{wanted}`, in metres, and no `{other}`; give it")
        return self

    def middles(self, size: float) -> dict[int, tuple[float, float]]:
        """Return per tag its middle on the sheet, m from the sheet's middle: x to its right, y to its top.

        Tags are numbered row by row: from the top left as OpenCV draws grids and chessboards, from the bottom left as
        kalibr draws its AprilGrid. A chessboard has tags in its white squares; that in its top left corner is black.

        Args:
            size: edge of a tag's black square, m.
        """
        pitch = self.square if self.square is not None else size + (self.gap or 0.0)
        found, number = {}, self.first
        for row in range(self.rows):
            for column in range(self.columns):
                if self.kind == "charuco" and (row + column) % 2 == 0:
                    continue
                up = row if self.kind == "aprilgrid" else self.rows - 1 - row
                found[number] = (pitch * (column - (self.columns - 1) / 2), pitch * (up - (self.rows - 1) / 2))
                number += 1
        return found

    def poses(self, size: float) -> dict[int, TagPose]:
        """Return where every tag of the board lies in the scene."""
        half = np.radians(self.yaw_degrees) / 2
        T = pose_matrix(self.position, (np.cos(half), 0.0, 0.0, np.sin(half)))
        return {
            number: TagPose(position=tuple(T[:3, :3] @ [x, y, 0.0] + T[:3, 3]), yaw_degrees=self.yaw_degrees)
            for number, (x, y) in self.middles(size).items()
        }


class TagLayout(Strict):
    """``tags.yaml``."""

    family: str
    size: float = Field(gt=0.002, le=1.0)  # m, edge of the black square
    # Which way up the printed tags are: as OpenCV draws them, or as the AprilTag project's image files (turned by 180
    # degrees). `./dev capture print-tags` draws opencv; ArUco's tags are always so.
    convention: Literal["opencv", "apriltag"] = "opencv"
    border: Literal[1, 2] = 1  # cells of the black border; kalibr prints its AprilGrid with 2
    tags: dict[int, TagPose] | Literal["anywhere"] | None = None
    board: Board | None = None

    @field_validator("family")
    @classmethod
    def _known_family(cls, value: str) -> str:
        if value not in TAG_FAMILIES:
            raise ValueError(f"there is no family {value}; choose one of {', '.join(TAG_FAMILIES)}")
        return value

    @field_validator("tags", mode="before")
    @classmethod
    def _poses_or_anywhere(cls, value: object) -> object:
        if isinstance(value, str) and value != ANYWHERE:
            raise ValueError(f"give the tags' poses, or the word {ANYWHERE}")
        if isinstance(value, dict) and not value:
            raise ValueError("there is none; give at least one")
        return value

    @model_validator(mode="after")
    def _fits_together(self) -> TagLayout:
        if (self.tags is None) == (self.board is None):
            raise ValueError("give either tags or board")
        if "convention" not in self.model_fields_set and self.family.startswith("tag"):
            raise ValueError("convention: AprilTags are drawn in two ways, opencv and apriltag; say which")
        count, _ = TAG_FAMILIES[self.family]
        wrong = next((number for number in self.poses() if not 0 <= number < count), None)
        if wrong is not None:
            raise ValueError(f"{self.family} has no tag {wrong}; its tags are 0 to {count - 1}")
        return self

    @property
    def solved(self) -> bool:
        """Whether the photos are to tell where the tags lie."""
        return self.tags == ANYWHERE

    @property
    def cells(self) -> int:
        """How many cells a tag's black square is wide."""
        return TAG_FAMILIES[self.family][1] + 2 * self.border

    def poses(self) -> Mapping[int, TagPose]:
        """Return where every tag lies, as far as it is known."""
        if self.board is not None:
            return self.board.poses(self.size)
        return self.tags if isinstance(self.tags, dict) else {}

    def numbers(self) -> frozenset[int]:
        """Return the tags that may be in the photos."""
        return frozenset(range(TAG_FAMILIES[self.family][0]) if self.solved else self.poses())

    def square(self) -> NDArray[np.float64]:
        """Return the corners (4, 3) of a tag in its own frame, in the order of OpenCV's detector."""
        corners = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]], np.float64) * self.size / 2
        return np.roll(corners, 2, axis=0) if self.convention == "apriltag" else corners

    def corners(self) -> dict[int, NDArray[np.float64]]:
        """Return per tag its corners (4, 3) in the scene frame, in the order of OpenCV's detector.

        The order is top left, top right, bottom right, bottom left of the tag as OpenCV draws it.
        """
        square, found = self.square(), {}
        for number, pose in self.poses().items():
            T = pose.matrix()
            found[number] = square @ T[:3, :3].T + T[:3, 3]
        return found
