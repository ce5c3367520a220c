"""The pictures of each view: rows and meshes in, a :class:`Drawing` out. Nothing is read here.

Grasps on one object stand in its frame, moved up so that it rests on z = 0. Two-object grasps stand in the hand's
frame, turned so that the palm looks at the camera. Trials are drawn where they happened.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.hand.kinematics import link_poses, points_on_links
from pipeline.hand.model import Hand
from pipeline.pictures.colours import OBJECT_COLOURS, SPONGE_COLOUR
from pipeline.pictures.decimation import Mesh
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, pose_matrix, transform_points
from pipeline.records.reconstructions import ReconstructedObject
from pipeline.shapes.rays import ray_scene
from pipeline.shapes.workplace import SPONGE_SIZE, SPONGE_X, TABLE_SIZE, TABLE_X
from pipeline.view.drawing import Cloud, Drawing, Lines, Solid, grid, translations
from pipeline.view.rows import FAILED, Colour
from pipeline.view.shapes import COARSE_OBJECT, MANY_OBJECT, ONE_OBJECT, fewer_faces, hands, robot, sticks

CELL = 0.32  # m between grasps side by side: hand and object need less
PALM_YAW = np.radians(-62.0)  # of the hand's frame in the world: the palm, +x, looks at the camera
STEEL: Colour = (0.62, 0.66, 0.72)
TRUTH: Colour = (0.45, 0.68, 0.52)
SEEN: Colour = (0.20, 0.45, 0.75)
ASSUMED: Colour = (0.93, 0.60, 0.20)
CONTACT: Colour = (0.85, 0.10, 0.25)
CANDIDATE: Colour = (0.95, 0.75, 0.10)
SAMPLE: Colour = (0.15, 0.35, 0.65)
TABLE: Colour = (0.80, 0.78, 0.74)
GLASS, FAINT = 0.4, 0.06  # opacity of what is seen through, and of very many objects at one place
APART = 0.25  # how far convex parts are pulled apart, in parts of their distance from the middle
TIP_SIZE = 0.008  # m, of a tip where hands are lines
NORMAL_LENGTH = 0.05  # m, of a drawn contact normal: it shows behind a finger
LIGHT = (-0.4, -0.6, 0.7)  # where it comes from, on points, which the browser does not shade
LABEL_GAP = 0.01  # m in front of what a label is about
FAR = 0.002  # m from the truth: the colour is full
ONE, SIDE_BY_SIDE, ON_TOP = "one", "side by side", "on top of each other"
JOINTS = {"grasp": "q", "squeeze": "squeeze_q", "open": "open_q", "open first": "open_q0", "open second": "open_q1"}


@dataclass(frozen=True)
class Layers:
    """What is drawn besides the grasp itself."""

    contacts: bool = True
    samples: bool = False  # of the object's surface
    parts: bool = False  # convex parts in place of the mesh
    hand_candidates: bool = False
    see_through: bool = False


STANDARD = Layers()


def posture(row: Mapping[str, Any], joints: str) -> NDArray[np.float64]:
    """Return the joint angles (J,) called ``joints`` (a column), those of the grasp where a check was not reached."""
    value = row.get(joints)
    return np.asarray(row["q"] if value is None or len(value) != len(row["q"]) else value, np.float64)


def postures(row: Mapping[str, Any]) -> list[str]:
    """Return which of ``JOINTS`` a row has."""
    return [
        name for name, column in JOINTS.items() if row.get(column) is not None and len(row[column]) == len(row["q"])
    ]


def _places(count: int, arrangement: str) -> NDArray[np.float64]:
    return grid(count, CELL) if arrangement == SIDE_BY_SIDE else np.zeros((count, 3))


def _labels(
    numbers: Sequence[int], places: NDArray[np.float64], height: float
) -> list[tuple[str, NDArray[np.float64]]]:
    return [(f"#{number}", place + [0, -0.4 * CELL, height]) for number, place in zip(numbers, places, strict=True)]


def grasps_on_objects(
    rows: Sequence[Mapping[str, Any]],
    objects: Mapping[str, PreparedObject],
    colours: NDArray[np.float64] | None,
    hand: Hand,
    arrangement: str = ONE,
    joints: str = "q",
    layers: Layers = STANDARD,
) -> Drawing:
    """Draw rows of candidates or validated grasps.

    Args:
        objects: by name, all that the rows name.
        colours: (n, 3) of the hands; their own when None.
        hand: that of the rows.
        layers: for a single row; of many, only ``see_through`` counts.
    """
    places = _places(len(rows), arrangement)
    lifted = places + [[0, 0, -objects[row["object"]].bottom] for row in rows]
    T_world_object = translations(lifted)
    T_object_hand = np.array([pose_matrix(row["position_object_hand"], row["quaternion_object_hand"]) for row in rows])
    q = np.array([posture(row, joints) for row in rows])
    single = len(rows) == 1
    opacity = GLASS if layers.see_through else 1.0
    T_world_hand = T_world_object @ T_object_hand
    if arrangement == ON_TOP:
        drawing = _stick_hands(T_world_hand, q, [row["fingers"] for row in rows], colours, hand)
    else:
        drawing = Drawing(hands(T_world_hand, q, hand, colours, opacity))
    for name in dict.fromkeys(row["object"] for row in rows):
        own = [index for index, row in enumerate(rows) if row["object"] == name]
        own = own[:1] if arrangement == ON_TOP else own
        if single and layers.parts:
            drawing.solids.extend(_parts(objects[name], T_world_object[0], apart=0.0, opacity=opacity))
        else:
            drawing.solids.append(_object(objects[name], T_world_object[own], STEEL, opacity, single))
    if single:
        _add_layers(drawing, rows[0], objects[rows[0]["object"]], T_world_object[0], q[0], layers, hand)
    if arrangement == SIDE_BY_SIDE:
        labels = _labels([row["grasp_id"] for row in rows], places, 0.0)
        drawing = replace(drawing, labels=labels, cells=lifted, spacing=CELL)
    return drawing


def _stick_hands(
    T_world_hand: NDArray[np.float64],
    q: NDArray[np.float64],
    fingers: Sequence[str],
    colours: NDArray[np.float64] | None,
    hand: Hand,
) -> Drawing:
    """Draw many hands at one place as lines, which hide less than bodies do."""
    segments, of_segment, tips, of_tip = sticks(T_world_hand, q, fingers, hand)
    tints = np.tile(SAMPLE, (len(q), 1)) if colours is None else colours
    return Drawing(
        clouds=[Cloud("tips", tips, tints[of_tip], TIP_SIZE)],
        lines=[Lines("sticks", segments, tints[of_segment])],
    )


def _object(
    prepared: PreparedObject, T_world: NDArray[np.float64], colour: Colour, opacity: float, single: bool
) -> Solid:
    vertices, faces = fewer_faces((prepared.vertices, prepared.faces), ONE_OBJECT if single else MANY_OBJECT)
    return Solid(f"object/{prepared.name}", vertices, faces, T_world, np.tile(colour, (len(T_world), 1)), opacity)


def _parts(prepared: PreparedObject, T_world: NDArray[np.float64], apart: float, opacity: float = 1.0) -> list[Solid]:
    solids = []
    for number, (vertices, faces) in enumerate(prepared.parts):
        middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        T = T_world @ translations(apart * middle)[0]
        colour = np.array([FAILED[number % len(FAILED)]])
        solids.append(Solid(f"part/{prepared.name}/{number:02d}", vertices, faces, T[None], colour, opacity))
    return solids


def _add_layers(
    drawing: Drawing,
    row: Mapping[str, Any],
    prepared: PreparedObject,
    T_world_object: NDArray[np.float64],
    q: NDArray[np.float64],
    layers: Layers,
    hand: Hand,
) -> None:
    points, normals = _vectors(row["contact_points"]), _vectors(row["contact_normals"])
    if layers.contacts and len(points):
        there = transform_points(T_world_object, points)
        drawing.clouds.append(Cloud("contacts", there, np.tile(CONTACT, (len(there), 1)), 0.005))
        tips = transform_points(T_world_object, points + NORMAL_LENGTH * normals)
        drawing.lines.append(Lines("normals", np.stack([there, tips], axis=1), np.tile(CONTACT, (len(there), 1))))
    if layers.samples:
        there = transform_points(T_world_object, prepared.surface_points)
        drawing.clouds.append(Cloud("samples", there, _shaded(SAMPLE, prepared.surface_normals), 0.0012))
    if layers.hand_candidates:
        T_object_hand = pose_matrix(row["position_object_hand"], row["quaternion_object_hand"])
        there = transform_points(T_world_object @ T_object_hand, contact_candidates(q, hand))
        drawing.clouds.append(Cloud("candidates", there, np.tile(CANDIDATE, (len(there), 1)), 0.003))


def _shaded(colours: Any, normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return colours (n, 3), darker where a surface with ``normals`` (n, 3) turns away from the light."""
    facing = normals @ (np.array(LIGHT) / np.linalg.norm(LIGHT))
    return np.clip(np.asarray(colours) * (1.0 + 0.45 * facing)[:, None], 0.0, 1.0)


