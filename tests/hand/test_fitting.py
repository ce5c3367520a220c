"""Boxes and balls in place of cylinders, turned boxes and meshes: as near as they say, measured by other means."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from pipeline.hand.model import Hand, hand_of_file
from pipeline.hand.shapes import MOST_SHAPES
from pipeline.records.errors import UserError
from tests.hand.toy import urdf_text, write_toy

BALL = '<sphere radius="0.008"/>'
ORIGIN = '<origin xyz="0 0 0.04"/>'
TURNED = '<origin xyz="0 0 0.04" rpy="0.3 -0.5 0.8"/>'
WEDGE = np.array([[0, 0, 0], [30, 0, 0], [0, 20, 0], [30, 20, 0], [15, 2, 40], [15, 18, 40]], dtype=float)  # mm
SHAPES = {
    "cylinder": (ORIGIN, '<cylinder radius="0.009" length="0.03"/>'),
    "capsule": (ORIGIN, '<capsule radius="0.009" length="0.02"/>'),
    "turned box": (TURNED, '<box size="0.03 0.02 0.012"/>'),
    "mesh": (TURNED, '<mesh filename="wedge.stl" scale="0.001 0.001 0.001"/>'),
}
TRUTH = {
    "cylinder": lambda: trimesh.creation.cylinder(0.009, 0.03, sections=64),
    "capsule": lambda: trimesh.creation.capsule(0.02, 0.009, count=[24, 24]),
    "turned box": lambda: trimesh.creation.box([0.03, 0.02, 0.012]),
    "mesh": lambda: trimesh.Trimesh(WEDGE / 1000).convex_hull,
}


def fitted(folder: Path, kind: str, **changes: object) -> tuple[Hand, trimesh.Trimesh]:
    """Return the toy whose left tip has a shape of some kind beside no box, and that shape, link frame."""
    origin, shape = SHAPES[kind]
    folder.mkdir()
    trimesh.Trimesh(WEDGE).convex_hull.export(folder / "wedge.stl")
    text = urdf_text()
    collision = f"<collision>{ORIGIN}<geometry>{BALL}</geometry></collision>"
    assert collision in text
    start = text.index('<link name="left_tip">')
    end = text.index("</link>", start)
    own = f'<link name="left_tip"><collision>{origin}<geometry>{shape}</geometry></collision>'
    contacts = {name: [] for name in ("right_tip", "far_tip")}
    hand = hand_of_file(write_toy(folder, {"contacts": contacts, **changes}, text[:start] + own + text[end:]))
    pose = trimesh.transformations.translation_matrix([0, 0, 0.04])
    if origin == TURNED:
        pose = pose @ trimesh.transformations.euler_matrix(0.3, -0.5, 0.8, "sxyz")
    return hand, TRUTH[kind]().apply_transform(pose)


@pytest.mark.parametrize("kind", SHAPES)
def test_the_error_is_what_both_surfaces_are_apart(tmp_path: Path, kind: str) -> None:
    hand, target = fitted(tmp_path / "toy", kind)
    link = hand.link("left_tip")
    fit = hand.shape_fits["left_tip"]
    boxes = [
        trimesh.creation.box(2 * half).apply_transform(pose)
        for own, pose, half in zip(hand.box_link, hand.box_pose, hand.box_half, strict=True)
        if own == link
    ]
    balls = [
        trimesh.creation.icosphere(subdivisions=2, radius=radius).apply_translation(centre)
        for own, centre, radius in zip(hand.sphere_link, hand.sphere_centre, hand.sphere_radius, strict=True)
        if own == link
    ]
    assert fit.parts == len(boxes) + len(balls) <= MOST_SHAPES
    union = trimesh.boolean.union([*boxes, *balls])
    apart = []
    for one, other in ((target, union), (union, target)):
        points = np.concatenate([trimesh.sample.sample_surface(one, 300, seed=5)[0], one.vertices[::8]])
        apart.append(np.abs(trimesh.proximity.closest_point_naive(other, points)[1]).max())
    assert max(apart) == pytest.approx(fit.error, abs=5e-4)
    assert fit.error < {"cylinder": 0.0025, "capsule": 0.0025}.get(kind, 0.0075)  # steps along other axes than its own


def test_a_coarser_tolerance_takes_fewer_parts(tmp_path: Path) -> None:
    fine, _ = fitted(tmp_path / "fine", "mesh")
    coarse, _ = fitted(tmp_path / "coarse", "mesh", shape_error=0.01)
    assert coarse.shape_fits["left_tip"].parts < fine.shape_fits["left_tip"].parts
    assert coarse.shape_fits["left_tip"].error > fine.shape_fits["left_tip"].error


def test_shapes_of_the_description_override_the_fit_and_exact_shapes_stay(tmp_path: Path) -> None:
    ball = {"spheres": [{"centre": [0.0, 0.0, 0.04], "radius": 0.01}]}
    hand, _ = fitted(tmp_path / "toy", "mesh", shapes={"left_tip": ball})
    assert not hand.shape_fits
    assert (hand.sphere_link == hand.link("left_tip")).sum() == 1
    fit, _ = fitted(tmp_path / "other", "mesh")
    assert set(fit.shape_fits) == {"left_tip"}
    own = fit.box_link == fit.link("right_near")
    np.testing.assert_array_equal(fit.box_half[own], [[0.006, 0.007, 0.025]])


def test_a_hand_of_too_many_shapes_is_made_coarser(tmp_path: Path) -> None:
    rows = "".join(
        f'<collision><origin xyz="{0.002 * index - 0.08} 0 0.02"/><geometry><box size="0.002 0.1 0.01"/></geometry>'
        "</collision>"
        for index in range(80)
    )
    text = urdf_text().replace('<link name="plate">', f'<link name="plate">{rows}')
    hand = hand_of_file(write_toy(tmp_path / "toy", urdf=text))
    assert len(hand.box_link) + len(hand.sphere_link) <= MOST_SHAPES
    # Slices of one box, of which joining leaves out half a slice at most.
    assert hand.shape_fits["plate"].shapes == 81 and hand.shape_fits["plate"].error < 0.0011


def test_too_many_described_shapes_are_refused(tmp_path: Path) -> None:
    many = {"spheres": [{"centre": [0.001 * index, 0, 0], "radius": 0.01} for index in range(60)]}
    with pytest.raises(UserError, match="62 shapes are possible; describe links by fewer under `shapes`"):
        hand_of_file(write_toy(tmp_path / "toy", {"shapes": {"plate": many}}))
