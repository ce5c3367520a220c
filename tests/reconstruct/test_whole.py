"""Whole reconstructions of small rendered captures, good ones and hard ones: a good result, or one clear sentence.

The bars are for 16 views of 480 x 360 pixels; the demo capture (24 views, 960 x 720) is held to the tighter ones of
docs/metrics.md by `benchmarks/reconstruction.py`.
"""

import shutil

import numpy as np
import pytest
from PIL import Image

from pipeline.records.captures import read_capture, read_truth
from pipeline.records.errors import UserError
from pipeline.records.parameters import read_parameters
from tests.reconstruct.made_up import PLACES, rendered

pytestmark = pytest.mark.slow


def figures(folder, **changes):
    """Reconstruct a capture and return its metrics, and what was found."""
    from pipeline.reconstruct.reconstruction import metrics_of, reconstruct

    settings = read_parameters().reconstruct
    splat = settings.splat.model_copy(update={"iterations": 100, "image_scale": 1.0, "spacing": 0.0025})
    settings = settings.model_copy(update={"splat": splat, **changes})
    result = reconstruct(read_capture(folder), settings, seed=1, workers=0)
    return metrics_of(result, settings.method, read_truth(folder)), result


def test_a_plain_capture(capture_folder):
    import open3d
    import trimesh

    metrics, result = figures(capture_folder)
    assert metrics["registered_ratio"] == 1 and metrics["kind"] == "rendered" and metrics["normal_prior"] == "none"
    assert metrics["reprojection_px"] < 0.5 and metrics["alignment_mm"] < 0.6
    assert metrics["chamfer_mm_max"] < 0.8
    for name, item in result.objects.items():
        # Samples lie on the mesh, in a frame whose origin is the centre of mass.
        mesh = trimesh.Trimesh(item.vertices, item.faces, process=False)
        assert mesh.is_watertight and np.abs(mesh.center_mass).max() < 1e-4
        scene = open3d.t.geometry.RaycastingScene()
        scene.add_triangles(
            open3d.core.Tensor(item.vertices.astype(np.float32)), open3d.core.Tensor(item.faces.astype(np.uint32))
        )
        query = open3d.core.Tensor(item.points.astype(np.float32))
        distance = scene.compute_distance(query).numpy()
        assert np.median(distance) < 1e-7 and distance.max() < 1e-4  # slivers cost the query some accuracy
        placed = item.T_scene_object[:3, 3]
        assert np.linalg.norm(placed[:2] - PLACES[name]["position"]) < 0.001


def test_splatting_from_the_same_start(capture_folder):
    metrics, _ = figures(capture_folder, method="2dgs")
    assert metrics["method"] == "2dgs"
    assert metrics["chamfer_mm_max"] < 1.0


def test_normal_maps_are_used_and_recorded(capture_folder, tmp_path):
    """True normals, made for this test only, stand for any program's output."""
    from pipeline.reconstruct.splatting import read_normals

    folder = shutil.copytree(capture_folder, tmp_path / "normals")
    (folder / "normals").mkdir()
    for path in read_capture(folder).images:
        up = np.zeros((360, 480, 3), np.float32)
        up[..., 2] = -1
        np.save(folder / f"normals/{path.stem}.npy", up)
    assert read_normals(folder / "normals/photo_000.npy").shape == (360, 480, 3)
    np.save(folder / "normals/photo_000.npy", np.zeros((10, 10, 3), np.float32))
    with pytest.raises(UserError, match="normal map of photo_000 has 10 x 10 pixels"):
        figures(folder, method="2dgs")


def test_twelve_views(tmp_path):
    metrics, _ = figures(rendered(tmp_path / "few", views=12))
    assert metrics["registered_ratio"] == 1 and metrics["chamfer_mm_max"] < 1.5


def test_a_camera_like_a_phone_s(tmp_path):
    folder = rendered(
        tmp_path / "phone",
        distortion=(-0.1, 0.03, 0.0005, -0.0005),
        blur=0.5,
        motion_blur=1.0,
        noise=0.015,
        exposure=0.15,
        gloss=0.1,
        jpeg_quality=88,
    )
    metrics, _ = figures(folder)
    assert metrics["registered_ratio"] == 1 and metrics["chamfer_mm_max"] < 1.5


@pytest.mark.parametrize("texture", [0.15, 0.0])
def test_low_texture(tmp_path, texture):
    folder = rendered(tmp_path / "plain", texture=texture)
    try:
        metrics, _ = figures(folder)
    except UserError as error:
        assert "texture" in str(error) and "\n" not in str(error)
    else:
        assert metrics["chamfer_mm_max"] < 1.5


def test_an_object_moved_between_the_photos(capture_folder, tmp_path):
    places = {**PLACES, "can": {"position": (0.06, 0.045), "yaw_degrees": 0.0}}
    moved = rendered(tmp_path / "moved", objects=places)
    for view in range(8):
        shutil.copy(capture_folder / f"images/photo_{view:03d}.jpg", moved / "images")
    with pytest.raises(UserError, match="can was moved between the photos"):
        figures(moved)


def test_mixed_resolutions_and_orientations(capture_folder, tmp_path):
    folder = shutil.copytree(capture_folder, tmp_path / "mixed")
    for view in range(0, 16, 2):
        path = folder / f"images/photo_{view:03d}.jpg"
        with Image.open(path) as picture:
            if view % 4:
                picture.resize((400, 300), Image.Resampling.LANCZOS).save(path, quality=95)
            else:
                exif = picture.getexif()
                exif[0x0112] = 8  # stored turned
                picture.transpose(Image.Transpose.ROTATE_270).save(path, exif=exif, quality=95)
    metrics, _ = figures(folder)
    assert metrics["registered_ratio"] == 1 and metrics["chamfer_mm_max"] < 1.0


def test_touching_objects(tmp_path):
    places = {
        "block": {"position": (-0.03, 0.0), "yaw_degrees": 0.0},
        "can": {"position": (0.03, 0.0), "yaw_degrees": 0.0},
    }
    metrics, _ = figures(rendered(tmp_path / "touching", objects=places))
    assert metrics["chamfer_mm_max"] < 1.5


def test_photos_of_something_else(capture_folder, tmp_path):
    folder = shutil.copytree(capture_folder, tmp_path / "else")
    random = np.random.default_rng(0)
    for view in range(16):
        Image.fromarray(random.integers(0, 255, (360, 480), dtype=np.uint8)).save(
            folder / f"images/photo_{view:03d}.jpg"
        )
    with pytest.raises(UserError, match="no photo shows a tag"):
        figures(folder)