def _vectors(column: Any) -> NDArray[np.float64]:
    """A column of lists of vectors as an array (n, 3)."""
    return np.array([np.asarray(part, np.float64) for part in column]).reshape(-1, 3)


def contact_candidates(q: NDArray[np.float64], hand: Hand) -> NDArray[np.float64]:
    """Return where the synthesis may let a hand at ``q`` (J,) touch: points (C, 3) in the hand frame."""
    return points_on_links(link_poses(hand, q[None]), hand.contact_link, hand.contact_points)[0]


def merged_grasps(
    rows: Sequence[Mapping[str, Any]],
    meshes: Mapping[str, Mesh],
    colours: NDArray[np.float64] | None,
    hand: Hand,
    arrangement: str = ONE,
    joints: str = "q",
    layers: Layers = STANDARD,
) -> Drawing:
    """Draw rows of two-object grasps, synthesized or learned; see :func:`grasps_on_objects`.

    Args:
        meshes: by name, of all objects that the rows name, in the frames that the rows mean.
    """
    places = _places(len(rows), arrangement)
    T_world_hand = translations(places + [0, 0, 0.1])
    T_world_hand[:, :2, :2] = [[np.cos(PALM_YAW), -np.sin(PALM_YAW)], [np.sin(PALM_YAW), np.cos(PALM_YAW)]]
    q = np.array([posture(row, joints) for row in rows])
    single = len(rows) == 1
    opacity = GLASS if layers.see_through else 1.0
    most_faces = ONE_OBJECT if single else MANY_OBJECT
    if arrangement == ON_TOP:
        drawing = _stick_hands(T_world_hand, q, [f"{row['fingers0']}+{row['fingers1']}" for row in rows], colours, hand)
        opacity, most_faces = FAINT, COARSE_OBJECT
    else:
        drawing = Drawing(hands(T_world_hand, q, hand, colours, opacity))
    for slot, colour in enumerate(OBJECT_COLOURS[:2]):
        T = np.array([pose_matrix(r[f"position_hand_object{slot}"], r[f"quaternion_hand_object{slot}"]) for r in rows])
        T_world_object = T_world_hand @ T
        for name in dict.fromkeys(row[f"object{slot}"] for row in rows):
            own = [index for index, row in enumerate(rows) if row[f"object{slot}"] == name]
            vertices, faces = fewer_faces(meshes[name], most_faces)
            tint = np.tile(colour, (len(own), 1))
            drawing.solids.append(Solid(f"object{slot}/{name}", vertices, faces, T_world_object[own], tint, opacity))
    if single and layers.hand_candidates:
        there = transform_points(T_world_hand[0], contact_candidates(q[0], hand))
        drawing.clouds.append(Cloud("candidates", there, np.tile(CANDIDATE, (len(there), 1)), 0.003))
    if arrangement == SIDE_BY_SIDE:
        labels = _labels([row["merged_id"] for row in rows], places, 0.0)
        drawing = replace(drawing, labels=labels, cells=places + [0, 0, 0.1], spacing=CELL)
    return drawing


