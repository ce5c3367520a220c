"""Broken meshes become the solid that was meant, or are refused with a sentence that names the trouble."""

import numpy as np
import pytest
import trimesh

from pipeline.prepare import repair as repair_module
from pipeline.prepare.repair import repair
from pipeline.records.errors import UserError

BOX = (0.04, 0.05, 0.06)
BOX_VOLUME = 120e-6


def box(extents=BOX, centre=(0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    return trimesh.creation.box(extents, transform=trimesh.transformations.translation_matrix(centre))


def sphere() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(3, 0.03)


def inverted() -> trimesh.Trimesh:
    mesh = box()
    mesh.invert()
    return mesh


def mixed_winding() -> trimesh.Trimesh:
    mesh = box().subdivide()
    faces = mesh.faces.copy()
    faces[::3] = faces[::3, ::-1]
    return trimesh.Trimesh(mesh.vertices, faces, process=False)


def missing_side() -> trimesh.Trimesh:
    mesh = box()
    mesh.update_faces(mesh.face_normals[:, 2] < 0.9)
    return mesh


def unmerged() -> trimesh.Trimesh:
    mesh = box()
    return trimesh.Trimesh(mesh.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)


def double_sided() -> trimesh.Trimesh:
    mesh = box()
    return trimesh.Trimesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, ::-1]]), process=False)


def flap() -> trimesh.Trimesh:
    """Two equal faces back to back, hanging on an edge: they enclose nothing."""
    mesh = box()
    faces = np.concatenate([mesh.faces, [[0, 1, 8], [8, 1, 0]]])
    return trimesh.Trimesh(np.concatenate([mesh.vertices, [[0.01, 0.0, 0.0]]]), faces, process=False)


def hollow() -> trimesh.Trimesh:
    inside = box((0.02, 0.02, 0.02))
    inside.invert()
    return trimesh.util.concatenate([box(), inside])


def speck() -> trimesh.Trimesh:
    return trimesh.util.concatenate([box(), box((0.002, 0.002, 0.002), (0.0, 0.03, 0.0))])


def overlapping() -> trimesh.Trimesh:
    return trimesh.util.concatenate([box(), box(centre=(0.02, 0.01, 0.01))])


def touching() -> trimesh.Trimesh:
    return trimesh.util.concatenate([box(), box(centre=(0.04, 0.0, 0.0))])


def check_closed(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Return the volume after asserting that every edge is used once in each direction."""
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = {tuple(edge) for edge in edges.tolist()}
    assert len(forward) == len(edges)
    assert forward == {(b, a) for a, b in forward}
    return float(trimesh.Trimesh(vertices, faces, process=False).volume)


@pytest.mark.parametrize(
    ("mesh", "volume", "repaired"),
    [
        (box(), BOX_VOLUME, ""),
        (inverted(), BOX_VOLUME, "outward"),
        (mixed_winding(), BOX_VOLUME, "outward"),
        (missing_side(), BOX_VOLUME, "filled holes"),
        (unmerged(), BOX_VOLUME, "coincident"),
        (double_sided(), BOX_VOLUME, "duplicate"),
        (flap(), BOX_VOLUME, "duplicate"),
        (hollow(), BOX_VOLUME, "cavities are filled"),
        (speck(), BOX_VOLUME, "speck"),
        # Two boxes of 120 cm3 that share 20 x 40 x 50 mm = 40 cm3.
        (overlapping(), 200e-6, "united"),
        (touching(), 240e-6, "united"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_solid_is_the_one_that_was_meant(mesh: trimesh.Trimesh, volume: float, repaired: str) -> None:
    solid = repair(np.asarray(mesh.vertices), np.asarray(mesh.faces), "thing")
    assert check_closed(solid.vertices, solid.faces) == pytest.approx(volume, rel=1e-6)
    assert repaired in " ".join(solid.repairs)
    assert bool(solid.repairs) == bool(repaired)


def test_open_cup_becomes_a_solid_from_the_winding_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cup without lid has one large hole that no simple filling closes; the solid is the full cylinder."""
    monkeypatch.setattr(repair_module, "WRAP_CELLS", 40)
    cup = trimesh.creation.cylinder(0.03, 0.08, sections=48)
    volume = cup.volume
    cup.update_faces(cup.face_normals[:, 2] < 0.9)
    solid = repair(np.asarray(cup.vertices), np.asarray(cup.faces), "cup")
    assert check_closed(solid.vertices, solid.faces) == pytest.approx(volume, rel=0.03)
    np.testing.assert_allclose(np.ptp(solid.vertices, axis=0), [0.06, 0.06, 0.08], atol=0.0015)
    assert "winding number" in solid.repairs[-1]


def broken_vertex() -> trimesh.Trimesh:
    mesh = box()
    vertices = mesh.vertices.copy()
    vertices[3, 1] = np.nan
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


@pytest.mark.parametrize(
    ("mesh", "sentence"),
    [
        (broken_vertex(), "1 of 8 vertices are NaN"),
        (box((40, 50, 60)), "looks like mm, set `unit: mm`"),
        (box((4, 5, 6)), "looks like cm, set `unit: cm`"),
        (box((4e-5, 5e-5, 6e-5)), "only 0.06 mm"),
        (box((0.04, 0.05, 1e-6)), "without thickness"),
        (trimesh.util.concatenate([box(), box(centre=(0.1, 0, 0))]), "2 separate bodies"),
        (trimesh.util.concatenate([box(), box(centre=(0.04, 0.05, 0))]), "2 separate bodies"),  # share an edge only
        (trimesh.Trimesh(np.zeros((0, 3)), np.zeros((0, 3), int), process=False), "empty"),
    ],
)
def test_what_cannot_be_a_solid_is_refused(mesh: trimesh.Trimesh, sentence: str) -> None:
    with pytest.raises(UserError, match=sentence) as error:
        repair(np.asarray(mesh.vertices), np.asarray(mesh.faces), "thing")
    assert "thing" in str(error.value)
    assert str(error.value).endswith(".")


def test_repair_is_the_same_every_time() -> None:
    mesh = overlapping()
    first, second = (repair(np.asarray(mesh.vertices), np.asarray(mesh.faces), "thing") for _ in range(2))
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()
