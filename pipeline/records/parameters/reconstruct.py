"""`reconstruct`: from photos to metric surfaces."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from pipeline.records.parameters.section import Section


class SparseParameters(Section):
    """Structure from motion: features, matches, camera poses."""

    features: int = Field(4096, ge=200, le=50000, description="Maximum number of SIFT features per photo.")
    mapper: Literal["global", "incremental"] = Field(
        "global",
        description="COLMAP's mapper for photos of which tags pose fewer than half: all camera poses at once "
        "(`global`, GLOMAP) or photo by photo.",
    )
    camera_model: Literal["SIMPLE_RADIAL", "RADIAL", "OPENCV"] = Field(
        "OPENCV",
        description="Richest lens model (of COLMAP's, with square pixels and the principal point in the middle) that "
        "may be estimated if the capture has no intrinsics.yaml; the plainest is taken unless a richer one fits photos "
        "better that took no part in estimating it.",
    )
    least_registered: float = Field(
        0.8, gt=0, le=1, description="Minimum fraction of the photos whose camera pose must be found."
    )


class AlignmentParameters(Section):
    """The scene frame and the metric scale, from AprilTags."""

    pixel_tolerance: float = Field(
        1.5, gt=0, description="[pixels] Maximum reprojection error of a detected tag corner; others are outliers."
    )
    least_views: int = Field(3, ge=2, description="Minimum number of photos in which a tag corner must be an inlier.")
    least_tags: int = Field(
        2,
        ge=1,
        description="Minimum number of tags that must be located. With a single tag, camera positions were measured to "
        "be off by 1.5 mm.",
    )
    largest_residual: float = Field(
        0.003,
        gt=0,
        description="[m] Maximum root-mean-square distance between the located tag corners and those of tags.yaml.",
    )


class SweepParameters(Section):
    """Depth maps by plane sweep, and the points on which they agree."""

    planes: int = Field(
        128, ge=8, le=1024, description="Depths tried per pixel, between the near and far end of the object's box."
    )
    window: int = Field(
        7, ge=3, le=31, description="[pixels] Edge length of the windows that are correlated; an odd number."
    )
    neighbours: int = Field(6, ge=1, le=20, description="Maximum number of other photos each photo is compared with.")
    baseline_degrees: float = Field(
        16.0, gt=0, le=60, description="[degrees] Preferred angle between the views of two compared photos."
    )
    least_correlation: float = Field(
        0.6, ge=0, le=1, description="Minimum correlation of a match; depths with a lower one are discarded."
    )
    agreement: float = Field(
        0.002, gt=0, description="[m] Maximum difference between the depths of two photos that agree."
    )
    least_agreeing: int = Field(2, ge=1, description="Minimum number of other photos that must agree with a point.")
    voxel: float = Field(0.001, gt=0, description="[m] Edge length of the voxels in which points are averaged.")


class SurfaceParameters(Section):
    """The closed surface of each object, and the samples of it."""

    margin: float = Field(0.015, ge=0, le=0.1, description="[m] Margin added to every side of an object's box.")
    clearance: float = Field(
        0.003, ge=0, description="[m] Height above the support up to which points count as the support."
    )
    poisson_depth: int = Field(8, ge=4, le=11, description="Octree depth of the Poisson surface reconstruction.")
    least_points: int = Field(
        500, ge=10, description="Minimum number of points in an object's box for the object to be found."
    )
    least_seen: float = Field(
        0.35,
        ge=0,
        le=1,
        description="Minimum share of the surface within 3 mm of measured points; an object of which less "
        "was measured is refused.",
    )
    points: int = Field(
        4096,
        ge=256,
        le=65536,
        description="Points sampled on each reconstructed surface, as prepare.surface_points on a mesh.",
    )


class SplatParameters(Section):
    """2D Gaussian splatting, initialised from the points of the plane sweep."""

    device: str = Field("cpu", description="Device for the splatting, such as cpu or cuda:0.")
    iterations: int = Field(240, ge=1, description="Optimiser steps per object, each on one photo.")
    spacing: float = Field(0.002, gt=0, description="[m] Distance between neighbouring initial splats.")
    image_scale: float = Field(0.5, gt=0, le=1, description="Factor by which the photos are shrunk for the splatting.")
    weight_distortion: float = Field(
        10.0, ge=0, description="Weight of the depth-distortion loss. Paper of 2DGS: 100, or 10 for unbounded scenes."
    )
    weight_normal: float = Field(0.05, ge=0, description="Weight of the normal-consistency loss. Paper of 2DGS: 0.05.")
    weight_prior: float = Field(
        0.05, ge=0, description="Weight of the loss on the capture's normal maps, if it has any; 0 ignores them."
    )
    cell: float = Field(
        0.0015, gt=0, description="[m] Cell size of the distance field in which the rendered depths are fused."
    )


class ReconstructParameters(Section):
    """Settings of the reconstruction, the same for all captures."""

    method: Literal["plane_sweep", "2dgs"] = Field(
        "plane_sweep", description="Method of dense reconstruction. Paper: 2dgs."
    )
    largest_side: int = Field(
        1600,
        ge=64,
        le=20000,
        description="[pixels] Maximum width or height of a photo. Larger photos are shrunk by the smallest "
        "integer that "
        "makes them fit. Time and memory grow with the number of pixels.",
    )
    sparse: SparseParameters
    alignment: AlignmentParameters
    sweep: SweepParameters
    surface: SurfaceParameters
    splat: SplatParameters
