"""Whether an object rested while its photos were taken."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.reconstruct.plane_sweep import DepthMap
from pipeline.records.errors import UserError

UNLIKE = 0.7  # of the median likeness, below which two photos show something else on the surface
TELLING_LIKENESS = 0.5  # median below which too little texture is there to tell by likeness
LARGEST_CONTRADICTION = 0.3  # share of shared sightings, from which on two photos contradict each other
# An object was moved between two photos when the pairs of photos across that moment contradict each other, and those on
# one side of it agree: gloss, faint texture and wrong matches contradict anywhere. Shares of the pairs.
LEAST_ACROSS, LARGEST_WITHIN = 0.6, 0.2
LEAST_PAIRS, LEAST_PHOTOS = 8, 3  # across, and on each side


Pairs = dict[tuple[int, int], bool]  # whether two photos contradict each other, where they tell


def pairs_by_depth(contradictions: Sequence[tuple[int, int, float]]) -> Pairs:
    """Return per pair of photos whether one looks through what the other measured."""
    found: Pairs = {}
    for one, other, share in contradictions:
        pair = (min(one, other), max(one, other))
        found[pair] = found.get(pair, False) or share > LARGEST_CONTRADICTION
    return found


def pairs_by_likeness(maps: Sequence[DepthMap]) -> Pairs:
    """Return per pair of photos whether they show something else on the surface; none where little texture is."""
    alike = [value for depth in maps for _, value in depth.likeness]
    usual = float(np.median(alike)) if alike else 0.0
    if usual <= TELLING_LIKENESS:
        return {}
    found: Pairs = {}
    for depth in maps:
        for other, value in depth.likeness:
            pair = (min(depth.view, other), max(depth.view, other))
            found[pair] = found.get(pair, False) or value < UNLIKE * usual
    return found


def moved_before(pairs: Pairs) -> tuple[int, float] | None:
    """Return the first photo after an object was moved, and the share of pairs across that contradict; None at rest."""
    if not pairs:
        return None
    both: NDArray[np.int64] = np.array(list(pairs), np.int64)
    bad = np.array(list(pairs.values()))
    best = None
    for first in np.unique(both)[LEAST_PHOTOS:]:
        before = both < first
        across = before[:, 0] != before[:, 1]
        if across.sum() < LEAST_PAIRS or len(np.unique(both[~before])) < LEAST_PHOTOS:
            continue
        share = float(bad[across].mean())
        within = float(bad[~across].mean()) if (~across).any() else 1.0
        if share >= LEAST_ACROSS and within <= LARGEST_WITHIN and (best is None or share - within > best[2]):
            best = (int(first), share, share - within)
    return None if best is None else best[:2]


def check_at_rest(
    name: str, contradictions: Sequence[tuple[int, int, float]], maps: Sequence[DepthMap], photos: Sequence[str]
) -> None:
    """Refuse an object of which the photos before and after some moment contradict each other.

    Args:
        photos: names of all views, in the order in which they were taken.

    Raises:
        UserError: it was moved between the photos.
    """
    moved = moved_before(pairs_by_likeness(maps)) or moved_before(pairs_by_depth(contradictions))
    if moved is not None:
        first, share = moved
        raise UserError(
            f"{name} was moved between the photos, it seems: those before {photos[first]} and those from it on "
            f"contradict each other about it in {share:.0%} of the pairs; take all photos again and touch nothing."
        )
