import numpy as np
import pytest

from pipeline.reconstruct.accuracy import compare
from pipeline.reconstruct.fusion import Points
from pipeline.reconstruct.surface import Surface, belongs_to, poisson_surface, samples_of
from pipeline.reconstruct.visibility import Bodies
from pipeline.records.captures import Scene
from pipeline.records.errors import UserError
from pipeline.records.parameters import read_parameters

trimesh = pytest.importorskip("trimesh")


@pytest.fixture(scope="module")
def settings():
    return read_parameters().reconstruct.surface.model_copy(update={"poisson_depth": 7})


def seen_points(mesh, lowest: float, noise: float = 0.0001) -> Points:
    """Points of a mesh above a height, as cameras above it would see them."""
    points, face = trimesh.sample.sample_surface(mesh, 20000, seed=0)
    normals = mesh.face_normals[face]
    kept = (points[:, 2] > lowest) & (normals[:, 2] > -0.5)
    random = np.random.default_rng(0)
    return Points(points[kept] + noise * random.standard_normal((kept.sum(), 3)), normals[kept], 0.0)


def true_surface(mesh) -> Surface:
    return Surface(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64))


def test_a_can_is_closed_flat_at_the_support(settings):
    can = trimesh.creation.cylinder(radius=0.03, height=0.08, sections=128)
    can.apply_translation([0.1, 0.05, 0.04])
    found = poisson_surface(seen_points(can, 0.003), 0.0, 0.001, settings, "can")
    mesh = trimesh.Trimesh(found.vertices, found.faces, process=False)
    assert mesh.is_watertight and mesh.volume == pytest.approx(can.volume, rel=0.02)
    assert found.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    base = mesh.area_faces[(np.abs(mesh.triangles[:, :, 2]) < 1e-9).all(axis=1)].sum()
    assert base == pytest.approx(np.pi * 0.03**2, rel=0.1)
    accuracy = compare(found, true_surface(can))
    assert accuracy.chamfer < 0.0003 and accuracy.f_score > 0.99


def test_a_ball_gets_a_round_underside(settings):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.027)
    ball.apply_translation([0, 0, 0.027])
    found = poisson_surface(seen_points(ball, 0.015), 0.0, 0.001, settings, "ball")
    mesh = trimesh.Trimesh(found.vertices, found.faces, process=False)
    assert mesh.is_watertight and mesh.volume == pytest.approx(ball.volume, rel=0.05)
    assert compare(found, true_surface(ball)).chamfer < 0.0006


def test_samples_say_what_was_seen(settings):
    can = trimesh.creation.cylinder(radius=0.03, height=0.08, sections=128)
    can.apply_translation([0, 0, 0.04])
    points = seen_points(can, 0.003)
    samples = samples_of(true_surface(can), points.positions, 1024, seed=1)
    assert samples.points.shape == (1024, 3) and np.allclose(np.linalg.norm(samples.normals, axis=1), 1)
    middle_of_base = (samples.points[:, 2] < 1e-4) & (np.linalg.norm(samples.points[:, :2], axis=1) < 0.025)
    assert middle_of_base.any() and not samples.seen[middle_of_base].any()
    assert samples.seen[samples.points[:, 2] > 0.006].all()
    # Farthest points: spread evenly, so no two are close.
    from scipy.spatial import cKDTree

    nearest = cKDTree(samples.points).query(samples.points, k=2)[0][:, 1]
    assert nearest.min() > 0.4 * np.sqrt(can.area / 1024)


def test_too_few_points_are_one_sentence(settings):
    points = Points(np.random.default_rng(0).random((50, 3)), np.tile([0, 0, 1.0], (50, 1)), 0.0)
    with pytest.raises(UserError, match="mug: only 50 surface points"):
        poisson_surface(points, 0.0, 0.001, settings, "mug")


def test_touching_objects_share_the_space_between_them(settings):
    scene = Scene.model_validate(
        {
            "objects": {
                "left": {"position": [-0.03, 0], "box": [0.06, 0.06, 0.08]},
                "right": {"position": [0.03, 0], "box": [0.06, 0.06, 0.08]},
            }
        }
    )
    points = np.array([[-0.002, 0, 0.04], [0.002, 0, 0.04], [-0.07, 0, 0.04], [0.2, 0, 0.04], [0.03, 0, 0.001]])
    assert belongs_to(points, scene, settings).tolist() == [0, 1, 0, -1, -1]


def test_depth_is_measured_along_the_given_ray():
    box = trimesh.creation.box((1, 1, 1))
    surface = true_surface(box)
    rays = np.array([[0, 0, 1.0], [0, 0, 2.0], [1, 0, 0], [0.05, 0, 1.0]])
    near = true_surface(trimesh.creation.box((0.02, 0.02, 0.02)).apply_translation([0.1, 0, -2.0]))
    bodies = Bodies([surface, near])
    depth, normals = bodies.depth(0, np.array([0, 0, -3.0]), rays, 80.0)
    assert depth.tolist() == pytest.approx([2.5, 1.25, 0, 2.5])
    assert np.allclose(normals[0], [0, 0, -1])
    hidden, _ = bodies.depth(0, np.array([0.1, 0, -3.0]), rays[:1], 80.0)
    assert hidden.tolist() == [0]
    points, outward = np.array([[0.1, 0, -0.5], [0.4, 0, -0.5]]), np.tile(np.float32([0, 0, -1]), (2, 1))
    assert bodies.seen_from(np.array([0.1, 0, -3.0]), points, outward).tolist() == [False, True]
    assert not bodies.seen_from(np.array([0.1, 0, 3.0]), points, outward).any()


def test_distances_between_shifted_boxes_are_the_shift():
    box = trimesh.creation.box((0.05, 0.05, 0.05))
    larger = trimesh.creation.box((0.052, 0.052, 0.052))
    accuracy = compare(true_surface(larger), true_surface(box))
    assert accuracy.accuracy == pytest.approx(0.001, rel=0.05)
    assert accuracy.completeness == pytest.approx(0.001, rel=0.01)
    assert accuracy.f_score == 1
