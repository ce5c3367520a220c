"""Robot, objects and sponge as coloured meshes at any moment of a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.hand.model import Hand
from pipeline.pictures.colours import OBJECT_COLOURS, SPONGE_COLOUR
from pipeline.pictures.decimation import decimated
from pipeline.pictures.render import Body, corner_normals
from pipeline.pictures.robot import robot_bodies
from pipeline.records.objects import load_prepared_object
from pipeline.records.poses import pose_matrix
from pipeline.records.recordings import Recording
from pipeline.shapes.workplace import SPONGE_SIZE, SPONGE_X, TABLE_SIZE, TABLE_X

TABLE_COLOUR = (0.80, 0.78, 0.74)
LARGEST_PART = 1000  # faces of one part of the robot; no difference is seen at the size of a video
LARGEST_OBJECT = 6000  # faces


@dataclass(frozen=True)
class Appearance:
    """Meshes of everything; the moving ones in their own frames."""

    robot: tuple[Body, ...]  # in the order of ``pictures.robot.robot_bodies``
    objects: tuple[Body, ...]
    sponge: Body
    table: Body

    @property
    def moving(self) -> tuple[Body, ...]:
        """What moves, in the order of :func:`moving_poses`."""
        return (*self.robot, *self.objects)


def appearance(recording: Recording, hand: Hand) -> Appearance:
    """Return the meshes of what a recording shows.

    Raises:
        UserError: a prepared object is missing or damaged.
    """
    prepared = [load_prepared_object(name) for name in recording.about.objects]
    looks = zip(prepared, OBJECT_COLOURS, strict=False)  # there are colours for the most objects that a hand can hold
    height = recording.about.sponge_height
    return Appearance(
        robot=tuple(_light(body.placed(np.eye(4)), LARGEST_PART) for body in robot_bodies(recording.robot_q[0], hand)),
        objects=tuple(_light(Body(item.vertices, item.faces, colour), LARGEST_OBJECT) for item, colour in looks),
        sponge=_box((SPONGE_SIZE, SPONGE_SIZE, height), (SPONGE_X, 0.0, height / 2), SPONGE_COLOUR),
        table=_box(TABLE_SIZE, (TABLE_X, 0.0, -TABLE_SIZE[2] / 2), TABLE_COLOUR),
    )


def moving_poses(recording: Recording, hand: Hand, moment: int) -> list[NDArray[np.float64]]:
    """Return ``T_world`` (4, 4) of all that moves; an object that physics has lost stays where it was last seen."""
    robot = [body.T_world for body in robot_bodies(recording.robot_q[moment], hand)]
    return [*robot, *(_last_known(poses[: moment + 1]) for poses in recording.poses)]


def _last_known(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    known = poses[np.isfinite(poses).all(axis=1)]
    return pose_matrix(known[-1, :3], known[-1, 3:]) if len(known) else np.eye(4)


def _light(body: Body, most_faces: int) -> Body:
    vertices, faces = decimated((body.vertices, body.faces), most_faces)
    return replace(body, vertices=vertices, faces=faces, normals=corner_normals(vertices, faces))


def _box(size: tuple[float, ...], centre: tuple[float, ...], colour: tuple[float, float, float]) -> Body:

    T = np.eye(4)
    T[:3, 3] = centre
    mesh = trimesh.creation.box(size)
    return Body(np.asarray(mesh.vertices), np.asarray(mesh.faces), colour, T)
