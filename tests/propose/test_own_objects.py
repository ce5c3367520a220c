import numpy as np
import pytest
import trimesh

from pipeline.propose.own_objects import load_own_object
from pipeline.records.errors import UserError
from pipeline.shapes.distance_field import signed_distance


def box_file(folder, extents=(0.05, 0.04, 0.06), name="box.stl", open_=False):
    mesh = trimesh.creation.box(extents).subdivide().subdivide()
    mesh.apply_translation([1.0, 2.0, 3.0])
    if open_:
        mesh.update_faces(np.arange(len(mesh.faces)) > 3)
    mesh.export(folder / name)
    return folder / name


def test_a_mesh_is_centred_and_its_distance_is_that_of_the_box(tmp_path):
    prepared, points, centre = load_own_object(box_file(tmp_path))
    np.testing.assert_allclose(centre, [1, 2, 3], atol=1e-6)
    np.testing.assert_allclose(prepared.extents, [0.05, 0.04, 0.06], atol=1e-6)
    np.testing.assert_allclose(np.abs(points).max(0), [0.025, 0.02, 0.03], atol=1e-3)
    at = np.array([[0, 0, 0], [0.03, 0, 0], [0, 0, 0.02]])
    np.testing.assert_allclose(signed_distance(prepared, at), [-0.02, 0.005, -0.01], atol=1e-3)
    assert prepared.mass == pytest.approx(500 * 0.05 * 0.04 * 0.06, rel=1e-3)


@pytest.mark.parametrize("kind", ["npy", "ply"])
def test_a_cloud_stands_for_its_hull(tmp_path, kind):
    cloud = trimesh.sample.sample_surface(trimesh.creation.box((0.05, 0.05, 0.05)), 800, seed=0)[0] + [0.1, 0, 0]
    source = tmp_path / f"cloud.{kind}"
    if kind == "npy":
        np.save(source, cloud)
    else:
        trimesh.PointCloud(cloud).export(source)
    prepared, points, centre = load_own_object(source)
    np.testing.assert_allclose(centre, [0.1, 0, 0], atol=2e-3)
    np.testing.assert_allclose(points, cloud - centre, atol=1e-6)
    assert prepared.volume == pytest.approx(0.05**3, rel=0.1)


def test_an_open_mesh_is_replaced_by_its_hull(tmp_path, capsys):
    prepared, _, _ = load_own_object(box_file(tmp_path, open_=True))
    assert prepared.volume == pytest.approx(0.05 * 0.04 * 0.06, rel=0.02)
    assert "convex hull" in capsys.readouterr().err


def test_what_cannot_be_used_is_one_sentence(tmp_path):
    def refused(content, words: str, name: str = "cloud.npy") -> None:
        source = tmp_path / name
        if isinstance(content, bytes):
            source.write_bytes(content)
        else:
            np.save(source, content)
        with pytest.raises(UserError, match=words) as caught:
            load_own_object(source)
        assert "\n" not in str(caught.value) and str(source) in str(caught.value)

    cloud = np.random.default_rng(0).uniform(-0.03, 0.03, (200, 3))
    refused(np.zeros((0, 3)), "holds 0 points")
    refused(cloud[:10], "holds 10 points")
    refused(np.full((100, 3), np.nan), "holds 0 points without 100 points that are no numbers; give at least 64")
    refused(1000 * cloud, "scale it to metres")
    refused(0.001 * cloud, "scale it to metres")
    refused(cloud[:, :2], "n x 3")
    refused(cloud * [1, 1, 0], "flat")
    refused(b"solid nonsense", "cannot be read", "broken.npy")
    refused(b"\x00\x01", "cannot be read", "broken.glb")
    with pytest.raises(UserError, match="missing"):
        load_own_object(tmp_path / "none.stl")