def trial_moment(
    row: Mapping[str, Any],
    objects: tuple[PreparedObject, PreparedObject],
    hand: Hand,
    sponge_height: float,
    moment: int,
) -> Drawing:
    """Draw robot, objects, sponge and table at one snapshot of a trial (an index into ``snapshot_phases``)."""
    scenery = [
        _box("table", TABLE_SIZE, (TABLE_X, 0.0, -TABLE_SIZE[2] / 2), TABLE),
        _box("sponge", (SPONGE_SIZE, SPONGE_SIZE, sponge_height), (SPONGE_X, 0.0, sponge_height / 2), SPONGE_COLOUR),
    ]
    if not len(row["snapshot_phases"]):
        return Drawing(scenery=scenery)
    solids = robot(np.asarray(row["snapshot_robot_q"][moment], np.float64), hand)
    for slot, (prepared, colour) in enumerate(zip(objects, OBJECT_COLOURS, strict=False)):
        pose = np.asarray(row[f"snapshot_pose{slot}"][moment], np.float64)
        if np.isfinite(pose).all():  # physics may have lost it
            T = pose_matrix(pose[:3], pose[3:])
            vertices, faces = fewer_faces((prepared.vertices, prepared.faces), ONE_OBJECT)
            solids.append(Solid(f"object{slot}/{prepared.name}", vertices, faces, T[None], np.array([colour])))
    return Drawing(solids, scenery=scenery)


