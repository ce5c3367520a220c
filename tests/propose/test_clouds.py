"""Clouds as depth cameras and tools give them: the folder faults/cloud-invalid-points."""

import numpy as np
import pytest

from pipeline.propose.clouds import cleaned, read_cloud
from pipeline.propose.own_objects import load_own_object
from pipeline.records.errors import UserError


@pytest.fixture(scope="module")
def points():
    """Points on the faces of a box of 60 x 40 x 90 mm that stands on the origin."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-1, 1, (3000, 3))
    axis = rng.integers(0, 3, 3000)
    points[np.arange(3000), axis] = np.sign(points[np.arange(3000), axis])
    return points * [0.03, 0.02, 0.045] + [0, 0, 0.045]


def pcd(points, kind):
    head = (
        f"VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\n"
        f"POINTS {len(points)}\nDATA {kind}\n"
    ).encode()
    if kind == "ascii":
        return head + "\n".join(f"{x:f} {y:f} {z:f} 7" for x, y, z in points).encode()
    rows = np.zeros(len(points), [("xyz", "<f4", 3), ("rgb", "<u4")])
    rows["xyz"] = points
    return head + rows.tobytes()


def write(path, points):
    """Write points in the layout that a file's name stands for."""
    if path.suffix == ".npy":
        layouts = {
            "organised": lambda: points.reshape(50, 60, 3),
            "batch": lambda: points[None],
            "three_by_n": lambda: points.T,
            "structured": lambda: np.rec.fromarrays(points.T, names="x,y,z"),
            "colours": lambda: np.concatenate([points, np.ones_like(points)], axis=1),
        }
        np.save(path, layouts[path.stem]())
    elif path.suffix == ".npz":
        np.savez(path, points=points, colours=np.ones_like(points))
    elif path.suffix == ".pcd":
        path.write_bytes(pcd(points, path.stem))
    else:
        comma = path.suffix == ".csv"
        np.savetxt(path, points, delimiter="," if comma else " ", header="x,y,z" if comma else "", comments="")
    return path


NAMES = [*(f"{name}.npy" for name in ("organised", "batch", "three_by_n", "structured", "colours"))]
NAMES += ["points.npz", "ascii.pcd", "binary.pcd", "cloud.xyz", "cloud.csv", "cloud.txt"]


@pytest.mark.parametrize("name", NAMES)
def test_common_layouts(tmp_path, points, name):
    np.testing.assert_allclose(read_cloud(write(tmp_path / name, points)), points, atol=1e-6)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda points: points.__setitem__(slice(None, None, 9), np.nan), "334 points that are no numbers"),
        (lambda points: points.__setitem__(slice(None, None, 7), 0), "429 missing points (all zeros)"),
        (lambda points: points.__setitem__(0, [0.2, 0.1, 0.1]), "1 flying points, away from all others"),
    ],
    ids=["nan", "zeros", "flying"],
)
def test_invalid_points_are_dropped_and_counted(tmp_path, points, spoil, said, capsys):
    spoilt = points.copy()
    spoil(spoilt)
    np.save(tmp_path / "cloud.npy", spoilt)
    prepared, seen, _ = load_own_object(tmp_path / "cloud.npy")
    assert said in capsys.readouterr().err
    np.testing.assert_allclose(prepared.extents, [0.06, 0.04, 0.09], atol=2e-3)
    assert len(seen) == 3000 - int(said.split()[0])


def test_a_cloud_without_faults_is_left_alone(points):
    assert cleaned(points, "x").dropped == ()
    # A face at the origin: one point there is a point.
    standing = np.concatenate([points, [[0.0, 0.0, 0.0]]])
    assert len(cleaned(standing, "x").points) == len(standing)


def test_several_bodies_are_said(points):
    with pytest.raises(UserError, match=r"^two.npy holds 2 bodies that do not touch \(3000 points around"):
        cleaned(np.concatenate([points, points + [0.12, 0, 0]]), "two.npy")


@pytest.mark.parametrize("density", [400, 1000])
def test_sparse_and_uneven_clouds_stay_whole(points, density):
    """The lower half has a fifth of the points."""
    rng = np.random.default_rng(2)
    kept = points[:density][(points[:density, 2] > 0.045) | (rng.random(density) < 0.2)]
    assert len(cleaned(kept, "x").points) >= 0.99 * len(kept)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("words.csv", b"x,y,z\n1,2,3\na,b,c\n", "line 3 holds no numbers"),
        ("cut.pcd", pcd(np.ones((100, 3)), "binary")[:-300], "announces 100 points and holds"),
        ("packed.pcd", pcd(np.ones((9, 3)), "binary").replace(b"DATA binary", b"DATA binary_compressed"), "ascii"),
    ],
)
def test_damaged_clouds_are_named_by_their_reason(tmp_path, name, content, sentence):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UserError, match=f"cannot be read as a mesh or a point cloud: .*{sentence}"):
        load_own_object(tmp_path / name)


def test_shapes_that_are_no_cloud_are_named(tmp_path):
    np.save(tmp_path / "flat.npy", np.zeros((5, 2)))
    with pytest.raises(UserError, match=r"the shape \(5, 2\); a cloud is n x 3"):
        load_own_object(tmp_path / "flat.npy")
