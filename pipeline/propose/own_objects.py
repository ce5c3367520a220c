"""Objects from files of the user's own: meshes, or point clouds, in metres and standing as they will be grasped."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import QhullError

from pipeline.compute.guard import CallLost, guarded
from pipeline.propose.clouds import KINDS, cleaned, read_cloud
from pipeline.records.errors import UserError
from pipeline.records.geometry import FORMATS, read_geometry_file
from pipeline.records.objects import PreparedObject
from pipeline.shapes.solids import object_of_solid

SMALLEST, LARGEST = 0.01, 0.4  # m, longest extent that a hand has to do with; outside, the unit is taken to be wrong
LEAST_POINTS = 64
READING_SECONDS, READING_MEGABYTES = 60, 4000  # that reading a file may take


def load_own_object(source: Path) -> tuple[PreparedObject, NDArray[np.float64], NDArray[np.float64]]:
    """Read one object.

    Returns:
        The object in a frame whose origin is its centre, the points (n, 3) that the model is to see, in the same frame,
        and that centre (3,) in the frame of the file.

    Raises:
        UserError: the file is missing or of no known kind, holds no or too few points, points that are no numbers, or
            is of a size that no hand can grasp.
    """
    points, mesh = _read(source)
    if mesh is None:
        cloud = cleaned(points, str(source))
        points = cloud.points
        if cloud.dropped and len(points) >= LEAST_POINTS:
            print(f"{source}: left out {' and '.join(cloud.dropped)}; {len(points)} points are used.", file=sys.stderr)
        if len(points) < LEAST_POINTS:
            without = f" without {' and '.join(cloud.dropped)}" if cloud.dropped else ""
            raise UserError(
                f"{source} holds {len(points)} points{without}; give at least {LEAST_POINTS}, all around the object."
            )
    elif not np.isfinite(points).all():
        raise UserError(f"{source} holds coordinates that are not numbers (NaN or infinite); remove those points.")
    if len(points) < 4:
        raise UserError(f"{source} holds {len(points)} corners; give a mesh all around the object.")
    longest = float(np.ptp(points, axis=0).max())
    if not SMALLEST <= longest <= LARGEST:
        raise UserError(
            f"{source} is {longest:.4g} long, taken as metres; objects of {SMALLEST} to {LARGEST} m can be grasped, so "
            "scale it to metres."
        )
    if mesh is None or not mesh.is_watertight:
        if mesh is not None:
            print(f"{source} is not closed: its convex hull stands for it.", file=sys.stderr)

        try:
            solid = trimesh.convex.convex_hull(points)
        except QhullError as error:
            raise UserError(f"{source} is flat; give points all around the object.") from error
    else:
        solid = mesh
    if not abs(solid.volume) > 1e-9:
        raise UserError(f"{source} is flat; give points all around the object.")
    if solid.volume < 0:
        solid.invert()
    centre = np.asarray(solid.center_mass, np.float64)
    solid.apply_translation(-centre)
    prepared = object_of_solid(source.stem, solid)
    seen = prepared.surface_points if mesh is not None else points - centre
    return prepared, seen, centre


def _read(source: Path) -> tuple[NDArray[np.float64], trimesh.Trimesh | None]:  # type: ignore[name-defined] # noqa: F821
    """Return points (n, 3) and the mesh that they are corners of, if there is one."""
    if not source.is_file():
        raise UserError(
            f"{source} is missing; name a mesh ({', '.join(f'.{kind}' for kind in FORMATS)}) or a cloud "
            f"(.ply, {', '.join(KINDS)})."
        )
    try:
        if source.suffix.lower() in KINDS:
            return guarded(
                read_cloud, source.absolute(), cpu_seconds=READING_SECONDS, megabytes=READING_MEGABYTES
            ), None
        loaded = guarded(
            read_geometry_file, source.absolute(), True, cpu_seconds=READING_SECONDS, megabytes=READING_MEGABYTES
        )
    except (CallLost, OSError, ValueError) as error:
        said = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise UserError(f"{source} cannot be read as a mesh or a point cloud: {said}.") from error
    points = np.asarray(loaded.vertices, np.float64).reshape(-1, 3)
    return points, loaded if isinstance(loaded, trimesh.Trimesh) and len(loaded.faces) else None
