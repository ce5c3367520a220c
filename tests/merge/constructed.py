"""Objects and grasps built from theory: a box between thumb and index, an upright cylinder between ring and palm."""

from functools import lru_cache

import numpy as np
import trimesh
from scipy.optimize import brentq, least_squares

from pipeline.hand.kinematics import link_poses
from pipeline.hand.model import load_hand
from pipeline.hand.moves import finger_joints
from pipeline.pairing.grasps import JoinedGrasp, SingleGrasp, join
from pipeline.pairing.task import Task, groups_of, task_of
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.merge import MergeParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.records.poses import inverse_pose
from tests.objects import Field, box_distance, cylinder_distance, exact_grid, prepared
from tests.pairs import PAIR

HAND = load_hand("allegro")
GROUPS = groups_of(HAND, PAIR)
RING_JOINTS = finger_joints(["ring"], HAND)
TIP_RADIUS = float(HAND.sphere_radius[list(HAND.sphere_link).index(HAND.link("link_3.0_tip"))])  # m

PALM_FACE = 0.0117  # m, x of the palm's front, from the collision boxes of the URDF
REST = np.array([0, 0.9, 0.6, 0.4, 0, 0.3, 0.3, 0.2, 0, 0.0, 0.0, 0.0, 1.3, 0.3, 0.5, 0.6])


def sampled(name: str, mesh: trimesh.Trimesh, field: Field) -> PreparedObject:
    """A prepared object whose distances are exact at the cells, with its corners among its samples."""
    points, face = trimesh.sample.sample_surface_even(mesh, 2000, seed=0)
    samples = {
        "surface_points": np.concatenate([np.asarray(mesh.vertices), points]),
        "surface_normals": np.concatenate([np.asarray(mesh.vertex_normals), mesh.face_normals[face]]),
    }
    return prepared(name, mesh, **exact_grid(mesh, field, padding=0.01), **samples)


@lru_cache
def box(side: float = 0.042) -> PreparedObject:
    return sampled("box", trimesh.creation.box([side] * 3), box_distance(np.full(3, side / 2)))


@lru_cache
def cylinder(radius: float = 0.0285, height: float = 0.105) -> PreparedObject:
    mesh = trimesh.creation.cylinder(radius, height, sections=64)
    return sampled("cylinder", mesh, cylinder_distance(radius, height / 2))


def _pressed(q, joint_changes):
    result = q.copy()
    for joint, change in joint_changes.items():
        result[joint] += change
    return result


def _candidates(links):
    """One contact candidate of each link, in the middle of its list."""
    hand = HAND
    of_link = [np.flatnonzero(hand.contact_link == hand.link(name)) for name in sorted(links)]
    return np.array([own[len(own) // 2] for own in of_link])


@lru_cache
def pinch(side: float = 0.042) -> SingleGrasp:
    """Thumb and index fingertip on opposite faces of a box; the palm looks down."""
    hand = HAND
    index, thumb = hand.link("link_3.0_tip"), hand.link("link_15.0_tip")
    moving = [1, 2, 13, 14]

    def tips(values):
        q = REST.copy()
        q[moving] = values
        T = link_poses(hand, q[None])[0]
        return q, T[index][:3, 3], T[thumb][:3, 3]

    def residual(values):
        _, a, b = tips(values)
        return np.append(np.linalg.norm(a - b) - side - 2 * TIP_RADIUS, 0.01 * (values - REST[moving]))

    fit = least_squares(residual, REST[moving], bounds=(hand.lower[moving], hand.upper[moving]))
    # The regulariser leaves a fraction of a millimetre; the index's second joint closes it.
    values = fit.x.copy()

    def gap(second):
        values[1] = second
        return residual(values)[0]

    values[1] = brentq(gap, fit.x[1] - 0.2, fit.x[1] + 0.2)
    q, a, b = tips(values)
    across = (a - b) / np.linalg.norm(a - b)
    up = np.array([-1.0, 0.0, 0.0])
    up -= across * (up @ across)
    up /= np.linalg.norm(up)
    T_hand_object = np.eye(4)
    T_hand_object[:3, :3] = np.stack([across, np.cross(up, across), up], axis=1)
    T_hand_object[:3, 3] = (a + b) / 2
    T_object_hand = inverse_pose(T_hand_object)
    return SingleGrasp(
        grasp_id=0,
        fingers=("thumb", "index"),
        T_object_hand=T_object_hand,
        contact_candidates=_candidates({"link_3.0_tip", "link_15.0_tip"}),
        q=q,
        squeeze_q=_pressed(q, {1: 0.15, 14: 0.15}),
        open_q=_pressed(q, {1: -0.3, 14: -0.3}),
        approach_direction=np.array([0.0, 0.0, 1.0]),
    )


@lru_cache
def side(radius: float = 0.0285, height: float = 0.105) -> SingleGrasp:
    """Ring finger around an upright cylinder that touches the palm; the index side looks up."""
    hand = HAND
    tip = hand.link("link_11.0_tip")
    # Object axes in the hand frame: z up = hand y; x = fingers; the cylinder stands in front of the palm.
    T_hand_object = np.eye(4)
    T_hand_object[:3, :3] = np.array([[0, -1, 0], [0, 0, 1], [-1, 0, 0]], float)
    T_hand_object[:3, 3] = [PALM_FACE + radius, height / 2 - 0.09, -0.02]
    centre = T_hand_object[:3, 3]

    def gap(curl):
        q = REST.copy()
        q[RING_JOINTS] = [0.0, 1.2, curl, 0.8 * curl]
        point = link_poses(hand, q[None])[0, tip][:3, 3]
        return np.linalg.norm((point - centre)[[0, 2]]) - radius - TIP_RADIUS

    q = REST.copy()
    curl = brentq(gap, 0.3, 1.5)
    q[RING_JOINTS] = [0.0, 1.2, curl, 0.8 * curl]
    squeeze, opened = q.copy(), q.copy()
    squeeze[RING_JOINTS[1:]] += 0.15
    opened[RING_JOINTS[1:]] -= 0.4
    T_object_hand = inverse_pose(T_hand_object)
    direction = T_object_hand[:3, 3] * [1, 1, 0]
    return SingleGrasp(
        grasp_id=0,
        fingers=("ring", "palm"),
        T_object_hand=T_object_hand,
        contact_candidates=_candidates({"base_link", "link_11.0_tip"}),
        q=q,
        squeeze_q=squeeze,
        open_q=opened,
        approach_direction=direction / np.linalg.norm(direction),
    )


def joined() -> JoinedGrasp:
    """Both grasps in one hand."""
    return join(HAND, [pinch(), side()], GROUPS)


def pair(**settings) -> Task:
    """The box, then the cylinder, with some settings of ``merge``."""
    merge = MergeParameters(**settings)
    return task_of(HAND, PAIR, (box(), cylinder()), merge, PhysicsParameters(), ValidateParameters())
