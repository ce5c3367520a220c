"""A dry run: the way-points of a plan, exactly as they are exported, carried out in physics."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.execution import Ended, Run
from pipeline.evaluate.scene import build_scene
from pipeline.evaluate.sequence import Phase, rest_phase
from pipeline.hand.model import Hand
from pipeline.pictures.colours import OBJECT_COLOURS
from pipeline.pictures.picture import strip
from pipeline.pictures.render import Body
from pipeline.pictures.table_scene import moment_picture
from pipeline.plan.limits import Waypoints
from pipeline.plan.proposal import Table
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.poses import pose_matrix

PICTURE_WIDTH, PICTURE_HEIGHT = 320, 300  # pixels
SHOWN = ("settle", "approach first", "close first", "lift first", "enter second", "close second", "hold")
OTHER_COLOUR = (0.62, 0.62, 0.60)


def phases_of(waypoints: Waypoints) -> list[Phase]:
    """Return the phases in which way-points are reached; the start is in none."""
    names = np.array(waypoints.phases)
    phases = []
    for name in dict.fromkeys(waypoints.phases[1:]):
        own = names == name
        q = waypoints.q[own]
        phases.append(Phase(name, q[:, :7], waypoints.arm_velocity[own], q[:, 7:]))
    return phases


def play(
    hand: Hand, table: Table, waypoints: Waypoints, settings: EvaluateParameters, physics: PhysicsParameters
) -> dict[str, Any]:
    """Run a plan blindly, judged as a trial is, and return ``execution.Run.outcome``."""
    scene = build_scene(
        hand,
        [item.prepared for item in table.objects],
        settings,
        physics,
        [item.T_world_object for item in table.objects],
        [(item.prepared, item.T_world_object) for item in table.others],
    )
    run = Run(scene, settings, rest=[body.pose for body in scene.objects])
    reason = None
    try:
        run.settle(rest_phase("settle", run.posture, settings.settle_seconds, settings))
        run.execute(phases_of(waypoints))
    except Ended as end:
        reason = end.reason
    return run.outcome(reason)


def playback_strip(
    hand: Hand, table: Table, outcome: dict[str, Any], settings: EvaluateParameters
) -> NDArray[np.uint8]:
    """Return pictures of the main phases, and of the last one that was reached, side by side.

    Other objects are drawn where they were put.
    """
    others = [
        Body(item.prepared.vertices, item.prepared.faces, OTHER_COLOUR, item.T_world_object) for item in table.others
    ]
    pictures, captions = [], []
    for index, phase in enumerate(outcome["snapshot_phases"]):
        if phase not in SHOWN and index < len(outcome["snapshot_phases"]) - 1:
            continue
        poses = [own[index] for own in outcome["snapshot_poses"]]
        bodies = [
            Body(item.prepared.vertices, item.prepared.faces, colour, pose_matrix(pose[:3], pose[3:]))
            for item, colour, pose in zip(table.objects, OBJECT_COLOURS, poses, strict=False)
        ]
        robot_q = outcome["snapshot_robot_q"][index]
        pictures.append(
            moment_picture(robot_q, hand, [*bodies, *others], settings.sponge_height, PICTURE_WIDTH, PICTURE_HEIGHT)
        )
        captions.append(phase)
    return strip(pictures, captions)
