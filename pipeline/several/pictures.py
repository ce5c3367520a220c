"""One trial of a sequence as a strip of pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.scene import Post
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.poses import pose_matrix

WIDTH, HEIGHT = 320, 300  # pixels
COLOURS = ((0.88, 0.54, 0.18), (0.24, 0.47, 0.71), (0.36, 0.62, 0.35), (0.60, 0.40, 0.65))  # in the order of picking
POST_COLOUR = (0.62, 0.62, 0.60)
SHOWN = ("settle", "enter", "close", "lift", "hold")  # first words of phases


def trial_strip(
    row: dict[str, Any], objects: tuple[PreparedObject, ...], posts: list[Post], settings: EvaluateParameters
) -> NDArray[np.uint8]:
    """Return pictures of the main phases of a row of ``JOINED_TRIALS``, and of its last one, side by side."""
    import trimesh

    from pipeline.pictures.picture import strip
    from pipeline.pictures.render import Body
    from pipeline.pictures.table_scene import moment_picture

    boxes = [(trimesh.creation.box(post.size), post.pose(settings)) for post in posts]
    fixed = [Body(np.asarray(box.vertices), np.asarray(box.faces), POST_COLOUR, T) for box, T in boxes]
    pictures, captions = [], []
    for index, phase in enumerate(row["snapshot_phases"]):
        if phase.split()[0] not in SHOWN and index < len(row["snapshot_phases"]) - 1:
            continue
        poses = [own[index] for own in row["snapshot_poses"]]
        bodies = [
            Body(item.vertices, item.faces, colour, pose_matrix(pose[:3], pose[3:]))
            for item, colour, pose in zip(objects, COLOURS, poses, strict=False)
        ]
        robot_q = row["snapshot_robot_q"][index]
        pictures.append(moment_picture(robot_q, [*bodies, *fixed], settings.sponge_height, WIDTH, HEIGHT))
        captions.append(phase)
    return strip(pictures, captions)
