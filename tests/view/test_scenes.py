"""Where everything is drawn, against values from geometry and from kinematics that the drawing does not use."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import load_hand
from pipeline.records.reconstructions import ReconstructedObject
from pipeline.view import scenes, shapes
from pipeline.view.drawing import Drawing, Solid, camera, grid, picked, translations
from tests.view.made_up import box

HAND = load_hand("allegro")
Q = np.array([0.1, 0.7, 0.3, 0.4, 0.0, 0.6, 0.2, 0.5, -0.1, 0.8, 0.4, 0.3, 1.0, 0.3, 0.2, 0.6])
TURN = Rotation.from_euler("xyz", [0.3, -0.5, 1.1])
TIPS = ("link_3.0_tip", "link_7.0_tip", "link_11.0_tip", "link_15.0_tip")


def tip_places(T_world_hand: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Origins (4, 3) of the fingertips by the batched numpy kinematics; drawings use Pinocchio's."""
    return (T_world_hand @ link_poses(HAND, q[None])[0])[[HAND.link(name) for name in TIPS], :3, 3]


def world_from_object(position: list, turn: Rotation) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn.as_matrix(), position
    return T


def grasp(name: str, number: int = 0, **values) -> dict:
    row = {
        "object": name,
        "grasp_id": number,
        "fingers": "thumb+index",
        "position_object_hand": [0.03, -0.02, 0.11],
        "quaternion_object_hand": TURN.as_quat(scalar_first=True),
        "q": Q,
        "contact_points": [np.array([0.02, 0.0, 0.01]), np.array([-0.02, 0.0, 0.01])],
        "contact_normals": [np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])],
        "squeeze_q": None,
        "open_q": Q - 0.05,
    }
    return row | values


def pair(number: int = 0) -> dict:
    return {
        "merged_id": number,
        "object0": "cube",
        "object1": "can",
        "fingers0": "thumb+index",
        "fingers1": "ring+palm",
        "q": Q,
        "position_hand_object0": [0.08, 0.03, 0.05],
        "quaternion_hand_object0": TURN.as_quat(scalar_first=True),
        "position_hand_object1": [0.06, -0.05, -0.02],
        "quaternion_hand_object1": [1.0, 0.0, 0.0, 0.0],
    }


CUBE, CAN = box("cube", (0.04, 0.04, 0.04)), box("can", (0.06, 0.05, 0.1))
OBJECTS = {"cube": CUBE, "can": CAN}
MESHES = {name: (item.vertices, item.faces) for name, item in OBJECTS.items()}


def named(drawing: Drawing, key: str) -> Solid:
    return next(solid for solid in drawing.solids if solid.key == key)


def fingertips(drawing: Drawing, place: int = 0) -> np.ndarray:
    """Places (4, 3) of the four meshes that are alike: the tips. The order is that of TIPS."""
    found = [solid for solid in drawing.solids if solid.key.startswith("hand/")]
    tips = [solid for solid in found if np.allclose(solid.colours[0], shapes.TIP_COLOUR)]
    return np.array([solid.T_world[place, :3, 3] for solid in tips])


def test_a_grasp_stands_on_its_object_which_stands_on_the_ground() -> None:
    drawing = scenes.grasps_on_objects([grasp("can")], OBJECTS, None, HAND)
    assert named(drawing, "object/can").corners()[:, 2].min() == pytest.approx(0.0)
    T_world_hand = world_from_object([0.03, -0.02, 0.11 + 0.05], TURN)  # the can's origin is 5 cm over its base
    np.testing.assert_allclose(fingertips(drawing), tip_places(T_world_hand, Q), atol=1e-6)


def test_contacts_lie_at_their_points_and_normals_point_outwards() -> None:
    drawing = scenes.grasps_on_objects([grasp("cube")], OBJECTS, None, HAND)
    expected = [[0.02, 0.0, 0.03], [-0.02, 0.0, 0.03]]
    np.testing.assert_allclose(drawing.clouds[0].points, expected)
    np.testing.assert_allclose(drawing.lines[0].ends[:, 0], expected)
    np.testing.assert_allclose(drawing.lines[0].ends[:, 1], [[0.07, 0.0, 0.03], [-0.07, 0.0, 0.03]])


def test_layers_take_the_place_of_the_mesh_or_come_in_addition() -> None:
    layers = scenes.Layers(contacts=False, samples=True, parts=True, hand_candidates=True, see_through=True)
    drawing = scenes.grasps_on_objects([grasp("cube")], OBJECTS, None, HAND, layers=layers)
    keys = {solid.key for solid in drawing.solids}
    assert {"part/cube/00", "part/cube/01"} <= keys and "object/cube" not in keys and not drawing.lines
    assert {cloud.key: len(cloud.points) for cloud in drawing.clouds} == {"samples": 8, "candidates": 143}
    assert {solid.opacity for solid in drawing.solids} == {scenes.GLASS}
    volumes = [np.prod(np.ptp(named(drawing, f"part/cube/0{part}").corners(), axis=0)) for part in (0, 1)]
    np.testing.assert_allclose(volumes, 0.02 * 0.04 * 0.04)  # halves, not pulled apart


