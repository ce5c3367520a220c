"""Convex parts of a solid, the collision shape of physics (CoACD; Wei et al., 2022)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from pipeline.compute.guard import CallLost, guarded
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.shapes.frame import as_saved
from pipeline.shapes.mass import solid_properties

HULL_TOLERANCE = 2e-5  # m; a part stops gaining vertices when nothing sticks out further

MEGABYTES = 6000  # that CoACD may take

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]


@dataclass(frozen=True)
class Way:
    """One way to ask CoACD for parts."""

    said: str
    threshold: float  # of the setting
    preprocessing: str  # CoACD's own remeshing
    cpu_seconds: int


# Tried in this order. Its search aborts or does not end on slivers that its remeshing, or a coarser goal, avoids.
WAYS = (
    Way("", 1.0, "auto", 60),
    Way("found with its own remeshing of the solid", 1.0, "on", 40),
    Way("found with twice the concavity threshold", 2.0, "auto", 20),
)


def convex_hull(points: NDArray[np.float64]) -> Mesh:
    """Return vertices and outward faces of the convex hull of ``points`` (n, 3)."""
    hull = ConvexHull(points)
    used = hull.vertices
    index = np.full(len(points), -1)
    index[used] = np.arange(len(used))
    faces = index[hull.simplices]
    vertices = points[used]
    a, b, c = vertices[faces].transpose(1, 0, 2)
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces.astype(np.int64)


def reduced_hull(points: NDArray[np.float64], most_vertices: int) -> tuple[Mesh, float]:
    """Return a convex hull with few vertices, and how far (m) the full hull sticks out of it.

    Begins with the extreme points of the axes and adds, one at a time, the vertex that sticks out furthest. All
    vertices are vertices of the full hull, so the result never sticks out itself.
    """
    full, _ = convex_hull(points)
    if len(full) <= most_vertices:
        return convex_hull(full), 0.0
    directions = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z])
    axes_first = directions[np.argsort(np.abs(directions).sum(axis=1), kind="stable")]
    chosen = list(dict.fromkeys(int(i) for i in (full @ axes_first.T).argmax(axis=0)))[: max(most_vertices, 4)]
    hull = ConvexHull(full[chosen], incremental=True)
    while True:
        outside = (full @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
        outside[chosen] = -np.inf
        furthest = int(outside.argmax())
        if len(chosen) >= most_vertices or outside[furthest] < HULL_TOLERANCE:
            break
        chosen.append(furthest)
        hull.add_points(full[[furthest]])
    return convex_hull(full[sorted(chosen)]), float(max(outside[furthest], 0.0))


def _decomposed(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], parameters: PrepareParameters, way: Way
) -> list[Mesh]:
    # CoACD's native library breaks a later import of Open3D in the same process (std::bad_cast), so that one is first.
    import open3d  # noqa: F401  # isort: skip
    import coacd

    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(vertices, faces.astype(np.int32)),
        threshold=min(1.0, way.threshold * parameters.convex_threshold),
        preprocess_mode=way.preprocessing,
        max_convex_hull=parameters.convex_parts,
        mcts_iterations=60,
        mcts_nodes=15,
        mcts_max_depth=2,
        resolution=1000,
        seed=0,
    )
    return [(np.asarray(v, np.float64), np.asarray(f, np.int64)) for v, f in parts]


def _pieces(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], parameters: PrepareParameters
) -> tuple[list[Mesh], str]:
    """Return what CoACD makes of a solid, and what had to be done differently; an empty list if it fails every way."""
    hows = []
    for way in WAYS:
        try:
            pieces = guarded(
                _decomposed, vertices, faces, parameters, way, cpu_seconds=way.cpu_seconds, megabytes=MEGABYTES
            )
        except CallLost as lost:
            hows.append(str(lost))
        except RuntimeError as error:  # whatever the library throws
            hows.append(" ".join(str(error).split())[:80])
        else:
            usable = [piece for piece in pieces if len(piece[0]) >= 4]
            if usable:
                return usable, f"CoACD {hows[0]}; {way.said}" if hows else ""
            hows.append("found no part")
    return [], f"CoACD {hows[0]}; its convex hull stands for the object in physics"


def convex_parts(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], parameters: PrepareParameters
) -> tuple[list[Mesh], float, str]:
    """Return convex parts that together are the solid.

    A solid that fills its convex hull well enough (``parameters.hull_excess``) is one part. Vertices are rounded as
    they are saved.

    Returns:
        The parts, the largest distance (m) that a reduced part lost, and a remark if CoACD could not do it as set.
    """
    hull = convex_hull(vertices)
    volume = solid_properties(vertices, faces)[0]
    pieces: list[Mesh] = []
    remark = ""
    if solid_properties(*hull)[0] > (1 + parameters.hull_excess) * volume:
        pieces, remark = _pieces(vertices, faces, parameters)
    parts, lost = [], 0.0
    for piece, _ in pieces or [hull]:
        (part_vertices, part_faces), gap = reduced_hull(as_saved(piece), parameters.part_vertices)
        parts.append((part_vertices, part_faces))
        lost = max(lost, gap)
    return parts, lost, remark
