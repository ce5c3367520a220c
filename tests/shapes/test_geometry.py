"""Mass, frame, distances, samples and stance against closed forms."""

import numpy as np
import pytest
import trimesh

from pipeline.prepare.recipes import CYLINDER_SEGMENTS, box_mesh, cylinder_mesh
from pipeline.prepare.resting import stable_poses, stance
from pipeline.prepare.sources import check_source
from pipeline.records.errors import UserError
from pipeline.records.parameters.objects import ObjectParameters
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.shapes.convex_parts import convex_hull, convex_parts, reduced_hull
from pipeline.shapes.distance_grid import distance_grid, signed_distances
from pipeline.shapes.frame import ROTATIONS, canonical_vertices
from pipeline.shapes.mass import solid_properties
from pipeline.shapes.samples import area_samples, farthest_point_order, surface_samples

BOX = (0.04, 0.05, 0.06)


def box_distance(points: np.ndarray, extents: np.ndarray) -> np.ndarray:
    """Exact signed distance to a box at the origin."""
    beyond = np.abs(points) - np.asarray(extents) / 2
    return np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0)


def test_inertia_is_about_the_centre_wherever_the_box_lies() -> None:
    vertices, faces = box_mesh(BOX)
    volume, centre, inertia = solid_properties(vertices + [0.3, -0.2, 0.1], faces)
    x, y, z = BOX
    assert volume == pytest.approx(x * y * z)
    np.testing.assert_allclose(centre, [0.3, -0.2, 0.1], atol=1e-12)
    expected = volume / 12 * np.diag([y**2 + z**2, x**2 + z**2, x**2 + y**2])
    np.testing.assert_allclose(inertia, expected, atol=1e-9 * expected.max())


def test_cylinder_recipe_is_a_regular_prism_of_exact_extents() -> None:
    vertices, faces = cylinder_mesh((0.057, 0.057, 0.105))
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.057, 0.057, 0.105], rtol=1e-12)
    volume, _, inertia = solid_properties(vertices, faces)
    n, r, h = CYLINDER_SEGMENTS, 0.0285, 0.105
    area = n / 2 * r**2 * np.sin(2 * np.pi / n)
    assert volume == pytest.approx(area * h, rel=1e-7)
    # Polar second moment of a regular polygon: A r^2 / 6 (2 + cos(2 pi / n)).
    assert inertia[2, 2] == pytest.approx(h * area * r**2 / 6 * (2 + np.cos(2 * np.pi / n)), rel=1e-7)
    assert trimesh.Trimesh(vertices, faces, process=False).is_watertight


@pytest.mark.parametrize("up", list(ROTATIONS))
def test_declared_axis_points_up_and_the_centre_of_mass_is_the_origin(up: str) -> None:
    axis = np.zeros(3)
    axis["xyz".index(up[1])] = 1 if up[0] == "+" else -1
    np.testing.assert_allclose(ROTATIONS[up] @ axis, [0, 0, 1])
    assert np.linalg.det(ROTATIONS[up]) == pytest.approx(1.0)
    cone = trimesh.creation.cone(0.03, 0.08, sections=32)
    vertices = canonical_vertices(np.asarray(cone.vertices) + 0.5, np.asarray(cone.faces), up)
    _, centre, _ = solid_properties(vertices, np.asarray(cone.faces))
    np.testing.assert_allclose(centre, 0, atol=1e-8)
    assert np.array_equal(vertices, vertices.astype(np.float32))


def test_distance_to_a_box_is_exact() -> None:
    vertices, faces = box_mesh(BOX)
    points = np.random.default_rng(0).uniform(-0.06, 0.06, (4000, 3))
    np.testing.assert_allclose(signed_distances(vertices, faces, points), box_distance(points, BOX), atol=2e-7)


def test_grid_covers_the_object_and_its_margin() -> None:
    vertices, faces = box_mesh(BOX)
    grid = distance_grid(vertices, faces, cells=32, padding=0.02)
    shape = np.array(grid.values.shape)
    assert shape.max() == 32
    assert grid.values.dtype == np.float32
    assert np.all(grid.origin <= -np.array(BOX) / 2 - 0.02 + 1e-12)
    assert np.all(grid.origin + grid.spacing * (shape - 1) >= np.array(BOX) / 2 + 0.02 - 1e-12)