def test_contact_candidates_of_the_hand_are_on_its_tips() -> None:
    """15 of them lie 12 mm from the middle of each fingertip."""
    points = scenes.contact_candidates(Q, HAND)
    for tip in tip_places(np.eye(4), Q):
        assert (np.abs(np.linalg.norm(points - tip, axis=1) - 0.012) < 1e-9).sum() == 15


def test_other_postures_are_drawn_where_a_check_was_reached() -> None:
    assert scenes.postures(grasp("cube")) == ["grasp", "open"]
    T_world_hand = world_from_object([0.03, -0.02, 0.13], TURN)
    for joints, q in (("open_q", Q - 0.05), ("squeeze_q", Q)):
        drawing = scenes.grasps_on_objects([grasp("cube")], OBJECTS, None, HAND, joints=joints)
        np.testing.assert_allclose(fingertips(drawing), tip_places(T_world_hand, q), atol=1e-6)


def test_side_by_side_grasps_keep_their_pose_and_their_colour() -> None:
    many = [grasp("cube" if number % 2 else "can", number) for number in range(11)]
    tints = np.linspace(0, 1, 33).reshape(11, 3)
    drawing = scenes.grasps_on_objects(many, OBJECTS, tints, HAND, scenes.SIDE_BY_SIDE)
    palm = named(drawing, "hand/00")
    np.testing.assert_allclose(palm.colours, tints)
    # row 9 is the second of the second line of eight
    T_world_hand = world_from_object([0.03 + scenes.CELL, -0.02 - scenes.CELL, 0.13], TURN)
    np.testing.assert_allclose(palm.T_world[9, :3, 3] - palm.T_world[1, :3, 3], [0, -scenes.CELL, 0], atol=1e-12)
    np.testing.assert_allclose(palm.T_world[9], T_world_hand, atol=1e-9)  # base_link's mesh is in the hand frame
    assert [len(named(drawing, f"object/{name}").T_world) for name in ("cube", "can")] == [5, 6]
    assert [text for text, _ in drawing.labels] == [f"#{number}" for number in range(11)]


