import numpy as np
import pytest
import trimesh

from pipeline.prepare.preparation import prepare_object
from pipeline.prepare.sources import raw_mesh
from pipeline.records.errors import UserError
from pipeline.records.objects import read_prepared_object, write_prepared_object
from pipeline.records.parameters.objects import MeshParameters, ObjectParameters
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.shapes.distance_field import signed_distance
from pipeline.shapes.distance_grid import distance_grid
from pipeline.shapes.mass import solid_properties

COARSE = PrepareParameters(distance_cells=48, surface_points=512)
SHAPES = {
    "cube": ObjectParameters(recipe="box", extents=(0.042, 0.042, 0.042)),
    "slender_cylinder": ObjectParameters(recipe="cylinder", extents=(0.057, 0.057, 0.105)),
    "plum": ObjectParameters(ycb="018_plum"),
    "soup_can": ObjectParameters(ycb="005_tomato_soup_can"),
}


@pytest.fixture(scope="module")
def prepared():
    return {name: prepare_object(name, shape, COARSE) for name, shape in SHAPES.items()}


def test_distance_grid_of_a_ball_is_the_closed_form():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.03)
    grid = distance_grid(np.asarray(ball.vertices), np.asarray(ball.faces), 24, 0.01)
    index = np.stack(np.meshgrid(*(np.arange(n) for n in grid.values.shape), indexing="ij"), -1)
    radius = np.linalg.norm(grid.origin + grid.spacing * index, axis=-1)
    np.testing.assert_allclose(grid.values, radius - 0.03, atol=5e-5)


@pytest.mark.parametrize("name", SHAPES)
def test_mesh_grid_samples_parts_and_mass_are_one_object(prepared, name):
    item = prepared[name]
    mesh = trimesh.Trimesh(item.vertices, item.faces, process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    np.testing.assert_allclose(mesh.center_mass, 0, atol=2e-6)
    assert item.volume == pytest.approx(mesh.volume, rel=1e-5)
    assert item.mass == pytest.approx(500 * mesh.volume, rel=1e-5)
    np.testing.assert_allclose(item.inertia, 500 * mesh.moment_inertia, rtol=1e-3, atol=1e-9)
    assert np.abs(signed_distance(item, item.surface_points)).max() < item.distance_spacing
    assert np.abs(signed_distance(item, item.surface_points)).mean() < 0.1 * item.distance_spacing
    outward = signed_distance(item, item.surface_points + 0.004 * item.surface_normals)
    assert (outward > 0).mean() > 0.95  # but where a rim stands opposite
    np.testing.assert_allclose(np.linalg.norm(item.surface_normals, axis=1), 1, atol=1e-5)
    corners = np.concatenate([vertices for vertices, _ in item.parts])
    np.testing.assert_allclose(np.ptp(corners, axis=0), item.extents, atol=1e-4)
    assert all(len(vertices) <= COARSE.part_vertices for vertices, _ in item.parts)


def test_convex_objects_keep_their_volume_in_one_part(prepared):
    for name in ("cube", "slender_cylinder", "plum"):
        (part,) = prepared[name].parts
        assert solid_properties(*part)[0] == pytest.approx(prepared[name].volume, rel=0.03)


def test_preparing_and_writing_twice_gives_the_same_bytes(prepared, tmp_path):
    write_prepared_object(tmp_path / "plum", prepared["plum"])
    write_prepared_object(tmp_path / "again" / "plum", prepare_object("plum", SHAPES["plum"], COARSE))
    files = sorted(path.relative_to(tmp_path / "plum") for path in (tmp_path / "plum").rglob("*") if path.is_file())
    assert len(files) == 3
    for path in files:
        assert (tmp_path / "plum" / path).read_bytes() == (tmp_path / "again" / "plum" / path).read_bytes(), path
    loaded = read_prepared_object(tmp_path / "plum")
    np.testing.assert_array_equal(loaded.vertices, prepared["plum"].vertices)
    np.testing.assert_array_equal(loaded.surface_points, prepared["plum"].surface_points)


def test_a_damaged_folder_is_named(prepared, tmp_path):
    write_prepared_object(tmp_path / "cube", prepared["cube"])
    (tmp_path / "cube" / "shapes.npz").write_bytes(b"PK\x03\x04")
    with pytest.raises(UserError, match=r"cube is damaged .* run `dvc repro prepare`"):
        read_prepared_object(tmp_path / "cube")
    (tmp_path / "cube" / "mesh.ply").unlink()
    with pytest.raises(UserError, match="dvc repro prepare`"):
        read_prepared_object(tmp_path / "cube")


def prepare_file(path, **options):
    return prepare_object("mug", MeshParameters(file=str(path), **options), COARSE)


@pytest.fixture
def box():
    return trimesh.creation.box((0.04, 0.05, 0.06))


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "off", "glb"])
def test_own_files_of_any_format(box, tmp_path, suffix):
    path = tmp_path / f"mug.{suffix}"
    box.export(path)
    # The standard of glTF says that y is up.
    stood = (0.04, 0.06, 0.05) if suffix == "glb" else (0.04, 0.05, 0.06)
    np.testing.assert_allclose(prepare_file(path).extents, stood, atol=1e-6)
    np.testing.assert_allclose(prepare_file(path, up="+z").extents, (0.04, 0.05, 0.06), atol=1e-6)


