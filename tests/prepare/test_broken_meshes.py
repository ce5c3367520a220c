"""Properties of the repair: a broken variant of a good mesh becomes the good solid, or is refused with one sentence.

What the solid must be comes from the good mesh: volume, extents, and the distance between the two surfaces.
"""

import re
from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, Phase, event, example, given, settings
from hypothesis import strategies as st

from pipeline.prepare import repair as repair_module
from pipeline.prepare.repair import repair
from pipeline.records.errors import UserError
from pipeline.shapes.rays import ray_scene

Mesh = tuple[np.ndarray, np.ndarray]
CELLS = 48  # of the wrap, which follows a surface to about one cell
EXACT = 1e-4  # of the largest extent; and of the volume


def _l_shape() -> trimesh.Trimesh:
    low = trimesh.creation.box((0.06, 0.04, 0.03))
    high = trimesh.creation.box(
        (0.03, 0.04, 0.07), transform=trimesh.transformations.translation_matrix([0.015, 0, 0.02])
    )
    return trimesh.boolean.union([low, high], engine="manifold")


GOOD = {
    "box": trimesh.creation.box((0.04, 0.05, 0.06)).subdivide().subdivide(),
    "ball": trimesh.creation.icosphere(3, 0.03),
    "cylinder": trimesh.creation.cylinder(0.02, 0.1, sections=48).subdivide(),
    "l": _l_shape().subdivide().subdivide(),
    "ring": trimesh.creation.torus(0.03, 0.012, major_sections=48, minor_sections=24),
}


def size(mesh: Mesh) -> float:
    return float(np.ptp(mesh[0][np.unique(mesh[1])], axis=0).max())


