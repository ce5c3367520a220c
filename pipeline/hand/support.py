"""What an object stands on while it is picked: a plane, or a post on a lower plane; the hand may not enter either."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.records.parameters.picks import PickParameters


@dataclass(frozen=True)
class Support:
    """The plane at the object's bottom; with a finite half width only a square post under the object's origin."""

    half_width: float = np.inf  # m
    height: float = 0.0  # m, of the post over the plane that it stands on

    def level(
        self, top: float, lowest: NDArray[np.float64], highest: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Return the height z (n,), m, below which points are inside the support or what it stands on.

        Args:
            top: m, z of the object's bottom, where the support ends.
            lowest: (n, 3) m, points in the object's frame; of points that move, the least coordinates on their way.
            highest: (n, 3) m, the largest coordinates of points that move.
        """
        highest = lowest if highest is None else highest
        beside = ((lowest[:, :2] > self.half_width) | (highest[:, :2] < -self.half_width)).any(1)
        return np.where(beside, top - self.height, top)


PLANE = Support()


def support_of(pick: PickParameters | None) -> Support:
    """Return what an object stands on; a post is taken as wide as it may be beside the object's middle."""
    if pick is None or pick.post is None:
        return PLANE
    return Support(pick.post.width / 2 + pick.post.margin, pick.post.height)
