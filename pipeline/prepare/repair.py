"""One closed solid out of whatever triangles came in, or one sentence about why that cannot be.

The ladder: checks; merge of equal vertices, removal of degenerate and duplicate faces; outward normals; small holes
filled; union of all components (Manifold); and only where that fails a solid from the winding number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import manifold3d
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.prepare.bodies import chosen_bodies
from pipeline.prepare.walls import thickened
from pipeline.prepare.winding import winding_surface
from pipeline.records.errors import UserError
from pipeline.shapes.rays import ray_scene

LARGEST_EXTENT = 2.0  # m; nothing that a hand holds is larger, so the unit must be wrong
SMALLEST_EXTENT = 0.002  # m
THINNEST = 1e-3  # smallest over largest extent; below, the shape is a sheet
EXTENT_CHANGE = 0.02  # of the largest extent; a repair that changes more has invented a shape
COINCIDENT = 1e-7  # of the largest extent
NEARLY_COINCIDENT = 1e-5  # of the largest extent; for vertices of open edges, where a seam is likelier than a slit
MOST_FACES = 50_000  # finer meshes are simplified: no later step sees a difference, all take longer
SIMPLIFICATION = (2e-5, 5e-5, 1e-4, 2e-4)  # m, tolerances that are tried in turn
FIN = 0.25  # of the whole area; a larger patch is no sheet that hangs on the surface but the surface
FLAT = 1e-3  # a patch that encloses less than this times its area to the power 3/2 (a ball: 0.13) is flat
WRAP_CELLS = 96  # on the longest axis, for the solid from the winding number
WRAP_LOSS = 0.02  # of the largest extent; the surface may not lie further outside of that solid


@dataclass(frozen=True)
class Solid:
    """A closed, outward-oriented surface of one body."""

    vertices: NDArray[np.float64]  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3)
    repairs: tuple[str, ...]  # what was changed, in order
    open_in_file: bool = False  # whether the surface had open edges


def check_raw(vertices: NDArray[np.float64], faces: NDArray[np.int64], name: str) -> None:
    """Refuse what no repair can make a solid of.

    Raises:
        UserError: empty, not finite, wrong unit, or flat.
    """
    where = f"{name}:"
    if len(vertices) == 0 or len(faces) == 0:
        raise UserError(f"{where} the mesh is empty; export the shape again.")
    used = vertices[np.unique(faces)]
    broken = int((~np.isfinite(used).all(axis=1)).sum())
    if broken:
        raise UserError(f"{where} {broken} of {len(used)} vertices are NaN or infinite; export the shape again.")
    extents = np.ptp(used, axis=0)
    largest = float(extents.max())
    if largest > LARGEST_EXTENT:
        unit = "cm" if largest <= 25 else "mm"
        if largest > 1000 * LARGEST_EXTENT:
            raise UserError(f"{where} the largest extent is {largest:.4g} m; correct `unit` or `scale`.")
        raise UserError(f"{where} the largest extent is {largest:.4g} m: looks like {unit}, set `unit: {unit}`.")
    if largest < SMALLEST_EXTENT:
        raise UserError(f"{where} the largest extent is only {1000 * largest:.3g} mm; correct `unit` or `scale`.")
    if extents.min() < THINNEST * largest:
        raise UserError(
            f"{where} the shape is a sheet without thickness (extents {_millimetres(extents)} mm); model it as a solid."
        )


def _millimetres(extents: NDArray[np.float64]) -> str:
    return " x ".join(f"{1000 * extent:.1f}" for extent in extents)


def _grouped(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Group equal rows (n, k): index of the first of each group, group of each row, size of each group.

    What ``np.unique(axis=0)`` returns, in the same order and many times faster.
    """
    order = np.lexsort(rows.T[::-1])
    in_order = rows[order]
    begins = np.ones(len(rows), bool)
    begins[1:] = (in_order[1:] != in_order[:-1]).any(axis=1)
    group = np.empty(len(rows), np.int64)
    group[order] = np.cumsum(begins) - 1
    return order[begins], group, np.bincount(group)


