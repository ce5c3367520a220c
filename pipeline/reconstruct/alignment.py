"""The scene frame and the metric scale: the similarity that lays located tag corners on the known layout."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import AlignmentParameters
from pipeline.records.tag_layouts import TagLayout

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


def _check_size(located: Mapping[int, Mapping[int, NDArray[np.float64]]], layout: TagLayout, tolerance: float) -> None:
    """Compare the tags' edges with their distances from each other: the layout may contradict itself.

    Scale comes from the tags' middles, which a wrong size does not move, where they lie as the layout says to within
    ``tolerance`` (m). Three are needed.

    Raises:
        UserError: tags of another size fit the layout.
    """
    whole = {
        number: np.array([corners[k] for k in range(4)]) for number, corners in located.items() if len(corners) == 4
    }
    if len(whole) < 3:
        return
    truth = layout.corners()
    middles = np.array([corners.mean(axis=0) for corners in whole.values()])
    wanted = np.array([truth[number].mean(axis=0) for number in whole])
    similarity = fit_similarity(middles, wanted)
    if np.linalg.norm(similarity.points(middles) - wanted, axis=1).max() >= tolerance:
        return
    edges = [np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1) for corners in whole.values()]
    size = float(np.median(edges)) * similarity.scale
    if abs(size / layout.size - 1) > SIZE_TOLERANCE:
        raise UserError(
            "tags.yaml contradicts itself: if the tags' positions are right, the tags are "
            f"{1000 * size:.1f} mm large, not {1000 * layout.size:.1f}; measure a printed black square and the "
            "distances again."
        )


def align(
    located: Mapping[int, Mapping[int, NDArray[np.float64]]], layout: TagLayout, settings: AlignmentParameters
) -> Alignment:
    """Return the similarity from the sparse model's world to the scene frame.

    Corners farther off than max(3 medians, 2 mm) are dropped once.

    Raises:
        UserError: too few tags were located, or they are not as large or do not lie as ``tags.yaml`` says.
    """
    if len(located) < settings.least_tags:
        seen = ", ".join(str(number) for number in located) or "none"
        raise UserError(
            f"located {len(located)} of the {len(layout.numbers())} tags in tags.yaml ({seen}), {settings.least_tags} "
            "are needed; keep them in view of at least three sharp photos each, or correct their numbers and family."
        )
    truth = layout.corners()
    keys = [(number, corner) for number, corners in sorted(located.items()) for corner in sorted(corners)]
    source = np.array([located[number][corner] for number, corner in keys])
    target = np.array([truth[number][corner] for number, corner in keys])
    if len(keys) < 4:
        raise UserError("fewer than four tag corners were located; take sharper photos of the tags.")
    _check_size(located, layout, settings.largest_residual)
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
