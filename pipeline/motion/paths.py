"""Joint paths without collisions: straight lines, RRT-Connect, shortcuts, and straight motions of the hand.

The planner is our own because a trial must replay from its seed: OMPL's generator can be seeded once per process only.
A path is (n, 7) way-points, joined by straight lines in joint space.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.motion.arm_model import ArmModel
from pipeline.motion.inverse_kinematics import solve_from

Free = Callable[[NDArray[np.float64]], bool]
LONGEST_EDGE = 0.4  # rad, Euclidean, of the planner's trees
SAMPLES = 400  # that the planner draws before it gives up
SHORTCUTS = 60  # tried on a path
RESOLUTION = 0.01  # rad, largest joint change between tested points of a line
NEAR_DUPLICATE = 0.02  # rad, way-points closer than this make splines swing
LINE_STEP = 0.005  # m, between tested points of a straight motion of the hand
LARGEST_JUMP = 0.3  # rad, joint change per such step that would be a change of branch


def line(first: NDArray[np.float64], last: NDArray[np.float64], resolution: float = RESOLUTION) -> NDArray[np.float64]:
    """Return points (n, 7) from ``first`` to ``last``, at most ``resolution`` apart in every joint."""
    count = max(int(np.ceil(np.abs(last - first).max() / resolution)), 1)
    points = first + np.linspace(0.0, 1.0, count + 1)[:, None] * (last - first)
    points[-1] = last  # exactly, whatever the rounding
    return points


def is_line_free(free: Free, first: NDArray[np.float64], last: NDArray[np.float64]) -> bool:
    """Whether the straight joint line is free; its ends are tested first, then the middle, as that fails soonest."""
    points = line(first, last)
    order = sorted(range(len(points)), key=lambda index: -_halvings(index, len(points) - 1))
    return all(free(points[index]) for index in order)


def _halvings(index: int, last: int) -> int:
    """How early an index is met when an interval 0...last is halved again and again (larger is earlier)."""
    if index in (0, last):
        return 64
    return (index & -index).bit_length()


def rrt_connect(
    free: Free,
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    rng: np.random.Generator,
) -> NDArray[np.float64] | None:
    """Return a path (n, 7) found by RRT-Connect (Kuffner and LaValle 2000), or None.

    Args:
        free: collision test; ``start`` and ``goal`` must pass it.
        lower, upper: (7,) limits of the samples, rad.
    """
    trees = [_Tree(start), _Tree(goal)]
    for iteration in range(SAMPLES):
        growing, other = trees[iteration % 2], trees[1 - iteration % 2]
        node = growing.extend(free, rng.uniform(lower, upper))
        if node is None:
            continue
        target = growing.points[node]
        reached = other.connect(free, target)
        if reached is not None:
            one, two = growing.branch(node), other.branch(reached)
            path = np.array(one + two[::-1][1:])
            return path if iteration % 2 == 0 else path[::-1].copy()
    return None


class _Tree:
    """Points with parents, rooted at the first."""

    def __init__(self, root: NDArray[np.float64]) -> None:
        self.points = [root]
        self.parents = [-1]

    def extend(self, free: Free, target: NDArray[np.float64]) -> int | None:
        """Add one edge from the nearest point towards ``target``; return the new point's index or None."""
        nearest = int(np.linalg.norm(np.array(self.points) - target, axis=1).argmin())
        return self._add(free, nearest, target)

    def _add(self, free: Free, parent: int, target: NDArray[np.float64]) -> int | None:
        difference = target - self.points[parent]
        length = np.linalg.norm(difference)
        new = target if length <= LONGEST_EDGE else self.points[parent] + difference * (LONGEST_EDGE / length)
        if not is_line_free(free, self.points[parent], new):
            return None
        self.points.append(new)
        self.parents.append(parent)
        return len(self.points) - 1

    def connect(self, free: Free, target: NDArray[np.float64]) -> int | None:
        """Add edges until ``target`` is reached (return its index) or something is in the way (None)."""
        node = self.extend(free, target)
        while node is not None and self.points[node] is not target:
            node = self._add(free, node, target)
        return node

    def branch(self, node: int) -> list[NDArray[np.float64]]:
        """Points from the root to ``node``."""
        path = []
        while node >= 0:
            path.append(self.points[node])
            node = self.parents[node]
        return path[::-1]


def shortcut(free: Free, path: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a shorter path (m, 7): random pairs of points on it are joined by free straight lines."""
    for _ in range(SHORTCUTS):
        if len(path) < 3:
            break
        lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(lengths)])
        a, b = np.sort(rng.uniform(0.0, along[-1], 2))
        i, j = (min(int(np.searchsorted(along, x, side="right")), len(lengths)) - 1 for x in (a, b))
        if i == j:
            continue
        first, last = (path[k] + (x - along[k]) / lengths[k] * (path[k + 1] - path[k]) for k, x in ((i, a), (j, b)))
        if is_line_free(free, first, last):
            path = np.concatenate([path[: i + 1], [first, last], path[j + 1 :]])
    return without_near_duplicates(path)


def without_near_duplicates(path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Drop way-points closer than ``NEAR_DUPLICATE`` to the one before; both ends stay."""
    kept = [path[0]]
    for point in path[1:-1]:
        if min(np.linalg.norm(point - kept[-1]), np.linalg.norm(point - path[-1])) >= NEAR_DUPLICATE:
            kept.append(point)
    return np.array([*kept, path[-1]])


def plan(
    free: Free,
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    lower: NDArray[np.float64],
    upper: NDArray[np.float64],
    rng: np.random.Generator,
) -> NDArray[np.float64] | None:
    """Return a free path (n, 7) from ``start`` to ``goal``, the straight line if that is free, or None."""
    if not free(start) or not free(goal):
        return None
    if is_line_free(free, start, goal):
        return np.array([start, goal])
    path = rrt_connect(free, start, goal, lower, upper, rng)
    return None if path is None else shortcut(free, path, rng)


def hand_line(arm: ArmModel, q: NDArray[np.float64], displacement: ArrayLike, free: Free) -> NDArray[np.float64] | None:
    """Return a path (n, 7) that moves the hand straight by ``displacement`` (3,), m, world frame, unturned.

    None when it leaves the arm's reach, jumps to another branch, or hits something. The first point is not tested.
    """
    displacement = np.asarray(displacement, np.float64)
    count = max(int(np.ceil(np.linalg.norm(displacement) / LINE_STEP)), 1)
    T = arm.hand_pose(q)
    begin = T[:3, 3].copy()
    path = [q]
    for index in range(1, count + 1):
        T[:3, 3] = begin + displacement * (index / count)
        following = solve_from(arm, T, path[-1], iterations=15)
        if following is None or np.abs(following - path[-1]).max() > LARGEST_JUMP or not free(following):
            return None
        path.append(following)
    return np.array(path)
