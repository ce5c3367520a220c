"""Objects from files of the user's own: meshes, or point clouds, in metres and standing as they will be grasped."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject

SMALLEST, LARGEST = 0.01, 0.4  # m, longest extent that a hand has to do with; outside, the unit is taken to be wrong
LEAST_POINTS = 64
SURFACE_POINTS = 4096
CELLS = 96  # of the distance grid, along its longest axis
PADDING = 0.02  # m of grid around the object
DENSITY = 500.0  # kg/m3, as in the physics of the pipeline


def load_own_object(source: Path) -> tuple[PreparedObject, NDArray[np.float64], NDArray[np.float64]]:
    """Read one object.

    Returns:
        The object in a frame whose origin is its centre, the points (n, 3) that the model is to see, in the same frame,
        and that centre (3,) in the frame of the file.

    Raises:
        UserError: the file is missing or of no known kind, holds no or too few points, points that are no numbers, or
            is of a size that no hand can grasp.
    """
    import trimesh

    points, mesh = _read(source)
    if not np.isfinite(points).all():
        raise UserError(f"{source} holds coordinates that are not numbers (NaN or infinite); remove those points.")
    if len(points) < (4 if mesh is not None else LEAST_POINTS):
        raise UserError(f"{source} holds {len(points)} points; give at least {LEAST_POINTS}, all around the object.")
    longest = float(np.ptp(points, axis=0).max())
    if not SMALLEST <= longest <= LARGEST:
        raise UserError(
            f"{source} is {longest:.4g} long, taken as metres; objects of {SMALLEST} to {LARGEST} m can be grasped, so "
            "scale it to metres."
        )
    if mesh is None or not mesh.is_watertight:
        if mesh is not None:
            print(f"{source} is not closed: its convex hull stands for it.", file=sys.stderr)
        from scipy.spatial import QhullError

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
    prepared = _prepared(source.stem, solid)
    seen = prepared.surface_points if mesh is not None else points - centre
    return prepared, seen, centre


def _read(source: Path) -> tuple[NDArray[np.float64], trimesh.Trimesh | None]:  # type: ignore[name-defined] # noqa: F821
    """Return points (n, 3) and the mesh that they are corners of, if there is one."""
    import trimesh

    if not source.is_file():
        raise UserError(f"{source} is missing; name a mesh (.ply, .stl, .obj, .off, .glb) or a cloud (.ply, .npy).")
    try:
        if source.suffix == ".npy":
            points = np.asarray(np.load(source, allow_pickle=False), np.float64)
            if points.ndim != 2 or points.shape[1] < 3:
                raise UserError(f"{source} has the shape {points.shape}; a cloud is an array of n x 3 metres.")
            return points[:, :3], None
        loaded: Any = trimesh.load(source, process=True)
        if isinstance(loaded, trimesh.Scene):
            loaded = loaded.to_mesh() if loaded.geometry else trimesh.Trimesh()
    except UserError:
        raise
    except Exception as error:  # every format has its own
        raise UserError(f"{source} cannot be read as a mesh or a point cloud ({type(error).__name__}).") from error
    points = np.asarray(loaded.vertices, np.float64).reshape(-1, 3)
    return points, loaded if isinstance(loaded, trimesh.Trimesh) and len(loaded.faces) else None


def _prepared(name: str, solid: trimesh.Trimesh) -> PreparedObject:  # type: ignore[name-defined] # noqa: F821
    """Return a closed mesh, centred, with what the energy and physics need of it; its hull is its collision shape."""
    import open3d as o3d
    import trimesh

    low, high = solid.bounds[0] - PADDING, solid.bounds[1] + PADDING
    spacing = float((high - low).max() / (CELLS - 1))
    axes = [low[k] + spacing * np.arange(int(np.ceil((high - low)[k] / spacing)) + 1) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).astype(np.float32)
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor(np.asarray(solid.vertices, np.float32)), o3d.core.Tensor(np.asarray(solid.faces, np.uint32))
    )
    distance = scene.compute_signed_distance(o3d.core.Tensor(grid), nthreads=1).numpy()
    points, owners = trimesh.sample.sample_surface(solid, SURFACE_POINTS, seed=0)
    hull = solid.convex_hull
    return PreparedObject(
        name=name,
        vertices=np.asarray(solid.vertices, np.float64),
        faces=np.asarray(solid.faces, np.int64),
        parts=((np.asarray(hull.vertices, np.float64), np.asarray(hull.faces, np.int64)),),
        distance=distance.astype(np.float32),
        distance_origin=np.asarray(low, np.float64),
        distance_spacing=spacing,
        surface_points=np.asarray(points, np.float64),
        surface_normals=np.asarray(solid.face_normals[owners], np.float64),
        mass=DENSITY * float(solid.volume),
        inertia=DENSITY * np.asarray(solid.moment_inertia, np.float64),
        volume=float(solid.volume),
        extents=np.asarray(solid.extents, np.float64),
        provenance={},
    )
