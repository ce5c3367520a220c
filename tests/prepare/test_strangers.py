"""What strangers' meshes must not become in silence.

The folders faults/mesh-open-vessel, faults/mesh-tight-coil and faults/mesh-native-abort. Expected values are closed
forms of shapes that the tests make themselves.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pipeline.compute.guard import CallLost
from pipeline.prepare import change, preparation, resolution
from pipeline.prepare import repair as repair_module
from pipeline.prepare.preparation import prepare_object
from pipeline.prepare.repair import Wishes, repair
from pipeline.prepare.sources import RawMesh
from pipeline.records.errors import UserError
from pipeline.records.parameters.objects import MeshParameters
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.shapes import convex_parts
from pipeline.shapes.distance_grid import distance_grid, enclosed_volume, volume_by_rays

COARSE = PrepareParameters(distance_cells=48, surface_points=512)
BOX = (0.06, 0.04, 0.03)


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    """Guarded calls have tests of their own; here they would load the libraries once more."""

    def call(function, *arguments, cpu_seconds, megabytes):
        return function(*arguments)

    for module in (preparation, convex_parts):
        monkeypatch.setattr(module, "guarded", call)
    monkeypatch.setattr(repair_module, "WRAP_CELLS", 48)


def arrays(mesh):
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)


def box(extents=BOX, centre=(0.0, 0.0, 0.0)):
    return trimesh.creation.box(extents, transform=trimesh.transformations.translation_matrix(centre))


def open_box(depth=0.05):
    """A box of 60 x 60 mm without lid, as one sheet: a pot."""
    mesh = box((0.06, 0.06, depth)).subdivide().subdivide()
    mesh.update_faces(mesh.triangles_center[:, 2] < depth / 2 - 1e-6)
    return mesh


def prepared(mesh, name="thing", **wishes):
    raw = RawMesh(*arrays(mesh), "test", "own")
    return prepare_object(name, MeshParameters(file="data/raw/thing.stl", unit="m", **wishes), COARSE, raw)


@pytest.mark.parametrize("depth", [0.05, 0.03])
def test_a_vessel_of_one_sheet_is_refused_with_what_to_do(depth):
    """Its lid is 36 cm2 of 36 + 36 + 4 x 6 x depth; all but the 1 % along the rim is new."""
    with pytest.raises(UserError) as refused:
        prepared(open_box(depth))
    share = 0.06**2 / (2 * 0.06**2 + 4 * 0.06 * depth) * (1 - 2 * 0.01) ** 2
    said = re.search(r"(\d+)% of the solid's surface is not in the file", str(refused.value))
    assert said and int(said[1]) == pytest.approx(100 * share, abs=1.5)
    assert "`wall: 0.002`" in str(refused.value) and "`accept_repair: true`" in str(refused.value)


@pytest.mark.slow
def test_a_vessel_with_a_wall_stays_hollow():
    """Volume of everything within half a wall of the five faces: area times wall, with round edges less than that."""
    wall = 0.003
    made = prepared(open_box(), wall=wall)
    area = 0.06**2 + 4 * 0.06 * 0.05
    assert made.volume == pytest.approx(area * wall, rel=0.06)
    np.testing.assert_allclose(made.extents, [0.063, 0.063, 0.053], atol=3e-4)
    assert "given a wall of 3 mm" in made.provenance["repairs"]
    assert made.provenance["changes"]["volume_in_file"] is None
    inside = resolution_at(made, np.array([[0.0, 0.0, made.vertices[:, 2].max() - 0.01]]))
    assert inside[0] > 0.02, "the hollow of the vessel is solid"


def resolution_at(made, points):
    from pipeline.shapes.distance_field import signed_distance

    return signed_distance(made, points)


def test_a_filled_vessel_on_request_says_what_changed():
    """The rebuilt surface follows the file's to about a cell, 1.25 mm here."""
    made = prepared(open_box(), accept_repair=True)
    assert made.volume == pytest.approx(0.06 * 0.06 * 0.05, rel=0.04)
    record = made.provenance["changes"]
    assert record["added_share"] > 0.15 and record["lost_share"] < 0.05
    said = f"{1e6 * made.volume:.2f}"
    assert any("volume, cm3" in line and "open" in line and said in line for line in change.table(record))


