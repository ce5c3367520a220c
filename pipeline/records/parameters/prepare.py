"""`prepare`: from a raw mesh to everything that the other stages need of an object."""

from __future__ import annotations

from pydantic import Field

from pipeline.records.parameters.section import Section


class PrepareParameters(Section):
    """Settings of the mesh preparation, the same for all objects."""

    distance_cells: int = Field(
        128, ge=16, le=512, description="Cells of the signed distance field along the longest axis."
    )
    distance_padding: float = Field(
        0.02, gt=0, le=0.2, description="[m] Margin of the signed distance field around the object."
    )
    surface_points: int = Field(
        4096, ge=256, le=65536, description="Points sampled on the surface by farthest-point sampling."
    )
    hull_excess: float = Field(
        0.15,
        ge=0,
        le=100,
        description="Use the convex hull as the only collision shape if its volume exceeds the object's by at most "
        "this fraction, because the seams and slivers of a convex decomposition push on the hand where there is no "
        "object. Paper's code: always the convex hull.",
    )
    convex_threshold: float = Field(
        0.08, gt=0.01, le=1, description="Concavity threshold of the convex decomposition by CoACD."
    )
    convex_parts: int = Field(
        16, ge=1, le=64, description="Maximum number of convex parts; the cost of physics grows with each."
    )
    part_vertices: int = Field(
        200,
        ge=8,
        le=255,
        description="Maximum number of vertices of a convex part. PhysX allows 255; with 200, a plum loses only 1 % of "
        "its volume.",
    )