def test_farthest_point_order_is_greedy() -> None:
    points = np.random.default_rng(1).normal(size=(300, 3))
    order = farthest_point_order(points, 40)
    for index in range(1, 40):
        nearest = np.linalg.norm(points[:, None] - points[order[:index]], axis=2).min(axis=1)
        assert nearest[order[index]] == pytest.approx(nearest.max(), rel=1e-5)


def test_raw_samples_share_the_area_evenly() -> None:
    vertices, faces = box_mesh((0.02, 0.04, 0.08))
    points, face = area_samples(vertices, faces, 14000, np.random.default_rng(0))
    areas = trimesh.Trimesh(vertices, faces, process=False).area_faces
    np.testing.assert_allclose(np.bincount(face, minlength=12), 14000 * areas / areas.sum(), atol=1.01)
    np.testing.assert_allclose(box_distance(points, np.array([0.02, 0.04, 0.08])), 0, atol=1e-12)


def test_surface_samples_lie_on_the_surface_with_its_normals() -> None:
    vertices, faces = box_mesh(BOX)
    samples = surface_samples(vertices, faces, 500, np.random.default_rng(0)).astype(np.float64)
    points, normals = samples[:, :3], samples[:, 3:]
    np.testing.assert_allclose(box_distance(points, BOX), 0, atol=1e-8)
    # One step along the normal is one step away from the box.
    np.testing.assert_allclose(box_distance(points + 0.001 * normals, BOX), 0.001, atol=1e-8)
    distances = np.linalg.norm(points[:, None] - points[None], axis=2) + np.eye(500)
    area = 2 * (BOX[0] * BOX[1] + BOX[1] * BOX[2] + BOX[0] * BOX[2])
    # Spacing of a hexagonal packing, the densest; farthest-point samples reach well over half of it.
    assert distances.min() > 0.55 * np.sqrt(2 * area / (500 * np.sqrt(3)))


def test_stance_of_a_box_and_of_a_cone_on_its_tip() -> None:
    vertices, _ = box_mesh((0.042, 0.042, 0.042))
    standing = stance(vertices)
    assert standing.margin == pytest.approx(0.021)
    assert np.degrees(standing.tip_angle) == pytest.approx(45)
    cone = trimesh.creation.cone(0.03, 0.08, sections=32)
    on_tip = canonical_vertices(np.asarray(cone.vertices), np.asarray(cone.faces), "-z")
    assert stance(on_tip).margin <= 0


def test_box_rests_on_six_sides() -> None:
    vertices, _ = box_mesh((0.042, 0.042, 0.042))
    poses = stable_poses(vertices)
    assert len(poses) == 6
    assert [pose["probability"] for pose in poses] == pytest.approx([1 / 6] * 6, abs=1e-3)


def test_reduced_hull_stays_inside_and_reports_its_loss() -> None:
    points = np.asarray(trimesh.creation.icosphere(4, 0.03).vertices)
    (vertices, faces), lost = reduced_hull(points, 100)
    assert len(vertices) == 100
    assert {tuple(v) for v in vertices} <= {tuple(p) for p in points}
    hull = trimesh.Trimesh(vertices, faces, process=False)
    assert hull.is_watertight and hull.volume > 0
    outside = ((points[:, None] - hull.triangles_center) * hull.face_normals).sum(axis=2).max(axis=1)
    assert lost == pytest.approx(outside.max(), rel=1e-6)
    # The best n points on a sphere, in equilateral triangles, lose a share of sqrt(3) pi / n of its volume.
    share = 1 - hull.volume / solid_properties(*convex_hull(points))[0]
    assert share < 1.2 * np.sqrt(3) * np.pi / 100


def test_two_joined_boxes_are_two_convex_parts() -> None:
    """An L of two bars: its hull is far larger, the parts together are the L."""
    foot = trimesh.creation.box((0.08, 0.03, 0.02))
    post = trimesh.creation.box(
        (0.02, 0.03, 0.06), transform=trimesh.transformations.translation_matrix([0.03, 0, 0.03])
    )
    solid = trimesh.boolean.union([foot, post], engine="manifold")
    parts, _, _ = convex_parts(np.asarray(solid.vertices), np.asarray(solid.faces), PrepareParameters())
    assert len(parts) == 2
    union = trimesh.boolean.union([trimesh.Trimesh(*part) for part in parts], engine="manifold")
    assert union.volume == pytest.approx(solid.volume, rel=0.03)


def test_unknown_scan_is_refused_with_a_hint() -> None:
    with pytest.raises(UserError, match="018_plum"):
        check_source(ObjectParameters(ycb="18_plum"), "thing")
