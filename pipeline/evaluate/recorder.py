"""A trial written down while it runs; looking on (``execution.Run.watch``) changes nothing of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.execution import Run
from pipeline.records.poses import position_quaternion
from pipeline.records.recordings import About, Recording


@dataclass
class Recorder:
    """Writes down every moment of the run that it watches."""

    moments: list[tuple[float, str, Any, list[Any]]] = field(default_factory=list)

    def __call__(self, run: Run) -> None:
        """Write down one moment."""
        time = run.steps / run.scene.world.frequency
        poses = [_pose(body.pose) for body in run.scene.objects]
        self.moments.append((time, run.under_way, run.scene.robot.q, poses))

    def recording(self, about: About) -> Recording:
        """Return what was seen."""
        time, phase, robot_q, poses = zip(*self.moments, strict=True) if self.moments else ([],) * 4
        return Recording(
            about,
            np.array(time, np.float64),
            list(phase),
            np.array(robot_q, np.float64).reshape(len(time), -1),
            np.array(poses, np.float64).reshape(len(time), len(about.objects), 7).swapaxes(0, 1),
        )


def _pose(T: NDArray[np.float64]) -> NDArray[np.float64]:
    """Position and quaternion (7,), as in ``snapshot_poses`` of a trial; no numbers where physics has lost the body."""
    return np.concatenate(position_quaternion(T)) if np.isfinite(T).all() else np.full(7, np.nan)