@pytest.mark.parametrize(("factor", "unit"), [(1, "m"), (100, "cm"), (1000, "mm")], ids=lambda value: str(value))
def test_a_unit_is_guessed_and_said_or_obeyed(box, tmp_path, factor, unit):
    path = tmp_path / "mug.stl"
    box.apply_scale(factor).export(path)
    guessed = prepare_file(path)
    np.testing.assert_allclose(guessed.extents, (0.04, 0.05, 0.06), atol=1e-6)
    assert guessed.provenance["guessed_unit"] == unit
    named = prepare_file(path, unit=unit)
    np.testing.assert_allclose(named.extents, (0.04, 0.05, 0.06), atol=1e-6)
    assert "guessed_unit" not in named.provenance


def test_a_wrong_unit_is_refused_where_no_hand_could_hold_the_result(box, tmp_path):
    path = tmp_path / "mug.stl"
    box.apply_scale(1000).export(path)
    assert "looks like mm, set `unit: mm`" in sentence_of(path, unit="m")
    box.apply_scale(1 / 25.4).export(path)
    np.testing.assert_allclose(prepare_file(path, unit="inch").extents, (0.04, 0.05, 0.06), atol=1e-6)


def test_a_shape_is_scaled_to_a_longest_extent_whatever_its_unit(box, tmp_path):
    path = tmp_path / "mug.stl"
    box.apply_scale(1234.5).export(path)
    np.testing.assert_allclose(prepare_file(path, fit_longest=0.09).extents, (0.06, 0.075, 0.09), atol=1e-6)
    raw = raw_mesh(ObjectParameters(ycb="013_apple", fit_longest=0.05), "apple")
    assert np.ptp(raw.vertices, axis=0).max() == pytest.approx(0.05)


def test_a_turn_is_counter_clockwise_about_the_vertical_after_up(tmp_path):
    """An upright prism whose triangular base points to +x."""
    path = tmp_path / "mug.stl"
    corners = [(x, y, z) for x, y in ((0, -0.02), (0.06, 0), (0, 0.02)) for z in (0, 0.04)]
    trimesh.convex.convex_hull(np.array(corners)).export(path)
    mug = prepare_file(path, turn=90.0)
    np.testing.assert_allclose(mug.extents, (0.04, 0.06, 0.04), atol=1e-6)
    assert mug.vertices[:, 1].max() == pytest.approx(0.04, abs=1e-6)  # the tip is 2/3 of 60 mm from the centroid


def test_the_declared_axis_points_up(box, tmp_path):
    path = tmp_path / "mug.stl"
    box.export(path)
    assert prepare_file(path, up="+y").extents[2] == pytest.approx(0.05, abs=1e-6)
    assert prepare_file(path, up="-x").extents[2] == pytest.approx(0.04, abs=1e-6)


def test_a_missing_face_is_filled(box, tmp_path):
    path = tmp_path / "mug.stl"
    box.update_faces(np.arange(len(box.faces)) != 3)
    box.export(path)
    mug = prepare_file(path)
    assert mug.volume == pytest.approx(0.04 * 0.05 * 0.06, rel=1e-5)
    assert any("filled" in repair for repair in mug.provenance["repairs"])


def sentence_of(path, **options) -> str:
    with pytest.raises(UserError) as caught:
        prepare_file(path, **options)
    text = str(caught.value)
    assert "\n" not in text and text.startswith(("mug:", "meshes.mug:"))
    return text


def test_what_is_no_mesh_is_refused(tmp_path):
    for content in (b"", b"not a mesh"):
        path = tmp_path / "mug.stl"
        path.write_bytes(content)
        assert "holds no triangle mesh" in sentence_of(path)
    assert "is missing" in sentence_of(tmp_path / "none.stl")
    other = tmp_path / "mug.step"
    other.write_text("")
    assert "unknown format '.step'" in sentence_of(other)


def test_an_object_that_would_tip_over_is_refused(tmp_path):
    path = tmp_path / "mug.stl"
    trimesh.creation.cone(radius=0.02, height=0.06).export(path)
    assert prepare_file(path).volume > 0
    said = sentence_of(path, up="-z")
    assert "does not stand with -z up" in said and "set `up` to +z." in said