def _box(name: str, size: Sequence[float], centre: Sequence[float], colour: Colour) -> Solid:

    mesh = trimesh.creation.box(size)
    return Solid(name, np.asarray(mesh.vertices), np.asarray(mesh.faces), translations(centre), np.array([colour]))


def _three_columns(count: int, spacing: float) -> NDArray[np.float64]:
    """Return places (count, 3, 3): three side by side per row."""
    return grid(3 * count, spacing, columns=3).reshape(count, 3, 3)


def objects_in_parts(objects: Sequence[PreparedObject]) -> Drawing:
    """Draw prepared objects, one per row: the mesh, its convex parts pulled apart, its surface samples."""
    spacing = 1.8 * max(float(prepared.extents.max()) for prepared in objects)
    places = _three_columns(len(objects), spacing)
    drawing = Drawing(cells=places.reshape(-1, 3), per_row=3, spacing=spacing)
    for row, prepared in enumerate(objects):
        T = translations(places[row] - [0, 0, prepared.bottom])
        drawing.solids.append(_object(prepared, T[:1], STEEL, 1.0, single=True))
        drawing.solids.extend(_parts(prepared, T[1], APART))
        there = transform_points(T[2], prepared.surface_points)
        drawing.clouds.append(
            Cloud(f"samples/{prepared.name}", there, _shaded(SAMPLE, prepared.surface_normals), 0.0014)
        )
        parts = f"{len(prepared.parts)} convex part{'s' if len(prepared.parts) > 1 else ''}"
        texts = (prepared.name.replace("_", " "), parts, f"{len(there)} surface samples")
        front = [0, prepared.vertices[:, 1].min() - LABEL_GAP, prepared.bottom]
        drawing.labels.extend((text, T[column, :3, 3] + front) for column, text in enumerate(texts))
    return drawing


def reconstructions(
    found: Sequence[tuple[ReconstructedObject, Mesh | None, NDArray[np.float64] | None]],
) -> Drawing:
    """Draw objects as photos show them, one per row: surface, true surface, samples.

    Args:
        found: with the true mesh in the scene frame, and the distance (n,), m, of every sample from it, where known.
    """
    spacing = 1.8 * max(float(np.ptp(item.vertices, axis=0).max()) for item, _, _ in found)
    places = _three_columns(len(found), spacing)
    drawing = Drawing(cells=places.reshape(-1, 3), per_row=3, spacing=spacing)
    for row, (item, truth, distance) in enumerate(found):
        bottom = float(item.vertices[:, 2].min())
        T = translations(places[row] - [0, 0, bottom])
        most = ONE_OBJECT if len(found) == 1 else MANY_OBJECT
        surface = fewer_faces((item.vertices, item.faces), most)
        drawing.solids.append(Solid(f"photos/{item.name}", *surface, T[:1], np.array([STEEL])))
        texts = [f"{item.name.replace('_', ' ')} from photos", "", ""]
        if truth is not None:
            T_world_scene = T[1] @ inverse_pose(item.T_scene_object)
            vertices, faces = fewer_faces(truth, most)
            drawing.solids.append(Solid(f"truth/{item.name}", vertices, faces, T_world_scene[None], np.array([TRUTH])))
            texts[1] = "the truth"
        if distance is None:
            colours = np.where(item.seen[:, None], SEEN, ASSUMED)
            texts[2] = "samples: seen (blue), assumed (orange)"
        else:
            share = np.clip(distance / FAR, 0, 1)[:, None]
            colours = (1 - share) * np.array(SEEN) + share * np.array(CONTACT)
            texts[2] = f"distance from the truth: 0 (blue) to {1e3 * FAR:g} mm (red)"
        drawing.clouds.append(
            Cloud(f"points/{item.name}", transform_points(T[2], item.points), _shaded(colours, item.normals), 0.0014)
        )
        front = [0, item.vertices[:, 1].min() - LABEL_GAP, bottom]
        drawing.labels.extend((text, T[c, :3, 3] + front) for c, text in enumerate(texts) if text)
    return drawing


def distance_to_mesh(points: NDArray[np.float64], mesh: Mesh) -> NDArray[np.float64]:
    """Return how far ``points`` (n, 3) are from the nearest point of a mesh, (n,), m; both in one frame."""
    found = ray_scene(mesh).compute_distance(points.astype(np.float32), nthreads=1)
    return np.asarray(found.numpy(), np.float64)