def test_a_wall_is_for_open_surfaces():
    with pytest.raises(UserError, match="`wall` is for a surface without thickness"):
        prepared(box(), wall=0.002)
    with pytest.raises(UserError, match="cannot be resolved.*set `wall` to 0.0007"):
        prepared(open_box(), wall=0.0002)


def test_what_changes_nothing_is_not_recorded():
    unmerged = trimesh.Trimesh(box().triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    made = prepared(unmerged)
    assert made.provenance["repairs"] == ["merged 28 coincident vertices"]
    assert "changes" not in made.provenance


def test_cavities_are_not_filled_in_silence():
    """A box with an inner box of an eighth of its volume, turned inward: filling adds 1/7."""
    inner = box(tuple(0.5 * extent for extent in BOX))
    inner.invert()
    hollow = trimesh.util.concatenate([box(), inner])
    with pytest.raises(UserError, match=r"filling its cavities changes the volume from 63\.0 to 72\.0 cm3"):
        prepared(hollow)
    assert prepared(hollow, accept_repair=True).volume == pytest.approx(72e-6)


def test_the_comparison_is_that_of_closed_forms():
    """A box beside one that is 10 mm longer: a sixth of its long faces and its end are new, nothing is lost."""
    short, long = box((0.05, 0.04, 0.03)), box((0.06, 0.04, 0.03), (0.005, 0, 0))
    found = change.compared(arrays(short), arrays(long))
    near = change.NEAR * 0.05
    new = 2 * (0.04 + 0.03) * (0.01 - near) + 0.04 * 0.03
    assert found.added_share == pytest.approx(new / long.area, abs=0.01)
    assert found.added_distance == pytest.approx(0.01, rel=0.02)
    assert found.volume_in_file == pytest.approx(60e-6) and found.volume == pytest.approx(72e-6)
    # The short box's end lies inside the long one.
    assert found.lost_share == 0 and found.inner_share == pytest.approx(0.04 * 0.03 / short.area, abs=0.02)
    assert (found.genus_in_file, found.genus) == (0, 0)
    ring = trimesh.creation.torus(0.03, 0.01)
    assert change.compared(arrays(ring), arrays(ring)).genus == 1


def crossing_coil(turns=4, rise=0.006, radius=0.005):
    """A tube of 10 mm on a helix that rises by 6 mm a turn: neighbouring turns overlap."""
    around = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    along = np.linspace(0, 2 * np.pi * turns, 48 * turns)[:, None]
    out, up = 0.02 + radius * np.cos(around), radius * np.sin(around) + rise * along / (2 * np.pi)
    rings = np.stack([out * np.cos(along), out * np.sin(along), up], axis=-1)
    count, corners = rings.shape[:2]
    ring, corner = np.divmod(np.arange((count - 1) * corners), corners)
    after = (corner + 1) % corners
    a, b, c, d = (
        ring * corners + corner,
        ring * corners + after,
        (ring + 1) * corners + after,
        (ring + 1) * corners + corner,
    )
    first, last = (np.arange(1, corners - 1)[:, None] + [[0, 1]] for _ in range(2))
    caps = [np.insert(first[:, ::-1], 0, 0, axis=1), np.insert(last, 0, 0, axis=1) + (count - 1) * corners]
    mesh = trimesh.Trimesh(
        rings.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), *caps]), process=False
    )
    if mesh.volume < 0:
        mesh.invert()
    assert mesh.is_watertight and mesh.is_winding_consistent
    return mesh


def test_a_surface_through_itself_becomes_the_union():
    coil = crossing_coil()
    own = trimesh.Trimesh(*arrays(coil), process=False).volume
    by_rays = volume_by_rays(*arrays(coil))
    assert by_rays < 0.9 * own, "the shape of this test does not overlap itself"
    solid = repair(*arrays(coil), "coil")
    assert resolution.resolved(solid.vertices, solid.faces, COARSE).passes_through_itself
    union = repair(*arrays(coil), "coil", Wishes(rebuild=True))
    # What is counted twice is there once: the union has half of what rays miss.
    assert trimesh.Trimesh(union.vertices, union.faces).volume == pytest.approx((own + by_rays) / 2, rel=0.05)
    assert "its surface passes through itself" in union.repairs[-1]
    assert not resolution.resolved(union.vertices, union.faces, COARSE).passes_through_itself