def _edges(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the directed edges (3 F, 2), three of each face in turn."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def _edge_uses(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many faces use each undirected edge."""
    return _grouped(np.sort(_edges(faces), axis=1))[2]


def _without_flaps(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Drop faces with equal corners, repeated faces, and pairs of equal faces back to back, which enclose nothing.

    Where the file is drawn double-sided, or repeated faces were turned, one face of each pair stays: whichever of the
    two leaves fewer edges that are not shared by two faces.
    """
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    order = np.argsort(faces, axis=1)
    # Odd permutations of the sorted corners are faces turned the other way.
    turned = np.where(
        np.isin(order @ np.array([9, 3, 1]), [0 * 9 + 2 * 3 + 1, 1 * 9 + 0 * 3 + 2, 2 * 9 + 1 * 3]), -1, 1
    )
    first, group, uses = _grouped(np.sort(faces, axis=1))
    back_to_back = np.bincount(group, weights=turned, minlength=len(uses)).astype(int) == 0
    without, with_one = (faces[np.sort(first[kept])] for kept in (~back_to_back, np.ones(len(uses), bool)))
    bad_without, bad_with_one = (int((_edge_uses(kept) != 2).sum()) for kept in (without, with_one))
    return without if bad_without <= bad_with_one and len(without) else with_one


def _oriented(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return faces turned so that neighbours agree and each connected surface encloses a positive volume.

    Every face is a pair of nodes, one for each way to turn it; neighbours link the ways that agree. A connected
    surface that can be oriented gives two components of that graph, of which the one that turns fewer faces is taken.
    """
    count = len(faces)
    edges = _edges(faces)
    low_first = edges[:, 0] < edges[:, 1]
    _, group, uses = _grouped(np.sort(edges, axis=1))
    shared = np.flatnonzero(uses[group] == 2)
    one, other = shared[np.argsort(group[shared], kind="stable")].reshape(-1, 2).T
    disagree = (low_first[one] == low_first[other]).astype(np.int64)
    f, g = one // 3, other // 3
    rows, columns = np.concatenate([f, f + count]), np.concatenate([g + disagree * count, g + (1 - disagree) * count])
    graph = coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(2 * count, 2 * count))
    label = connected_components(graph, directed=False)[1]
    as_is, turned = label[:count], label[count:]
    kept = np.bincount(as_is, minlength=2 * count)
    turn = kept[turned] > kept[as_is]
    turn |= (kept[turned] == kept[as_is]) & (turned < as_is)
    surface = np.minimum(as_is, turned)
    faces = np.where(turn[:, None], faces[:, ::-1], faces)
    return np.where((_enclosed(vertices, faces, surface) < 0)[surface][:, None], faces[:, ::-1], faces)


def _enclosed(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], surface: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return six times the signed volume between each connected surface and its middle.

    A flat patch encloses nothing: there it is the volume up to the middle of the whole shape, so that a patch of a
    torn surface counts as outward when it looks away from that middle; 0 where it looks past it.
    """
    corners = vertices[faces]
    sizes = np.maximum(np.bincount(surface), 1)
    middle = np.stack([np.bincount(surface, weights=corners[:, :, axis].mean(axis=1)) for axis in range(3)], axis=1)
    own = np.bincount(surface, weights=np.linalg.det(corners - (middle / sizes[:, None])[surface][:, None]))
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    common = np.bincount(surface, weights=np.linalg.det(corners - (low + high) / 2))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.bincount(surface, weights=np.linalg.norm(normals, axis=1))
    flat, aside = (np.abs(volume) < FLAT * areas**1.5 for volume in (own, common))
    return np.where(flat, np.where(aside, 0.0, common), own)


def _without_fins(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Drop sheets that hang on the surface: patches between edges of three or more faces that also have open edges.

    The winding number changes by one across such a sheet, which would carve a slit along it.
    """
    _, group, uses = _grouped(np.sort(_edges(faces), axis=1))
    of_edge = uses[group].reshape(-1, 3)
    if not ((of_edge == 1).any() and (of_edge > 2).any()):
        return faces
    shared = np.flatnonzero(uses[group] == 2)
    one, other = shared[np.argsort(group[shared], kind="stable")].reshape(-1, 2).T // 3
    graph = coo_matrix((np.ones(len(one), np.int8), (one, other)), shape=(len(faces), len(faces)))
    count, patch = connected_components(graph, directed=False)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area = np.bincount(patch, weights=np.linalg.norm(np.cross(b - a, c - a), axis=1), minlength=count)
    is_open, joins = np.zeros(count, bool), np.zeros(count, bool)
    is_open[patch[(of_edge == 1).any(axis=1)]] = True
    joins[patch[(of_edge > 2).any(axis=1)]] = True
    fin = is_open & joins & (area < FIN * area.sum())
    return faces[~fin[patch]]


def _merged(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], repairs: list[str]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Merge coincident vertices everywhere, and vertices of open edges that are nearly coincident."""
    largest = float(np.ptp(vertices[np.unique(faces)], axis=0).max())
    cells = np.round(vertices / (COINCIDENT * largest)).astype(np.int64)
    first, index, _ = _grouped(cells)
    vertices, faces = vertices[first], index[faces]
    count = len(cells) - len(first)
    edges = np.sort(_edges(_without_flaps(faces)), axis=1)
    _, group, uses = _grouped(edges)
    seam = np.unique(edges[uses[group] == 1])
    pairs = cKDTree(vertices[seam]).query_pairs(NEARLY_COINCIDENT * largest, output_type="ndarray") if len(seam) else []
    if len(pairs):
        one, other = seam[pairs].T
        graph = coo_matrix((np.ones(len(one), np.int8), (one, other)), shape=(len(vertices), len(vertices)))
        label = connected_components(graph, directed=False)[1]
        first, index, _ = _grouped(label[:, None].astype(np.int64))
        count += len(vertices) - len(first)
        vertices, faces = vertices[first], index[faces]
    if count:
        repairs.append(f"merged {count} coincident vertices")
    return vertices, faces


def _cleaned(vertices: NDArray[np.float64], faces: NDArray[np.int64], repairs: list[str], fill: bool = True) -> Any:
    """Merge, drop, orient and, if wanted, fill holes; the result is a trimesh that may still be open."""
    vertices, faces = _merged(vertices, faces, repairs)
    kept = _without_flaps(faces)
    if len(kept) < len(faces):
        repairs.append(f"removed {len(faces) - len(kept)} degenerate or duplicate faces")
    without_fins = _without_fins(vertices, kept)
    if len(without_fins) < len(kept):
        repairs.append(f"removed {len(kept) - len(without_fins)} faces of sheets that hang on the surface")
        kept = without_fins
    oriented = _oriented(vertices, kept)
    if not np.array_equal(oriented, kept):
        repairs.append("turned faces outward")
    mesh = trimesh.Trimesh(vertices, oriented, process=False)
    mesh.remove_unreferenced_vertices()
    holes = int((_edge_uses(np.asarray(mesh.faces)) == 1).sum())
    if holes and fill:
        trimesh.repair.fill_holes(mesh)
        left = int((_edge_uses(np.asarray(mesh.faces)) == 1).sum())
        if left < holes:
            repairs.append(f"filled holes along {holes - left} open edges")
        mesh.faces = _oriented(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    return mesh


def _as_manifold(mesh: Any) -> Any | None:
    """Return the Manifold of a closed mesh, or None when it is not one."""
    manifold = manifold3d.Manifold(
        manifold3d.Mesh64(np.array(mesh.vertices, np.float64, order="C"), np.array(mesh.faces, np.uint64, order="C"))
    )
    return manifold if manifold.status() == manifold3d.Error.NoError and manifold.num_tri() > 0 else None


def _united(manifold: Any, repairs: list[str]) -> Any:
    """Union of all components, each taken as filled."""
    pieces = manifold.decompose()
    if len(pieces) == 1:
        return manifold
    filled = []
    for piece in pieces:
        if piece.volume() < 0:
            part = piece.to_mesh64()
            turned = np.array(part.tri_verts[:, ::-1], order="C")
            corners = np.array(part.vert_properties[:, :3], order="C")
            piece = manifold3d.Manifold(manifold3d.Mesh64(corners, turned))
        filled.append(piece)
    repairs.append(f"united {len(pieces)} closed surfaces (cavities are filled)")
    return manifold3d.Manifold.batch_boolean(filled, manifold3d.OpType.Add)


def _wrapped(mesh: Any) -> Any | None:
    """Return a Manifold around everything whose winding number is at least one half."""
    vertices, faces = winding_surface(np.asarray(mesh.vertices), np.asarray(mesh.faces), WRAP_CELLS)
    if len(faces) == 0:
        return None
    wrapped = _as_manifold(trimesh.Trimesh(vertices, faces, process=False))
    if wrapped is None:
        return None
    assert isinstance(wrapped, manifold3d.Manifold)
    return wrapped.simplify(float(mesh.extents.max()) / WRAP_CELLS / 8)


def _lost_depth(mesh: Any, solid: Any) -> float:
    """Return how far (m) the surface of ``mesh`` lies outside of ``solid`` at most; sheets inside do not count."""
    result = solid.to_mesh64()
    scene = ray_scene((np.asarray(result.vert_properties)[:, :3], np.asarray(result.tri_verts)))
    points = np.concatenate([mesh.vertices, mesh.triangles_center]).astype(np.float32)
    return float(scene.compute_signed_distance(points, nthreads=1, nsamples=3).numpy().max())


def _simplified(body: Any, repairs: list[str]) -> Any:
    """Return a body of at most ``MOST_FACES`` faces if a small enough change of its surface gives one.

    Manifold keeps the surface closed and its tolerance nearly; how far the old vertices lie from the new surface is
    measured.
    """
    before = body.num_tri()
    if before <= MOST_FACES:
        return body
    for tolerance in SIMPLIFICATION:
        simpler = body.simplify(tolerance)
        if simpler.num_tri() <= MOST_FACES:
            break
    result = simpler.to_mesh64()
    scene = ray_scene((np.asarray(result.vert_properties)[:, :3], np.asarray(result.tri_verts)))
    points = np.asarray(body.to_mesh64().vert_properties)[:, :3].astype(np.float32)
    moved = 1000 * float(scene.compute_distance(points, nthreads=1).numpy().max())
    repairs.append(f"simplified {before} to {simpler.num_tri()} faces (the surface moved by at most {moved:.3f} mm)")
    return simpler


@dataclass(frozen=True)
class Wishes:
    """What the user has decided about a mesh that can be understood in several ways."""

    bodies: str | int = "refuse"  # see :func:`pipeline.prepare.bodies.chosen_bodies`
    wall: float | None = None  # m, of a surface without thickness
    rebuild: bool = False  # the surface passes through itself: take what its winding number encloses


def repair(vertices: NDArray[np.float64], faces: NDArray[np.int64], name: str, wishes: Wishes | None = None) -> Solid:
    """Return one closed solid.

    Args:
        vertices: (V, 3), m.
        faces: (F, 3) in any orientation.
        name: the object's name, for error messages.

    Raises:
        UserError: no single solid can be made of the mesh.
    """
    wishes = wishes or Wishes()
    check_raw(vertices, faces, name)
    used, index = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], index.reshape(faces.shape)
    repairs: list[str] = []
    mesh = _cleaned(vertices, faces, repairs, fill=wishes.wall is None)
    before = np.ptp(vertices[np.unique(faces)], axis=0)
    if wishes.wall is not None:
        solid, before = _walled(mesh, wishes.wall, repairs, name), before + wishes.wall
    else:
        solid = _closed(mesh, wishes.rebuild, repairs, name)
    box = np.array(solid.bounding_box())
    after = box[3:] - box[:3]
    if np.abs(after - before).max() > EXTENT_CHANGE * before.max() + (wishes.wall or 0.0):
        raise UserError(
            f"{name}: closing the mesh changes its extents from {_millimetres(before)} to "
            f"{_millimetres(after)} mm; mend it in a modeller."
        )
    result = _simplified(chosen_bodies(solid, wishes.bodies, repairs, name), repairs).to_mesh64()
    out_vertices = np.asarray(result.vert_properties, np.float64)[:, :3]
    out_faces = np.asarray(result.tri_verts).astype(np.int64)
    return Solid(out_vertices, out_faces, tuple(repairs), open_in_file=_is_open(mesh) or _filled(repairs))


def _closed(mesh: Any, rebuild: bool, repairs: list[str], name: str) -> Any:
    """Return the Manifold that a mesh is the surface of, or encloses for the most part."""
    manifold = None if rebuild else _as_manifold(mesh)
    solid = None if manifold is None else _united(manifold, repairs)
    if solid is not None and solid.num_tri():
        return solid
    open_edges = int((_edge_uses(np.asarray(mesh.faces)) != 2).sum())
    solid = _wrapped(mesh)
    if solid is None:
        raise UserError(f"{name}: the mesh cannot be closed ({open_edges} bad edges); mend it in a modeller.")
    if _lost_depth(mesh, solid) > WRAP_LOSS * mesh.extents.max():
        raise UserError(f"{name}: closing the mesh ({open_edges} bad edges) loses a part of it; mend it in a modeller.")
    why = "its surface passes through itself" if rebuild else f"{open_edges} bad edges"
    repairs.append(f"rebuilt as the solid where the winding number is over one half ({why})")
    return solid


def _walled(mesh: Any, wall: float, repairs: list[str], name: str) -> Any:
    """Return the Manifold of an open surface with a wall."""
    if not _is_open(mesh):
        raise UserError(f"{name}: `wall` is for a surface without thickness, but this mesh is closed; remove it.")
    solid = _as_manifold(trimesh.Trimesh(*thickened(mesh.vertices, mesh.faces, wall, name), process=False))
    if solid is None:
        raise UserError(f"{name}: no wall of {1000 * wall:g} mm can be put around the mesh; mend it in a modeller.")
    repairs.append(f"given a wall of {1000 * wall:g} mm")
    return solid.simplify(wall / 40)


def _is_open(mesh: Any) -> bool:
    return bool((_edge_uses(np.asarray(mesh.faces)) == 1).any())


def _filled(repairs: list[str]) -> bool:
    return any(repair.startswith("filled holes") for repair in repairs)
