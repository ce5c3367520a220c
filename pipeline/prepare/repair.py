"""One closed solid out of whatever triangles came in, or one sentence about why that cannot be.

The ladder: checks; merge of equal vertices, removal of degenerate and duplicate faces; outward normals; small holes
filled; union of all components (Manifold); and only where that fails a solid from the winding number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError

LARGEST_EXTENT = 2.0  # m; nothing that a hand holds is larger, so the unit must be wrong
SMALLEST_EXTENT = 0.002  # m
THINNEST = 1e-3  # smallest over largest extent; below, the shape is a sheet
SPECK = 1e-3  # of the volume; smaller separate bodies are scan noise
EXTENT_CHANGE = 0.02  # of the largest extent; a repair that changes more has invented a shape
WRAP_CELLS = 96  # on the longest axis, for the solid from the winding number


@dataclass(frozen=True)
class Solid:
    """A closed, outward-oriented surface of one body."""

    vertices: NDArray[np.float64]  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3)
    repairs: tuple[str, ...]  # what was changed, in order


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


def _edge_uses(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many faces use each undirected edge."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def _without_flaps(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Drop faces with equal corners, repeated faces, and pairs of equal faces back to back, which enclose nothing.

    Where most faces come in such pairs the file is drawn double-sided; then one face of each pair stays.
    """
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    order = np.argsort(faces, axis=1)
    # Odd permutations of the sorted corners are faces turned the other way.
    turned = np.where(
        np.isin(order @ np.array([9, 3, 1]), [0 * 9 + 2 * 3 + 1, 1 * 9 + 0 * 3 + 2, 2 * 9 + 1 * 3]), -1, 1
    )
    _, first, group, uses = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    back_to_back = np.bincount(group.reshape(-1), weights=turned, minlength=len(uses)).astype(int) == 0
    if back_to_back.sum() > len(uses) / 2:
        back_to_back[:] = False
    return faces[np.sort(first[~back_to_back])]


def _cleaned(vertices: NDArray[np.float64], faces: NDArray[np.int64], repairs: list[str]) -> Any:
    """Merge, drop, orient and fill; the result is a trimesh that may still be open."""
    import trimesh

    tolerance = 1e-7 * float(np.ptp(vertices[np.unique(faces)], axis=0).max())
    cells = np.round(vertices / tolerance).astype(np.int64)
    _, first, index = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    faces = index.reshape(-1)[faces]
    vertices = vertices[first]
    if len(first) < len(cells):
        repairs.append(f"merged {len(cells) - len(first)} coincident vertices")
    kept = _without_flaps(faces)
    if len(kept) < len(faces):
        repairs.append(f"removed {len(faces) - len(kept)} degenerate or duplicate faces")
    mesh = trimesh.Trimesh(vertices, kept, process=False)
    mesh.remove_unreferenced_vertices()
    before = mesh.faces.copy()
    trimesh.repair.fix_winding(mesh)
    trimesh.repair.fix_inversion(mesh, multibody=True)
    if not np.array_equal(before, mesh.faces):
        repairs.append("turned faces outward")
    holes = int((_edge_uses(np.asarray(mesh.faces)) == 1).sum())
    if holes:
        trimesh.repair.fill_holes(mesh)
        left = int((_edge_uses(np.asarray(mesh.faces)) == 1).sum())
        if left < holes:
            repairs.append(f"filled holes along {holes - left} open edges")
        trimesh.repair.fix_inversion(mesh, multibody=True)
    return mesh


def _as_manifold(mesh: Any) -> Any | None:
    """Return the Manifold of a closed mesh, or None when it is not one."""
    import manifold3d

    manifold = manifold3d.Manifold(
        manifold3d.Mesh64(np.array(mesh.vertices, np.float64, order="C"), np.array(mesh.faces, np.uint64, order="C"))
    )
    return manifold if manifold.status() == manifold3d.Error.NoError and manifold.num_tri() > 0 else None


def _united(manifold: Any, repairs: list[str]) -> Any:
    """Union of all components, each taken as filled."""
    import manifold3d

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


def _single_body(manifold: Any, repairs: list[str], name: str) -> Any:
    """Return the one body, without specks.

    Raises:
        UserError: there are several bodies of notable size.
    """
    # A filled body has positive volume; a negative one would be a cavity that union left, which it never does.
    bodies = sorted(manifold.decompose(), key=lambda body: -body.volume())
    large = [body for body in bodies if body.volume() > SPECK * manifold.volume()]
    if len(large) > 1:
        raise UserError(f"{name}: the mesh holds {len(large)} separate bodies; keep one, or join them in the file.")
    if not large:
        raise UserError(f"{name}: the mesh encloses no volume; model it as a solid.")
    if len(bodies) > 1:
        repairs.append(f"dropped {len(bodies) - 1} specks below {SPECK:.1%} of the volume")
    return large[0]


def _wrapped(mesh: Any) -> Any | None:
    """Return a Manifold around everything whose winding number is at least one half."""
    import manifold3d
    import trimesh

    from pipeline.prepare.winding import winding_surface

    vertices, faces = winding_surface(np.asarray(mesh.vertices), np.asarray(mesh.faces), WRAP_CELLS)
    if len(faces) == 0:
        return None
    wrapped = _as_manifold(trimesh.Trimesh(vertices, faces, process=False))
    if wrapped is None:
        return None
    assert isinstance(wrapped, manifold3d.Manifold)
    return wrapped.simplify(float(mesh.extents.max()) / WRAP_CELLS / 8)


def repair(vertices: NDArray[np.float64], faces: NDArray[np.int64], name: str) -> Solid:
    """Return one closed solid.

    Args:
        vertices: (V, 3), m.
        faces: (F, 3) in any orientation.
        name: the object's name, for error messages.

    Raises:
        UserError: no single solid can be made of the mesh.
    """
    check_raw(vertices, faces, name)
    repairs: list[str] = []
    mesh = _cleaned(vertices, faces, repairs)
    manifold = _as_manifold(mesh)
    solid = None if manifold is None else _united(manifold, repairs)
    if solid is None or solid.num_tri() == 0:
        open_edges = int((_edge_uses(np.asarray(mesh.faces)) != 2).sum())
        solid = _wrapped(mesh)
        if solid is None:
            raise UserError(f"{name}: the mesh cannot be closed ({open_edges} bad edges); mend it in a modeller.")
        repairs.append(f"rebuilt as the solid where the winding number is over one half ({open_edges} bad edges)")
    box = np.array(solid.bounding_box())
    before, after = np.ptp(vertices[np.unique(faces)], axis=0), box[3:] - box[:3]
    if np.abs(after - before).max() > EXTENT_CHANGE * before.max():
        raise UserError(
            f"{name}: closing the mesh changes its extents from {_millimetres(before)} to "
            f"{_millimetres(after)} mm; mend it in a modeller."
        )
    result = _single_body(solid, repairs, name).to_mesh64()
    out_vertices = np.asarray(result.vert_properties, np.float64)[:, :3]
    out_faces = np.asarray(result.tri_verts).astype(np.int64)
    return Solid(out_vertices, out_faces, tuple(repairs))
