"""The description of a hand: what the pipeline must know besides the hand's URDF, in one file `hands/<name>/hand.yaml`.

Lengths are metres, angles radians. The hand frame is that of the URDF's root link; points and normals of a link are in
that link's own frame.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Literal, Self

import yaml
from pydantic import Field, ValidationError, model_validator

from pipeline.records.errors import UserError, all_mistakes, one_sentence
from pipeline.records.parameters.section import Section

PALM = "palm"
FINGER_NAME = re.compile(r"[a-z][a-z0-9_]*")
FLANGE_LINK, MOUNT_LINK = "panda_link7", "mount"  # links behind a mounted hand, which never_meeting may name

Vector = tuple[float, float, float]
Side = Literal["+x", "-x", "+y", "-y", "+z", "-z"]


class UrdfSource(Section):
    """Where the hand's URDF or MJCF is."""

    package: str | None = Field(
        None, description="Installed Python package that contains the file; null: the folder of hand.yaml contains it."
    )
    path: str = Field(
        description="Path, within the package or folder, of the URDF or MJCF, or of a folder with only one. Meshes are "
        "looked for relative to the URDF's folder and to its parents; `package://` is taken as one of them."
    )
    root: str | None = Field(
        None, description="Link whose frame is the hand's; only what hangs on it is read. null: the file's only root."
    )


class DriveDescription(Section):
    """The drive of a joint, where it differs from that of `physics`."""

    stiffness: float | None = Field(None, gt=0, description="[N m/rad; N/m of a joint that slides] Stiffness.")
    damping: float | None = Field(None, gt=0, description="[N m s/rad; N s/m of a joint that slides] Damping.")
    limit: float | None = Field(None, gt=0, description="[N m; N of a joint that slides] Largest torque or force.")


class DrivesDescription(Section):
    """The drives of the hand's joints; what is not given is `physics.hand_stiffness` and so on."""

    limits_of_urdf: bool = Field(
        False, description="Take the torque limit of every joint from the URDF's `effort`, where it has one."
    )
    joints: dict[str, DriveDescription] = Field(
        default_factory=dict,
        description="Drives by joint, coupled ones too. A joint that slides needs stiffness and damping, and a limit "
        "where the URDF has no `effort`.",
    )


class HoldingDescription(Section):
    """A spread of postures in which a finger holds an object: each angle of `first` with each row of `bent`."""

    first: list[float] = Field(min_length=1, description="Angles of the finger's first joint, rad.")
    bent: list[list[float]] = Field(
        min_length=2, description="Angles of its other joints, rad, from least to most bent; the second row is typical."
    )


class FingerDescription(Section):
    """A finger, or the palm."""

    links: list[str] = Field(min_length=1, description="Links that hold objects, ordered from base to tip.")
    joints: list[str] = Field(
        default_factory=list,
        description="Joints that move the finger, ordered from base to tip; none for the palm, and for a finger that "
        "only follows another one.",
    )
    base: str | None = Field(
        None, description="Link of the finger before the first of `links`, if it has one that does not hold objects."
    )
    straight: list[float] | None = Field(
        None,
        description="[rad] Angles of `joints` with the finger stretched out of the way; null: it has no such posture.",
    )
    holding: HoldingDescription | None = Field(
        None, description="Where the finger is while it holds an object: grasps of other fingers leave this room free."
    )


class SphereDescription(Section):
    """A sphere."""

    centre: Vector = Field((0.0, 0.0, 0.0), description="[m] Centre of the sphere, in the link frame.")
    radius: float = Field(gt=0, description="[m] Radius of the sphere.")


class BoxDescription(Section):
    """A box along the axes of its link."""

    centre: Vector = Field(description="[m] Centre of the box, in the link frame.")
    size: Vector = Field(description="[m] Full extents of the box.")


class ShapesDescription(Section):
    """Boxes and spheres in place of those that would be fitted to the URDF's shapes of a link."""

    boxes: list[BoxDescription] = Field(default_factory=list, description="Boxes of the link.")
    spheres: list[SphereDescription] = Field(default_factory=list, description="Spheres of the link.")


class GridDescription(Section):
    """Coordinates of the points of a grid, in which x changes slowest and z fastest."""

    x: list[float] = Field(min_length=1, description="[m] x coordinates of the grid, in the link frame.")
    y: list[float] = Field(min_length=1, description="[m] y coordinates of the grid, in the link frame.")
    z: list[float] = Field(min_length=1, description="[m] z coordinates of the grid, in the link frame.")


