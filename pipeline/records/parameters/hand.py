"""The description of a hand: what the pipeline must know beside the hand's URDF, in one file `hands/<name>/hand.yaml`.

Lengths are metres, angles radians. The hand frame is that of the URDF's root link; points and normals of a link are in
that link's own frame.
"""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path
from typing import Literal, Self

import yaml
from pydantic import Field, ValidationError, model_validator

from pipeline.records.errors import UserError, first_mistake
from pipeline.records.parameters.section import Section

HANDS_FOLDER = Path(__file__).resolve().parents[3] / "hands"
DESCRIPTION = "hand.yaml"
ALLEGRO = "allegro"  # the hand of everything about two objects, the arm and the learned model
PALM = "palm"
FINGER_NAME = re.compile(r"[a-z][a-z0-9_]*")
MOUNT_LINKS = ("panda_link7", "mount")  # links behind a mounted hand that never_meeting may name

Vector = tuple[float, float, float]
Side = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


class UrdfSource(Section):
    """Where the URDF lies."""

    package: str | None = Field(None, description="Installed Python package; null: the folder of this description.")
    path: str = Field(description="Path inside the package or folder; meshes are named relative to the URDF.")


class FingerDescription(Section):
    """A finger, or the palm."""

    links: list[str] = Field(min_length=1, description="Links that hold objects, from the base to the tip.")
    joints: list[str] = Field(default_factory=list, description="Joints that move it, from the base; none for a palm.")
    base: str | None = Field(None, description="Link before the first of `links` that belongs to the finger as well.")
    straight: list[float] | None = Field(
        None,
        description="Angles of `joints`, rad, of the finger stretched out of the way; null: it has no such posture.",
    )


class SphereDescription(Section):
    """A ball."""

    centre: Vector = Field((0.0, 0.0, 0.0), description="Link frame, m.")
    radius: float = Field(gt=0, description="m.")


class BoxDescription(Section):
    """A box along the axes of its link."""

    centre: Vector = Field(description="Link frame, m.")
    size: Vector = Field(description="Whole extents, m.")


class ShapesDescription(Section):
    """Boxes and balls that stand for a link where the URDF has a mesh, a cylinder or a turned box."""

    boxes: list[BoxDescription] = Field(default_factory=list)
    spheres: list[SphereDescription] = Field(default_factory=list)


class GridDescription(Section):
    """Coordinates of a grid; x changes slowest, z fastest."""

    x: list[float] = Field(min_length=1, description="m.")
    y: list[float] = Field(min_length=1, description="m.")
    z: list[float] = Field(min_length=1, description="m.")


class CapDescription(Section):
    """Rings of points on a ball, about an axis and to either side of a front."""

    sphere: int = Field(0, ge=0, description="Which of the link's balls, from 0.")
    axis: Side = Field(description="Polar axis.")
    front: Side = Field(description="Where azimuth 0 is; at a right angle to the axis.")
    polar: tuple[float, float] = Field(description="Angles from the axis of the first and the last ring, rad.")
    azimuth: float = Field(description="Points lie within this to either side of the front, rad.")
    counts: list[int] = Field(min_length=1, description="Points of each ring; ring heights are spaced evenly.")

    @model_validator(mode="after")
    def _front_is_beside(self) -> Self:
        if self.front[1] == self.axis[1]:
            raise ValueError("front must be at a right angle to axis")
        return self


class ContactDescription(Section):
    """Contact candidates of a link: exactly one of `grid` with `normal`, `cap`, or `points` with `normals`."""

    grid: GridDescription | None = Field(
        None, description="Points, each moved to the nearest face that looks along `normal`."
    )
    normal: Side | None = Field(None, description="Outward direction of the faces of boxes that the grid lies on.")
    cap: CapDescription | None = Field(None, description="Points on a ball.")
    points: list[Vector] | None = Field(None, description="Points on the link's shapes, m.")
    normals: list[Vector] | None = Field(None, description="Outward unit normals of `points`.")

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if sum(kind is not None for kind in (self.grid, self.cap, self.points)) != 1:
            raise ValueError("give exactly one of grid, cap, points")
        if (self.grid is None) != (self.normal is None):
            raise ValueError("grid and normal belong together")
        if (self.points is None) != (self.normals is None) or len(self.points or ()) != len(self.normals or ()):
            raise ValueError("points and normals belong together, as many of the one as of the other")
        return self


class TiltDescription(Section):
    """How far first hands are turned: `axis` is turned to a direction drawn evenly from a box of vectors."""

    axis: Vector = Field(description="Unit vector, object frame.")
    low: Vector = Field(description="Lower corner of the box, object frame.")
    high: Vector = Field(description="Upper corner.")


class HandStyle(Section):
    """How the hand begins to look for a grasp of one style."""

    orientation: tuple[Vector, Vector, Vector] = Field(
        description="R_object_hand by rows, before the tilt: its columns are the hand's axes in the object frame."
    )
    tilt: TiltDescription
    posture: list[float] = Field(
        description="Joint angles, rad, in the order of `joints`, about which hands are drawn."
    )
    curled_like: str | None = Field(
        None, description="Fingers that the style uses are drawn about the posture of this one; null: about their own."
    )
    released_posture: list[float] | None = Field(
        None, description="The same of the paper's code, for released_seeds; null: the hand has none."
    )
    held: list[str] = Field(
        default_factory=list, description="Fingers that stay where they are drawn, unless the style uses them."
    )
    waiting: list[str] = Field(
        default_factory=list, description="Fingers that are straight while a grasp settles in the gentle squeeze."
    )


