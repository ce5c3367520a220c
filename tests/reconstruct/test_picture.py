"""Pictures for the report, and the files of a reconstruction."""

import io

import numpy as np
import pytest
from PIL import Image

from pipeline.reconstruct.dense import DenseObject
from pipeline.reconstruct.fusion import Points
from pipeline.reconstruct.picture import ASSUMED_COLOUR, COLOURS, surfaces_over
from pipeline.reconstruct.surface import Surface
from pipeline.reconstruct.views import View
from pipeline.records.errors import UserError
from pipeline.records.reconstructions import (
    ReconstructedObject,
    load_reconstructed_object,
    load_reconstruction_metrics,
    load_reconstruction_pictures,
    write_reconstruction,
)

trimesh = pytest.importorskip("trimesh")
RADIUS, DEPTH, FOCAL = 0.03, 0.5, 400.0


@pytest.fixture
def ball():
    """A ball in front of a camera at the origin that looks along +z; measured on its left half only."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS).apply_translation([0, 0, DEPTH])
    positions = np.asarray(mesh.vertices)[np.asarray(mesh.vertices)[:, 0] < 0]
    return DenseObject(
        Points(positions, positions, 0.0), Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces)), {}
    )


def test_surfaces_are_drawn_where_the_camera_sees_them(ball):
    photo = np.full((120, 160, 3), 100, np.uint8)
    K = np.array([[FOCAL, 0, 80], [0, FOCAL, 60], [0, 0, 1]])
    view = View("one", photo[..., 0].astype(np.float32) / 255, None, K, np.eye(4))
    picture = surfaces_over(photo, view, [ball], 80)
    assert picture.shape == (60, 80, 3)
    columns, rows = np.meshgrid(np.arange(80) + 0.5, np.arange(60) + 0.5)
    off = np.hypot(columns - 40, rows - 30)
    outline = FOCAL / 2 * RADIUS / np.sqrt(DEPTH**2 - RADIUS**2)  # of a ball, seen from DEPTH, at half the size
    drawn = np.ptp(picture.astype(int), axis=-1) > 10
    assert drawn[(off < outline - 1) & (columns < 38)].all() and not drawn[(off > outline + 1)].any()
    assert (picture[off > outline + 1] == round(100 + 0.7 * 155)).all()
    left, right = picture[30, 35] / COLOURS[0], picture[30, 48] / ASSUMED_COLOUR
    assert np.ptp(left) < 0.02 and np.ptp(right) < 0.02  # one brightness of the object's colour; of grey


def test_what_is_written_is_read_again(ball, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    points = np.arange(12.0).reshape(4, 3)
    item = ReconstructedObject(
        name="ball",
        vertices=ball.surface.vertices.astype(np.float32).astype(np.float64),
        faces=ball.surface.faces,
        points=points,
        normals=-points,
        seen=np.array([True, False, True, True]),
        T_scene_object=np.eye(4),
        volume=1e-4,
    )
    buffer = io.BytesIO()
    Image.new("RGB", (4, 3)).save(buffer, format="JPEG")
    pictures = {"photo_002": (buffer.getvalue(), b"surfaces"), "photo_001": (b"1", b"2")}
    folder = tmp_path / "data/reconstruct/demo"
    write_reconstruction(folder, {"ball": item}, {"photo_001": {}}, {"photos": 2}, pictures)
    assert load_reconstruction_metrics("demo") == {"photos": 2}
    assert load_reconstruction_pictures("demo") == pictures
    again = load_reconstructed_object("demo", "ball")
    assert np.array_equal(again.points, points) and np.array_equal(again.normals, -points)
    assert np.array_equal(again.vertices, item.vertices) and np.array_equal(again.seen, item.seen)
    (folder / "pictures/photo_001.jpg").unlink()
    with pytest.raises(UserError, match="photo_001.jpg is missing; run `dvc repro reconstruct`"):
        load_reconstruction_pictures("demo")
    (folder / "objects/ball/points.npy").write_bytes(b"")
    with pytest.raises(UserError, match="objects/ball is damaged"):
        load_reconstructed_object("demo", "ball")