def test_the_volume_inside_a_grid_is_that_of_the_solid():
    ball = arrays(trimesh.creation.icosphere(4, 0.03))
    true = trimesh.Trimesh(*ball).volume
    assert enclosed_volume(distance_grid(*ball, 48, 0.01)) == pytest.approx(true, rel=0.005)
    assert volume_by_rays(*ball) == pytest.approx(true, rel=0.02)


def comb(gap, teeth=8):
    """Plates of 4 mm with gaps between them on a common back."""
    pitch = 0.004 + gap
    parts = [box((0.004, 0.04, 0.03), (pitch * number, 0, 0)) for number in range(teeth)]
    back = box((pitch * (teeth - 1) + 0.004, 0.04, 0.006), (pitch * (teeth - 1) / 2, 0, -0.017))
    return trimesh.boolean.union([*parts, back], engine="manifold")


def test_gaps_below_the_grid_give_a_finer_grid_or_a_sentence():
    solid = arrays(comb(0.002))
    made = resolution.resolved(*solid, PrepareParameters(distance_cells=24))
    assert made.grid.values.shape[0] == 48 and "distance grid of 48 cells" in made.remarks[0]
    narrow = resolution.resolved(*arrays(comb(0.0008)), PrepareParameters(distance_cells=24))
    assert not narrow.passes_through_itself and narrow.difference > resolution.FINE
    assert re.search(r"as 24 hold 10\d% of the volume; 48 still hold 1\d\d%$", narrow.remarks[0])
    for difference, what in ((0.2, "gaps"), (-0.2, "walls")):
        with pytest.raises(UserError, match=f"its {what} are narrower than .* raise `prepare.distance_cells`"):
            resolution.check(replace(narrow, difference=difference), "comb")


@pytest.fixture
def two_boxes():
    return trimesh.util.concatenate([box(), box((0.03, 0.03, 0.03), (0.08, 0, 0))])


@pytest.mark.parametrize(
    ("bodies", "volume"), [("largest", 72e-6), (1, 72e-6), (2, 27e-6), ("all", 99e-6)], ids=["largest", "1", "2", "all"]
)
def test_bodies_by_choice(two_boxes, bodies, volume):
    solid = repair(*arrays(two_boxes), "thing", Wishes(bodies))
    assert trimesh.Trimesh(solid.vertices, solid.faces).volume == pytest.approx(volume)
    assert "bod" in solid.repairs[-1]


@pytest.mark.parametrize(
    ("bodies", "sentence"), [("refuse", r"2 separate bodies \(73%, 27% of the volume\)"), (3, "there is no body 3")]
)
def test_bodies_that_are_not_chosen_are_refused(two_boxes, bodies, sentence):
    with pytest.raises(UserError, match=sentence):
        repair(*arrays(two_boxes), "thing", Wishes(bodies))


def table_shape():
    """A plate on four legs: far from its hull."""
    legs = [box((0.006, 0.006, 0.05), (x, y, -0.025)) for x in (-0.027, 0.027) for y in (-0.027, 0.027)]
    return trimesh.boolean.union([box((0.06, 0.06, 0.006)), *legs], engine="manifold")


@pytest.mark.parametrize(
    ("failing", "remark"),
    [
        (1, "CoACD ended by SIGABRT; found with its own remeshing of the solid"),
        (2, "CoACD ended by SIGABRT; found with twice the concavity threshold"),
        (3, "CoACD ended by SIGABRT; its convex hull stands for the object in physics"),
    ],
)
@pytest.mark.slow
def test_a_decomposition_that_aborts_is_tried_another_way(monkeypatch, failing, remark):
    calls = []

    def guarded(function, *arguments, **limits):
        calls.append(limits)
        if len(calls) <= failing:
            raise CallLost("ended by SIGABRT")
        return function(*arguments)

    monkeypatch.setattr(convex_parts, "guarded", guarded)
    parts, _, said = convex_parts.convex_parts(*arrays(table_shape()), PrepareParameters())
    assert said == remark and (len(parts) == 1) == (failing == 3)
    assert sum(limits["cpu_seconds"] for limits in calls) <= 120


def test_a_repair_that_never_ends_is_a_sentence(monkeypatch):
    def guarded(*arguments, **limits):
        raise CallLost("not done after 90 seconds of processor time")

    monkeypatch.setattr(preparation, "guarded", guarded)
    with pytest.raises(UserError, match=r"^thing: no solid can be made of the mesh \(repair not done after 90"):
        prepared(box())