class HandDescription(Section):
    """All of `hand.yaml`."""

    title: str = Field(min_length=1, description="Name for people.")
    urdf: UrdfSource
    joints: list[str] = Field(min_length=1, description="All moving joints; the order of every table's q.")
    fingers: dict[str, FingerDescription] = Field(description="Fingers by name; `palm` is the part that does not move.")
    opposing: list[str] = Field(
        description="Fingers that the others press against: both groups carry half of the force each; none: all equal."
    )
    palm_normal: Vector = Field(description="Unit vector from the hand's origin to objects before it, hand frame.")
    tips: list[str] = Field(description="Links with the friction of fingertips.")
    shapes: dict[str, ShapesDescription] = Field(
        default_factory=dict, description="Shapes of links, in place of all of the URDF's for that link."
    )
    contacts: dict[str, list[ContactDescription]] = Field(description="Contact candidates by link.")
    may_overlap: list[tuple[str, str]] = Field(
        default_factory=list, description="Pairs of links beside parent and child whose shapes overlap by design."
    )
    never_meeting: list[list[str]] = Field(
        default_factory=list,
        max_length=32,
        description="Groups of links that cannot meet; physics does not test them: only faster.",
    )
    mount: Literal["panda_allegro"] | None = Field(
        None, description="What carries it in the tests: the published mount on the Panda; null: nothing is modelled."
    )
    styles: dict[Literal["pinch", "side"], HandStyle] = Field(min_length=1, description="Styles that it can grasp in.")

    @model_validator(mode="after")
    def _joints_agree(self) -> Self:
        if len(set(self.joints)) < len(self.joints):
            raise ValueError("joints names a joint twice")
        owners: dict[str, str] = {}
        for name, finger in self.fingers.items():
            if not FINGER_NAME.fullmatch(name):
                raise ValueError(f"the finger name {name!r}: use small letters, digits and underscores, a letter first")
            if (name == PALM) != (not finger.joints):
                raise ValueError(f"fingers.{name}: `palm`, and no other, has no joints")
            for joint in finger.joints:
                if joint not in self.joints:
                    raise ValueError(f"fingers.{name}.joints names {joint!r}, which is not in joints")
                if owners.setdefault(joint, name) != name:
                    raise ValueError(
                        f"the joint {joint!r} is in the fingers {owners[joint]} and {name}; give it to one"
                    )
            if finger.straight is not None and len(finger.straight) != len(finger.joints):
                raise ValueError(f"fingers.{name}.straight needs {len(finger.joints)} angles, one per joint")
        for joint in self.joints:
            if joint not in owners:
                raise ValueError(f"the joint {joint!r} is in no finger; name it in one")
        return self

    @model_validator(mode="after")
    def _fingers_agree(self) -> Self:
        named = {"opposing": self.opposing}
        for name, style in self.styles.items():
            named |= {f"styles.{name}.held": style.held, f"styles.{name}.waiting": style.waiting}
            named[f"styles.{name}.curled_like"] = [style.curled_like] if style.curled_like else []
            for field in ("posture", "released_posture"):
                angles = getattr(style, field)
                if angles is not None and len(angles) != len(self.joints):
                    raise ValueError(f"styles.{name}.{field} needs {len(self.joints)} angles, one per joint")
            for finger in style.waiting:
                if finger in self.fingers and self.fingers[finger].straight is None:
                    raise ValueError(f"styles.{name}.waiting names {finger!r}, which has no straight posture")
        for where, names in named.items():
            for finger in names:
                if finger not in self.fingers:
                    raise ValueError(
                        f"{where} names {finger!r}, which is no finger; there are {', '.join(self.fingers)}"
                    )
        return self


def known_hands() -> list[str]:
    """Return the names of the hands that are described."""
    return sorted(file.parent.name for file in HANDS_FOLDER.glob(f"*/{DESCRIPTION}"))


def description_file(name: str) -> Path:
    """Return the file that describes a hand.

    Raises:
        UserError: there is none of this name.
    """
    if name not in known_hands():
        raise UserError(
            f"there is no hand {name!r}; describe it in hands/{name}/{DESCRIPTION}, or use one of "
            f"{', '.join(known_hands())}."
        )
    return HANDS_FOLDER / name / DESCRIPTION


@lru_cache(maxsize=8)
def read_description(file: Path) -> HandDescription:
    """Read and check a description by itself; whether it fits its URDF is checked by ``hand.model.load_hand``.

    Raises:
        UserError: the file is missing, is not YAML, or has a wrong, unknown or missing value.
    """
    try:
        return HandDescription.model_validate(yaml.safe_load(file.read_text()))
    except FileNotFoundError as error:
        raise UserError(f"{file} is missing; docs/another-hand.md says what to write there.") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(f"{file} is not valid YAML: {' '.join(str(error).split())}; correct it there.") from error
    except ValidationError as error:
        raise UserError(f"{file}: {first_mistake(error, 'field')}; correct it there.") from error
