"""One trial of a sequence as pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.scene import Post
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.poses import pose_matrix

if TYPE_CHECKING:
    from pipeline.pictures.render import Body

WIDTH, HEIGHT = 320, 300  # pixels
PER_ROW = 6
COLOURS = ((0.88, 0.54, 0.18), (0.24, 0.47, 0.71), (0.36, 0.62, 0.35), (0.60, 0.40, 0.65))  # in the order of picking
POST_COLOUR = (0.62, 0.62, 0.60)
SHOWN = ("settle", "enter", "close", "lift", "hold")  # first words of phases
CLOSE_AZIMUTH, CLOSE_ELEVATION = 115.0, -25.0  # degrees; the palm faces +y when the last object is held


def trial_sheet(
    row: dict[str, Any], objects: tuple[PreparedObject, ...], posts: list[Post], settings: EvaluateParameters
) -> NDArray[np.uint8]:
    """Return pictures of the main phases of a row of ``JOINED_TRIALS`` and of its last one, then the hand close up."""
    import trimesh

    from pipeline.pictures.camera import framing
    from pipeline.pictures.picture import captioned
    from pipeline.pictures.render import Body, render
    from pipeline.pictures.robot import robot_bodies
    from pipeline.pictures.table_scene import moment_picture

    boxes = [(trimesh.creation.box(post.size), post.pose(settings)) for post in posts]
    fixed = [Body(np.asarray(box.vertices), np.asarray(box.faces), POST_COLOUR, T) for box, T in boxes]
    panels = []
    last = len(row["snapshot_phases"]) - 1
    for index, phase in enumerate(row["snapshot_phases"]):
        if phase.split()[0] in SHOWN or index == last:
            bodies = [*_placed(row, objects, index), *fixed]
            picture = moment_picture(row["snapshot_robot_q"][index], bodies, settings.sponge_height, WIDTH, HEIGHT)
            panels.append(captioned(picture, phase))
    bodies = _placed(row, objects, last)
    points = np.concatenate([body.world_vertices() for body in bodies])
    camera = framing(points, CLOSE_AZIMUTH, CLOSE_ELEVATION, WIDTH / HEIGHT, margin=1.6)
    hand = [*robot_bodies(row["snapshot_robot_q"][last]), *bodies]
    panels.append(captioned(render(hand, camera, WIDTH, HEIGHT), "close up"))
    panels += [np.full_like(panels[0], 255)] * (-len(panels) % PER_ROW)
    rows = [np.concatenate(panels[start : start + PER_ROW], axis=1) for start in range(0, len(panels), PER_ROW)]
    return np.concatenate(rows)


def _placed(row: dict[str, Any], objects: tuple[PreparedObject, ...], index: int) -> list[Body]:
    from pipeline.pictures.render import Body

    poses = [own[index] for own in row["snapshot_poses"]]
    return [
        Body(item.vertices, item.faces, colour, pose_matrix(pose[:3], pose[3:]))
        for item, colour, pose in zip(objects, COLOURS, poses, strict=False)
    ]
