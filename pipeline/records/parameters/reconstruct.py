"""`reconstruct`: from photos to metric surfaces."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from pipeline.records.parameters.section import Section


class SparseParameters(Section):
    """Structure from motion: features, matches, camera poses."""

    features: int = Field(4096, ge=200, le=50000, description="Most SIFT features per photo.")
    mapper: Literal["global", "incremental"] = Field(
        "global", description="COLMAP's mapper: all poses at once (GLOMAP), or photo by photo."
    )
    camera_model: Literal["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"] = Field(
        "OPENCV", description="Lens model that is estimated when the capture has no intrinsics.yaml."
    )
    least_registered: float = Field(0.8, gt=0, le=1, description="Share of the photos whose pose must be found.")


class AlignmentParameters(Section):
    """The scene frame and the metric scale, from AprilTags."""

    pixel_tolerance: float = Field(1.5, gt=0, description="A sighting of a corner farther off is an outlier, pixels.")
    least_views: int = Field(3, ge=2, description="Sightings that a corner needs to count.")
    least_tags: int = Field(2, ge=1, description="Tags that must be located. One tag: 1.5 mm camera error (measured).")
    largest_residual: float = Field(
        0.003, gt=0, description="Root mean square distance of located corners to the layout, m, that is accepted."
    )


class SweepParameters(Section):
    """Depth maps by plane sweep, and the points on which they agree."""

    planes: int = Field(128, ge=8, le=1024, description="Depths tried per pixel, between the ends of the object's box.")
    window: int = Field(7, ge=3, le=31, description="Edge of the correlated windows, pixels (odd).")
    neighbours: int = Field(6, ge=1, le=20, description="Other photos that a photo is compared with.")
    baseline_degrees: float = Field(16.0, gt=0, le=60, description="Angle between photos that is looked for.")
    least_correlation: float = Field(0.6, ge=0, le=1, description="Worse matches are dropped.")
    agreement: float = Field(0.002, gt=0, description="Depths of photos that agree differ by less, m.")
    least_agreeing: int = Field(2, ge=1, description="Other photos that must agree with a point.")
    voxel: float = Field(0.001, gt=0, description="Edge of the cells in which points are averaged, m.")


class SurfaceParameters(Section):
    """The closed surface of each object, and the samples of it."""

    margin: float = Field(0.015, ge=0, le=0.1, description="Added to every side of an object's box, m.")
    clearance: float = Field(0.003, ge=0, description="Points lower above the support belong to the support, m.")
    poisson_depth: int = Field(8, ge=4, le=11, description="Depth of the Poisson octree.")
    least_points: int = Field(500, ge=10, description="Points in an object's box without which it is not there.")
    points: int = Field(4096, ge=256, le=65536, description="Samples of each surface; as prepare.surface_points.")


class SplatParameters(Section):
    """2D Gaussian splatting, started from the points of the sweep."""

    device: str = Field("cpu", description="Warp device: cpu, cuda:0, ...")
    iterations: int = Field(240, ge=1, description="Optimiser steps per object; one photo each.")
    spacing: float = Field(0.002, gt=0, description="Distance of the initial splats, m.")
    image_scale: float = Field(0.5, gt=0, le=1, description="Photos are shrunk by this.")
    weight_distortion: float = Field(10.0, ge=0, description="Of the depth-distortion term; paper 100 (unbounded 10).")
    weight_normal: float = Field(0.05, ge=0, description="Of the normal-consistency term; paper 0.05.")
    weight_prior: float = Field(0.05, ge=0, description="Of the normal maps of the capture, if it has any.")
    cell: float = Field(0.0015, gt=0, description="Cell of the distance field that fuses the rendered depths, m.")


class ReconstructParameters(Section):
    """Settings of the reconstruction, the same for all captures."""

    method: Literal["plane_sweep", "2dgs"] = Field("plane_sweep", description="How the surface is made; paper: 2dgs.")
    largest_side: int = Field(
        1600,
        ge=64,
        le=20000,
        description="Larger photos are shrunk by the smallest whole number that makes them fit, pixels. Time and "
        "memory grow with the area.",
    )
    sparse: SparseParameters
    alignment: AlignmentParameters
    sweep: SweepParameters
    surface: SurfaceParameters
    splat: SplatParameters