class CapDescription(Section):
    """Points on a sphere, in arcs about an axis that extend to either side of a front."""

    sphere: int = Field(0, ge=0, description="Index of the sphere among those of the link.")
    axis: Side = Field(description="Axis of the link frame that the arcs run about.")
    front: Side = Field(description="Axis of the link frame at azimuth 0; it must be perpendicular to `axis`.")
    polar: tuple[float, float] = Field(description="[rad] Angle from `axis` to the first and to the last arc.")
    azimuth: float = Field(description="[rad] Azimuth up to which the arcs extend to either side of `front`.")
    counts: list[int] = Field(
        min_length=1, description="Number of points on each arc; the heights of the arcs are spaced evenly."
    )

    @model_validator(mode="after")
    def _front_is_beside(self) -> Self:
        if self.front[1] == self.axis[1]:
            raise ValueError("front must be perpendicular to axis")
        return self


class ContactDescription(Section):
    """Contact candidates of a link: exactly one of `grid` with `normal`, `cap`, or `points` with `normals`."""

    grid: GridDescription | None = Field(
        None, description="Grid whose points are each moved to the nearest face with the given normal."
    )
    normal: Side | None = Field(None, description="Outward normal of the box faces that the grid lies on.")
    cap: CapDescription | None = Field(None, description="Points on one of the link's spheres.")
    points: list[Vector] | None = Field(None, description="[m] Points on the link's shapes, in the link frame.")
    normals: list[Vector] | None = Field(None, description="Outward unit normals at `points`, in the link frame.")

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if sum(kind is not None for kind in (self.grid, self.cap, self.points)) != 1:
            raise ValueError("give exactly one of grid, cap and points")
        if (self.grid is None) != (self.normal is None):
            raise ValueError("grid and normal belong together; give both or neither")
        if (self.points is None) != (self.normals is None) or len(self.points or ()) != len(self.normals or ()):
            raise ValueError("points and normals belong together; give as many of one as of the other")
        return self


class PoseDescription(Section):
    """A frame in another one, as in a URDF."""

    xyz: Vector = Field(description="Position, m.")
    rpy: Vector = Field((0.0, 0.0, 0.0), description="Roll, pitch and yaw about fixed axes, rad.")


class MountBoxDescription(Section):
    """The collision shape of a mount."""

    origin: PoseDescription = Field(description="The box in the mount's frame.")
    size: Vector = Field(description="Whole extents, m.")


class MountDescription(Section):
    """A rigid mount between the flange of the Panda (`panda_link7`) and the hand."""

    origin: PoseDescription = Field(description="The mount in the flange's frame.")
    hand: PoseDescription = Field(description="The hand's root link in the mount's frame.")
    mass: float = Field(gt=0, description="kg.")
    inertia: Vector = Field(description="Moments about the axes of the mount's frame, kg m2.")
    box: MountBoxDescription


class TiltDescription(Section):
    """Random tilt of initial hand poses: `axis` is rotated to a vector drawn uniformly from a box."""

    axis: Vector = Field(description="Unit vector that is tilted, in the object frame.")
    low: Vector = Field(description="Lower corner of the box of vectors, in the object frame.")
    high: Vector = Field(description="Upper corner of the box of vectors, in the object frame.")


class HandStyle(Section):
    """Where the search for grasps of one style starts."""

    fingers: list[str] = Field(
        min_length=2,
        description="Fingers (and the palm) that belong to an object that is held in this style; where several objects "
        "are in the hand, those of the others belong to others.",
    )
    orientation: tuple[Vector, Vector, Vector] = Field(
        description="Rotation R_object_hand before the tilt, by rows; its columns are the hand's axes in the object "
        "frame."
    )
    tilt: TiltDescription
    posture: list[float] = Field(
        description="[rad] Joint angles about which initial hand postures are drawn, in the order of `joints`."
    )
    curled_like: str | None = Field(
        None, description="Finger whose posture the fingers of the style are drawn about; null: each about its own."
    )
    released_posture: list[float] | None = Field(
        None,
        description="[rad] Joint angles of the paper's code in place of `posture`, for released_seeds; null: "
        "it has none.",
    )
    held: list[str] = Field(
        default_factory=list,
        description="Fingers whose joints stay as drawn during synthesis, unless the style uses them.",
    )
    waiting: list[str] = Field(
        default_factory=list, description="Fingers that are kept straight while a grasp settles in a gentle squeeze."
    )


