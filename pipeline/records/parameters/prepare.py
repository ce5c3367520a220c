"""`prepare`: from a raw mesh to everything the other stages need of an object."""

from __future__ import annotations

from pydantic import Field

from pipeline.records.parameters.section import Section


class PrepareParameters(Section):
    """Settings of the mesh preparation, the same for all objects."""

    distance_cells: int = Field(
        128, ge=16, le=512, description="Cells of the signed-distance grid on the longest axis."
    )
    distance_padding: float = Field(0.02, gt=0, le=0.2, description="Margin of the grid around the object, m.")
    surface_points: int = Field(4096, ge=256, le=65536, description="Farthest-point surface samples.")
    hull_excess: float = Field(
        0.15,
        ge=0,
        le=100,
        description="A convex hull that is larger than the solid by at most this share is the only part: the seams and "
        "slivers of a decomposition press on the hand where no object is. Paper's code: always one hull.",
    )
    convex_threshold: float = Field(0.08, gt=0.01, le=1, description="CoACD concavity threshold.")
    convex_parts: int = Field(16, ge=1, le=64, description="Most convex parts kept (PhysX cost grows with each).")
    part_vertices: int = Field(
        200,
        ge=8,
        le=255,
        description="Most vertices of a convex part; PhysX allows 255, a plum needs 200 to lose only 1 % of volume.",
    )