def test_a_click_means_the_thing_under_the_pointer() -> None:
    drawing = scenes.grasps_on_objects([grasp("cube", n) for n in range(11)], OBJECTS, None, HAND, scenes.SIDE_BY_SIDE)
    eye = np.array([1.0, -3.0, 2.0])
    for number in (0, 7, 8, 10):
        target = [(number % 8) * scenes.CELL, -(number // 8) * scenes.CELL, 0.02]
        assert picked(drawing, eye, target - eye) == number
        assert picked(drawing, eye, target + np.array([0.1, 0, 0]) - eye) == number
    assert picked(drawing, eye, eye) is None  # away from everything
    assert picked(Drawing(), eye, -eye) is None


def test_hands_on_top_of_each_other_are_lines_as_long_as_their_fingers() -> None:
    """Lengths of an Allegro finger: 54 mm, 38.4 mm, and 26.7 mm to the middle of the tip."""
    many = [grasp("cube", number, fingers="index") for number in range(3)]
    drawing = scenes.grasps_on_objects(many, OBJECTS, None, HAND, scenes.ON_TOP)
    ends = drawing.lines[0].ends
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).reshape(3, -1)
    np.testing.assert_allclose(lengths[:, 2:], [[0.054, 0.0384, 0.0267]] * 3, atol=1e-9)
    T_world_hand = world_from_object([0.03, -0.02, 0.13], TURN)
    np.testing.assert_allclose(drawing.clouds[0].points, tip_places(T_world_hand, Q)[[0] * 3], atol=1e-9)
    assert len(named(drawing, "object/cube").T_world) == 1


def test_objects_of_a_pair_lie_in_the_hand_as_the_row_says() -> None:
    drawing = scenes.merged_grasps([pair()], MESHES, None, HAND)
    T_world_hand = named(drawing, "hand/00").T_world[0]
    there = np.linalg.inv(T_world_hand) @ named(drawing, "object0/cube").T_world[0]
    np.testing.assert_allclose(there, world_from_object([0.08, 0.03, 0.05], TURN), atol=1e-9)
    there = np.linalg.inv(T_world_hand) @ named(drawing, "object1/can").T_world[0]
    np.testing.assert_allclose(there, world_from_object([0.06, -0.05, -0.02], Rotation.identity()), atol=1e-9)
    np.testing.assert_allclose(T_world_hand[:3, 2], [0, 0, 1], atol=1e-12)  # fingers up


def test_a_trial_is_drawn_where_it_happened() -> None:
    pose = [0.5, 0.1, 0.15, *TURN.as_quat(scalar_first=True)]
    row = {
        "snapshot_phases": ["settle", "hold"],
        "snapshot_robot_q": [np.zeros(23), np.concatenate([np.zeros(7), Q])],
        "snapshot_pose0": [pose, pose],
        "snapshot_pose1": [pose, [np.nan] * 7],  # lost by physics
    }
    drawing = scenes.trial_moment(row, (CUBE, CAN), HAND, 0.07, 0)
    np.testing.assert_allclose(named(drawing, "object1/can").T_world[0], world_from_object(pose[:3], TURN), atol=1e-9)
    sponge = next(solid for solid in drawing.scenery if solid.key == "sponge")
    assert sponge.corners()[:, 2].max() == pytest.approx(0.07) and sponge.corners()[:, 2].min() == pytest.approx(0.0)
    later = scenes.trial_moment(row, (CUBE, CAN), HAND, 0.07, 1)
    assert not any(solid.key.startswith("object1") for solid in later.solids)
    base = next(solid for solid in drawing.solids if solid.key == "robot/00")
    np.testing.assert_allclose(base.T_world[0], np.eye(4), atol=1e-12)
    nothing = scenes.trial_moment(row | {"snapshot_phases": []}, (CUBE, CAN), HAND, 0.07, -1)
    assert not nothing.solids and len(nothing.scenery) == 2


def test_objects_stand_beside_their_parts_and_samples() -> None:
    drawing = scenes.objects_in_parts([CUBE, CAN])
    assert drawing.labels[4][0] == "2 convex parts"
    spacing = 1.8 * 0.1
    middle = named(drawing, "object/can").corners().mean(axis=0)
    np.testing.assert_allclose(middle, [0, -spacing, 0.05], atol=1e-12)
    left, right = (named(drawing, f"part/can/0{part}").corners().mean(axis=0) for part in (0, 1))
    # Middles of the halves are 3 cm apart, and a quarter more.
    np.testing.assert_allclose(right - left, [0.03 * 1.25, 0, 0], atol=1e-12)
    np.testing.assert_allclose((left + right) / 2, [spacing, -spacing, 0.05], atol=1e-12)
    samples = next(cloud for cloud in drawing.clouds if cloud.key == "samples/can")
    np.testing.assert_allclose(samples.points.mean(axis=0), [2 * spacing, -spacing, 0.05], atol=1e-12)
    for column in range(3):
        eye = np.array([0.3, -2.0, 1.0])
        assert picked(drawing, eye, np.array([column * spacing, -spacing, 0.0]) - eye) == 1


def test_the_truth_stands_beside_a_reconstruction_without_being_fitted() -> None:
    """The photos put the object 3 mm beside the truth along x of the scene, and turned it by 90 degrees."""
    turn = Rotation.from_euler("z", 90, degrees=True)
    T_scene_object = world_from_object([0.203, 0.1, 0.02], turn)
    found = ReconstructedObject(
        "cube", CUBE.vertices, CUBE.faces, CUBE.vertices, CUBE.surface_normals, np.arange(8) < 4, T_scene_object, 6.4e-5
    )
    truth = (CUBE.vertices + [0.2, 0.1, 0.02], CUBE.faces)
    drawing = scenes.reconstructions([(found, truth, None)])
    spacing = 1.8 * 0.04
    middle = named(drawing, "truth/cube").corners().mean(axis=0)
    # -3 mm along the scene's x is +3 mm along the object's y, as the object is turned by 90 degrees about z.
    np.testing.assert_allclose(middle, [spacing, 0.003, 0.02], atol=1e-12)
    cloud = drawing.clouds[0]
    assert (cloud.colours[:4, 2] > cloud.colours[:4, 0]).all() and (cloud.colours[4:, 2] < cloud.colours[4:, 0]).all()
    far = scenes.reconstructions([(found, truth, np.array([0.0] * 4 + [0.01] * 4))]).clouds[0]
    assert (far.colours[:4, 2] > far.colours[:4, 0]).all() and (far.colours[4:, 0] > far.colours[4:, 2]).all()


def test_distances_from_a_mesh_are_those_from_a_ball() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    points = np.array([[0.08, 0, 0], [0, 0, 0.05], [0, -0.04, 0]])
    found = scenes.distance_to_mesh(points, (np.asarray(ball.vertices), np.asarray(ball.faces)))
    np.testing.assert_allclose(found, [0.03, 0.0, 0.01], atol=1e-4)


def test_places_are_in_reading_order() -> None:
    np.testing.assert_allclose(grid(5, 0.1, columns=2)[:, :2], [[0, 0], [0.1, 0], [0, -0.1], [0.1, -0.1], [0, -0.2]])


@pytest.mark.parametrize("from_front", [True, False])
@pytest.mark.parametrize("aspect", [0.6, 1.8])
def test_camera_sees_everything(aspect: float, from_front: bool) -> None:
    drawing = Drawing([Solid("box", CAN.vertices, CAN.faces, translations(grid(20, 0.3)), np.zeros((20, 3)))])
    angle = np.radians(32)
    position, target = camera(drawing, aspect, angle, from_front)
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    seen = drawing.bounds() - position
    depth = seen @ forward
    assert (depth > 0).all()
    across, along = np.abs(seen @ right / depth).max(), np.abs(seen @ np.cross(right, forward) / depth).max()
    assert across < np.tan(angle / 2) * aspect and along < np.tan(angle / 2)
    assert across > 0.8 * np.tan(angle / 2) * aspect or along > 0.8 * np.tan(angle / 2)  # and not from far away