class HandDescription(Section):
    """The whole of `hand.yaml`."""

    title: str = Field(min_length=1, description="Name of the hand in reports and pictures.")
    urdf: UrdfSource
    joints: list[str] = Field(
        min_length=1,
        description="All joints that move by themselves, in the order of the column q of all tables. Those that the "
        "URDF lets follow another one (`mimic`) are left out.",
    )
    drives: DrivesDescription = Field(DrivesDescription.model_validate({}))
    density: float = Field(
        1000.0, gt=0, description="[kg/m3] Density of links for which the URDF gives shapes but no mass and inertia."
    )
    fingers: dict[str, FingerDescription] = Field(
        description="Fingers by name; the part of the hand that does not move is called `palm`."
    )
    opposing: list[str] = Field(
        description="Fingers that oppose the others, so that both groups carry half of the force each; none: "
        "all fingers "
        "carry the same."
    )
    palm_normal: Vector = Field(
        description="Unit vector from the hand's origin towards objects in front of the palm, in the hand frame."
    )
    tips: list[str] = Field(description="Links that have the friction of fingertips.")
    shapes: dict[str, ShapesDescription] = Field(
        default_factory=dict, description="Shapes by link, which replace all of the URDF's shapes of that link."
    )
    shape_error: float = Field(
        0.002,
        gt=0,
        le=0.02,
        description="[m] How far the surface of boxes and balls fitted to meshes, cylinders and turned boxes may be "
        "from theirs. Fits are coarser where this would take more than 62 shapes.",
    )
    contacts: dict[str, list[ContactDescription]] = Field(description="Contact candidates by link.")
    may_overlap: list[tuple[str, str]] = Field(
        default_factory=list, description="Pairs of links whose shapes overlap by design, other than parent and child."
    )
    never_meeting: list[list[str]] = Field(
        default_factory=list,
        max_length=32,
        description="Groups of links that cannot collide with one another. Physics skips them, which only saves time.",
    )
    mount: MountDescription | None = Field(
        None, description="Mount that carries the hand on the Panda arm; null: nothing is modelled behind the hand."
    )
    start: list[float] | None = Field(
        None, description="Posture in which robot trials begin, rad; that of the first style if omitted."
    )
    styles: dict[Literal["pinch", "side"], HandStyle] = Field(
        min_length=1, description="Styles in which the hand can grasp."
    )

    @model_validator(mode="after")
    def _joints_agree(self) -> Self:
        mistakes = [*self._mistakes_of_joints(), *self._mistakes_of_styles()]
        if mistakes:
            raise ValueError("; ".join(mistakes))
        return self

    def _mistakes_of_joints(self) -> Iterator[str]:
        if len(set(self.joints)) < len(self.joints):
            yield "joints lists a joint twice; remove one"
        owners: dict[str, str] = {}
        for name, finger in self.fingers.items():
            if not FINGER_NAME.fullmatch(name):
                yield f"the finger name {name!r}: use lower-case letters, digits and underscores, a letter first"
            if name == PALM and finger.joints:
                yield f"fingers.{name}: the palm must have no joints; remove them"
            for joint in finger.joints:
                if joint not in self.joints:
                    yield f"fingers.{name}.joints: {joint!r} is not in joints; add it there, or correct it"
                if owners.setdefault(joint, name) != name:
                    yield f"the joint {joint!r} is in both fingers {owners[joint]} and {name}; remove it from one"
            if finger.straight is not None and len(finger.straight) != len(finger.joints):
                yield f"fingers.{name}.straight needs {len(finger.joints)} angles, one per joint"
            if finger.holding and any(len(row) + 1 != len(finger.joints) for row in finger.holding.bent):
                yield f"fingers.{name}.holding.bent needs an angle per joint after the first in each row"
        for joint in self.joints:
            if joint not in owners:
                yield f"the joint {joint!r} is in no finger; add it to one"

    def _mistakes_of_styles(self) -> Iterator[str]:
        named = {"opposing": self.opposing}
        if self.start is not None and len(self.start) != len(self.joints):
            yield f"start needs {len(self.joints)} angles, one per joint"
        for name, style in self.styles.items():
            for field in ("fingers", "held", "waiting"):
                named[f"styles.{name}.{field}"] = getattr(style, field)
            named[f"styles.{name}.curled_like"] = [style.curled_like] if style.curled_like else []
            for field in ("posture", "released_posture"):
                angles = getattr(style, field)
                if angles is not None and len(angles) != len(self.joints):
                    yield f"styles.{name}.{field} needs {len(self.joints)} angles, one per joint"
            for finger in style.waiting:
                if finger in self.fingers and self.fingers[finger].straight is None:
                    yield f"styles.{name}.waiting: the finger {finger!r} has no straight posture; give it one"
        for where, names in named.items():
            for finger in names:
                if finger not in self.fingers:
                    yield f"{where}: {finger!r} is not a finger; use {', '.join(self.fingers)}"


@lru_cache(maxsize=8)
def read_description(file: Path) -> HandDescription:
    """Read and check a description by itself; whether it fits its URDF is checked by ``hand.model.load_hand``.

    Raises:
        UserError: the file is missing or not YAML, or a value is invalid, unknown or missing.
    """
    try:
        return HandDescription.model_validate(yaml.safe_load(file.read_text()))
    except FileNotFoundError as error:
        raise UserError(f"{file} is missing; see docs/another-hand.md for what to write there.") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(f"{file} is not valid YAML: {' '.join(str(error).split())}; correct it there.") from error
    except ValidationError as error:
        raise UserError(one_sentence(file, all_mistakes(error, "field"))) from error
