"""The scene frame and the metric scale: the similarity that lays located tag corners on the known layout."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.records.captures import TagLayout
from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import AlignmentParameters

SIZE_TOLERANCE = 0.015  # relative difference between printed and stated tag size that is reported


@dataclass(frozen=True)
class Similarity:
    """``scene = scale * rotation @ world + translation``."""

    scale: float
    rotation: NDArray[np.float64]  # (3, 3)
    translation: NDArray[np.float64]  # (3,)

    def points(self, world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return scene positions (n, 3) of world positions (n, 3)."""
        return np.asarray(self.scale * world @ self.rotation.T + self.translation)

    def camera(self, T_camera_world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the metric ``T_camera_scene`` (4, 4) of a camera posed in the world frame."""
        R, t = T_camera_world[:3, :3], T_camera_world[:3, 3]
        T = np.eye(4)
        T[:3, :3] = R @ self.rotation.T
        T[:3, 3] = self.scale * t - T[:3, :3] @ self.translation
        return T


@dataclass(frozen=True)
class Alignment:
    """The similarity, and how well it fits."""

    similarity: Similarity
    residual: float  # m, root mean square over the corners used
    largest_residual: float  # m, over the corners used
    corners_used: int
    corners_located: int
    tags: tuple[int, ...]


def fit_similarity(source: NDArray[np.float64], target: NDArray[np.float64]) -> Similarity:
    """Return the least-squares similarity from ``source`` to ``target``, both (n, 3); Umeyama 1991."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    U, S, Vt = np.linalg.svd((target - b).T @ (source - a) / len(source))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    rotation = (U * sign) @ Vt
    scale = float((S * sign).sum() / ((source - a) ** 2).sum(axis=1).mean())
    return Similarity(scale, rotation, b - scale * rotation @ a)


def _check_size(
    located: Mapping[int, Mapping[int, NDArray[np.float64]]], similarity: Similarity, layout: TagLayout
) -> None:
    """Compare the tags' edges with their distances from each other: the layout may contradict itself."""
    edges = [
        np.linalg.norm(corners[k] - corners[(k + 1) % 4])
        for corners in located.values()
        for k in range(4)
        if k in corners and (k + 1) % 4 in corners
    ]
    ratio = float(np.median(edges)) * similarity.scale / layout.size if edges else 1.0
    if abs(ratio - 1) > SIZE_TOLERANCE:
        raise UserError(
            "tags.yaml contradicts itself: if the tags' positions are right, the tags are "
            f"{1000 * ratio * layout.size:.1f} mm large, not {1000 * layout.size:.1f}; measure a printed black square "
            "and the distances again."
        )


def align(
    located: Mapping[int, Mapping[int, NDArray[np.float64]]], layout: TagLayout, settings: AlignmentParameters
) -> Alignment:
    """Return the similarity from the sparse model's world to the scene frame.

    Corners farther off than max(3 medians, 2 mm) are dropped once.

    Raises:
        UserError: too few tags were located, or they do not lie as ``tags.yaml`` says.
    """
    if len(located) < settings.least_tags:
        seen = ", ".join(str(number) for number in located) or "none"
        raise UserError(
            f"located {len(located)} of the {len(layout.tags)} tags in tags.yaml ({seen}), {settings.least_tags} are "
            "needed; keep them in view of at least three sharp photos each, or correct their numbers and family."
        )
    truth = layout.corners()
    keys = [(number, corner) for number, corners in sorted(located.items()) for corner in sorted(corners)]
    source = np.array([located[number][corner] for number, corner in keys])
    target = np.array([truth[number][corner] for number, corner in keys])
    if len(keys) < 4:
        raise UserError("fewer than four tag corners were located; take sharper photos of the tags.")
    # Scale and place by the middles of the tags where there are enough of them: a wrong size does not move a middle.
    middles = {n: np.mean(list(c.values()), axis=0) for n, c in located.items() if len(c) == 4}
    if len(middles) >= 3:
        own = fit_similarity(
            np.array(list(middles.values())), np.array([truth[number].mean(axis=0) for number in middles])
        )
        off = np.linalg.norm(
            own.points(np.array(list(middles.values()))) - [truth[n].mean(axis=0) for n in middles], axis=1
        )
        if off.max() < settings.largest_residual:
            _check_size(located, own, layout)
    similarity = fit_similarity(source, target)
    off = np.linalg.norm(similarity.points(source) - target, axis=1)
    kept = off <= max(3 * np.median(off), 0.002)
    if kept.sum() >= 4 and not kept.all():
        similarity = fit_similarity(source[kept], target[kept])
        off = np.linalg.norm(similarity.points(source) - target, axis=1)
    used = off[kept] if kept.sum() >= 4 else off
    residual = float(np.sqrt((used**2).mean()))
    if residual > settings.largest_residual:
        worst = keys[int(off.argmax())][0]
        raise UserError(
            f"the tags do not lie as tags.yaml says: {1000 * residual:.1f} mm off on average, tag {worst} most; "
            "correct positions, yaws and size there, or the convention (opencv or apriltag: turned by 180 degrees)."
        )
    return Alignment(similarity, residual, float(used.max()), len(used), len(keys), tuple(sorted(located)))