def flip(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    vertices, faces = mesh
    chosen = random.random(len(faces)) < share
    return vertices, np.where(chosen[:, None], faces[:, ::-1], faces)


def flip_all(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    return mesh[0], mesh[1][:, ::-1]


def duplicate(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    vertices, faces = mesh
    return vertices, np.concatenate([faces, np.roll(faces[random.random(len(faces)) < share], 1, axis=1)])


def unmerge(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    vertices, faces = mesh
    apart = vertices[faces].reshape(-1, 3)
    return apart + random.uniform(-1, 1, apart.shape) * 1e-6 * size(mesh) * share, np.arange(len(apart)).reshape(-1, 3)


def degenerate(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    vertices, faces = mesh
    corner, other = random.choice(np.unique(faces), size=(2, 5))
    return vertices, np.concatenate([faces, np.stack([corner, corner, other], axis=1)])


def shuffle(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    vertices, faces = mesh
    order = random.permutation(len(vertices))
    place = np.argsort(order)
    return vertices[order], place[faces[random.permutation(len(faces))]]


def stray_vertices(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    """Vertices that no face uses, some of them not even numbers."""
    far = random.uniform(-9, 9, (4, 3))
    far[0] = np.nan
    return np.concatenate([mesh[0], far]), mesh[1]


def inner_surface(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    """A closed surface inside of the material, turned outward or inward: a cavity, or faces left over."""
    vertices, faces = mesh
    triangle = vertices[faces[0]]
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    inside = triangle.mean(axis=0) - 0.006 * normal / np.linalg.norm(normal)
    ball = trimesh.creation.icosphere(1, 0.003)
    added = ball.faces if share < 0.5 else ball.faces[:, ::-1]
    return np.concatenate([vertices, ball.vertices + inside]), np.concatenate([faces, added + len(vertices)])


def speck(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    vertices, faces = mesh
    dust = trimesh.creation.box((0.0005, 0.0005, 0.0005))
    low, high = (getattr(vertices[np.unique(faces)], end)(axis=0) for end in ("min", "max"))
    place = low + 0.5 * (high - low) * [1, 0, 1] - [0, 0.0006, 0]
    return np.concatenate([vertices, dust.vertices + place]), np.concatenate([faces, dust.faces + len(vertices)])


def far_away(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    return mesh[0] + [123.0, -45.0, 6.0], mesh[1]


def jitter(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    vertices, faces = mesh
    return vertices + random.uniform(-1, 1, vertices.shape) * 1e-3 * share * size(mesh), faces


def delete(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    vertices, faces = mesh
    return vertices, faces[random.random(len(faces)) > 0.05 * share]


def flaps(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    """Sheets inside that hang on edges of the surface: edges with three faces."""
    vertices, faces = mesh
    centre = vertices[np.unique(faces)].mean(axis=0)
    some = faces[random.integers(len(faces), size=3)]
    fan = np.column_stack([some[:, :2], np.full(3, len(vertices))])
    return np.concatenate([vertices, [centre]]), np.concatenate([faces, fan])


def not_a_number(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    vertices = mesh[0].copy()
    vertices[mesh[1][random.integers(len(mesh[1])), 0], random.integers(3)] = random.choice([np.nan, np.inf])
    return vertices, mesh[1]


def second_body(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    vertices, faces = mesh
    moved = vertices + [1.5 * size(mesh), 0, 0]
    return np.concatenate([vertices, moved]), np.concatenate([faces, faces + len(vertices)])


def wrong_unit(mesh: Mesh, share: float, random: np.random.Generator) -> Mesh:
    return mesh[0] * (1e3 if share < 0.5 else 1e-3), mesh[1]


# These lose nothing: the solid comes out as it was. (A vertex pushed by 1e-6 may move that far.)
LOSSLESS = [flip, flip_all, duplicate, unmerge, degenerate, shuffle, stray_vertices, inner_surface, speck, far_away]
# These lose something: the solid comes out nearly as it was, or not at all.
LOSSY = [jitter, delete, flaps]
HOPELESS = [not_a_number, second_body, wrong_unit]

Defect = tuple[Callable[[Mesh, float, np.random.Generator], Mesh], float]
shares = st.floats(0.01, 1.0)
some_lossless = st.lists(st.tuples(st.sampled_from(LOSSLESS), shares), min_size=1, max_size=4)
thorough = settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    phases=(Phase.explicit, Phase.reuse, Phase.generate, Phase.shrink),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.fixture(autouse=True)
def coarse_wrap(monkeypatch):
    monkeypatch.setattr(repair_module, "WRAP_LOSS", 1.5 / CELLS)
    monkeypatch.setattr(repair_module, "WRAP_CELLS", CELLS)


def broken(name: str, defects: list[Defect], seed: int) -> Mesh:
    mesh = np.asarray(GOOD[name].vertices), np.asarray(GOOD[name].faces)
    random = np.random.default_rng(seed)
    # What lies inside is placed while the faces still tell which side that is.
    for defect, share in sorted(defects, key=lambda one: one[0] is not inner_surface):
        mesh = defect(mesh, share, random)
    return mesh


def distance_between(one: Mesh, other: Mesh) -> float:
    """Largest distance of surface points of each mesh to the other, m."""
    found = 0.0
    for (vertices, faces), (to_vertices, to_faces) in ((one, other), (other, one)):
        points = np.concatenate([vertices, vertices[faces].mean(axis=1)]).astype(np.float32)
        found = max(found, float(ray_scene((to_vertices, to_faces)).compute_distance(points).numpy().max()))
    return found


def assert_is_the_good_solid(name: str, solid: repair_module.Solid, tolerance: float, offset: np.ndarray) -> None:
    """``tolerance`` is of the largest extent, and of the volume thrice that."""
    good = GOOD[name]
    mesh = trimesh.Trimesh(solid.vertices - offset, solid.faces, process=False)
    largest = good.extents.max()
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(good.volume, rel=3 * tolerance)
    np.testing.assert_allclose(mesh.extents, good.extents, atol=2 * tolerance * largest)
    mesh_arrays, good_arrays = (
        (np.asarray(mesh.vertices), solid.faces),
        (np.asarray(good.vertices), np.asarray(good.faces)),
    )
    assert distance_between(mesh_arrays, good_arrays) < tolerance * largest + 1e-8


def offset_of(defects: list[Defect]) -> np.ndarray:
    return sum(1 for defect, _ in defects if defect is far_away) * np.array([123.0, -45.0, 6.0])


@example("ball", [(unmerge, 1.0), (duplicate, 1.0)], 0)
@example("ball", [(duplicate, 1.0), (flip, 0.5)], 0)
@thorough
@given(st.sampled_from(sorted(GOOD)), some_lossless, st.integers(0, 999))
def test_defects_that_lose_nothing_give_the_good_solid(name, defects, seed):
    solid = repair(*broken(name, defects, seed), "thing")
    assert_is_the_good_solid(name, solid, EXACT, offset_of(defects))


@example("cylinder", flaps, 1.0, [(duplicate, 1.0)], 108)
@thorough
@given(st.sampled_from(sorted(GOOD)), st.sampled_from(LOSSY), shares, some_lossless, st.integers(0, 999))
def test_defects_that_lose_something_give_nearly_the_good_solid_or_a_sentence(name, lossy, share, others, seed):
    defects = [*others, (lossy, share)]
    try:
        solid = repair(*broken(name, defects, seed), "thing")
    except UserError as error:
        event("refused")
        assert str(error).startswith("thing: ") and "\n" not in str(error)
    else:
        event("repaired")
        assert_is_the_good_solid(name, solid, 1.5 / CELLS, offset_of(defects))


@thorough
@given(st.sampled_from(sorted(GOOD)), st.sampled_from(HOPELESS), shares, some_lossless, st.integers(0, 999))
def test_what_cannot_be_mended_is_one_sentence(name, hopeless, share, others, seed):
    with pytest.raises(UserError, match="^thing: [^\n]+$"):
        repair(*broken(name, [*others, (hopeless, share)], seed), "thing")


def test_a_fine_mesh_is_simplified_within_the_distance_that_is_said():
    """A torus of 180 000 faces with ripples."""
    ring = trimesh.creation.torus(0.03, 0.012, major_sections=300, minor_sections=300)
    ripples = 1 + 0.01 * np.sin(300 * ring.vertices[:, :1])
    fine = np.asarray(ring.vertices) * ripples, np.asarray(ring.faces)
    solid = repair(*fine, "thing")
    (said,) = solid.repairs
    found = re.fullmatch(r"simplified 180000 to (\d+) faces \(the surface moved by at most ([\d.]+) mm\)", said)
    assert found and int(found[1]) == len(solid.faces) <= repair_module.MOST_FACES
    assert float(found[2]) <= 0.2
    # Measured at vertices there; here also in the middle of the faces, and from either surface to the other.
    assert distance_between((solid.vertices, solid.faces), fine) < 1.25 * 0.001 * float(found[2])
    mesh = trimesh.Trimesh(solid.vertices, solid.faces, process=False)
    assert mesh.is_watertight and mesh.euler_number == 0
    assert mesh.volume == pytest.approx(trimesh.Trimesh(*fine, process=False).volume, rel=2e-3)
