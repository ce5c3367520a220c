"""How far a reconstructed surface is from the true one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.reconstruct.surface import Surface
from pipeline.shapes.rays import ray_scene

SAMPLES = 20000


@dataclass(frozen=True)
class Accuracy:
    """Distances between two surfaces, m; from random samples of one to the other surface itself (no sampling floor)."""

    accuracy: float  # mean distance of the reconstruction to the truth
    completeness: float  # mean distance of the truth to the reconstruction
    completeness_p95: float
    f_score: float  # at 2 mm

    @property
    def chamfer(self) -> float:
        """Mean of accuracy and completeness, m."""
        return (self.accuracy + self.completeness) / 2


def _distances(source: Surface, target: Surface, seed: int) -> NDArray[np.float64]:
    points, _ = trimesh.sample.sample_surface(
        trimesh.Trimesh(source.vertices, source.faces, process=False), SAMPLES, seed=seed
    )
    scene = ray_scene((target.vertices, target.faces))
    return np.asarray(scene.compute_distance(np.asarray(points, np.float32), nthreads=1).numpy(), np.float64)


def compare(found: Surface, true: Surface) -> Accuracy:
    """Return how far two closed surfaces, undersides included, are from each other."""
    there, back = _distances(found, true, 0), _distances(true, found, 1)
    precision, recall = float((there < 0.002).mean()), float((back < 0.002).mean())
    return Accuracy(
        accuracy=float(there.mean()),
        completeness=float(back.mean()),
        completeness_p95=float(np.percentile(back, 95)),
        f_score=2 * precision * recall / max(precision + recall, 1e-9),
    )
