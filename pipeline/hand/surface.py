"""Sample points on the hand's collision surface, and on flange and mount behind it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from functools import lru_cache

import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.hand.assets import panda_description
from pipeline.hand.model import Hand
from pipeline.hand.urdf import origin_matrix
from pipeline.records.parameters.hand import FLANGE_LINK

DENSITY_FACTOR = 20  # raw samples per kept point


def farthest_points(points: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return indices (count,) of farthest-point samples, beginning with the first point; ties go to the lower index."""
    chosen = np.zeros(count, dtype=np.int64)
    distance = np.full(len(points), np.inf)
    for index in range(1, count):
        distance = np.minimum(distance, ((points - points[chosen[index - 1]]) ** 2).sum(1))
        chosen[index] = int(distance.argmax())
    return chosen


def _box_samples(half: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    areas = np.array([half[1] * half[2], half[0] * half[2], half[0] * half[1]])
    axis = rng.choice(3, count, p=areas / areas.sum())
    points = rng.uniform(-1, 1, (count, 3)) * half
    points[np.arange(count), axis] = np.where(rng.random(count) < 0.5, -1.0, 1.0) * half[axis]
    return points


@lru_cache(maxsize=8)
def hand_surface(count: int, hand: Hand) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return links (count,) and points (count, 3) in link frames, spread over all collision shapes by area.

    The points are the same in every process: they are farthest-point samples of a fixed random draw.
    """
    rng = np.random.Generator(np.random.PCG64(0))
    box_areas = 8 * (hand.box_half * np.roll(hand.box_half, 1, axis=1)).sum(1)
    sphere_areas = 4 * np.pi * hand.sphere_radius**2
    areas = np.concatenate([box_areas, sphere_areas])
    exact = areas / areas.sum() * count
    counts = np.floor(exact).astype(int)
    counts[np.argsort(-(exact - counts), kind="stable")[: count - counts.sum()]] += 1
    links, points = [], []
    for shape, number in enumerate(counts):
        raw_count = int(number) * DENSITY_FACTOR
        if shape < len(hand.box_link):
            pose = hand.box_pose[shape]
            raw = _box_samples(hand.box_half[shape], raw_count, rng) @ pose[:3, :3].T + pose[:3, 3]
            link = hand.box_link[shape]
        else:
            sphere = shape - len(hand.box_link)
            direction = rng.normal(size=(raw_count, 3))
            unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
            raw = hand.sphere_centre[sphere] + hand.sphere_radius[sphere] * unit
            link = hand.sphere_link[sphere]
        points.append(raw[farthest_points(raw, int(number))])
        links.append(np.full(number, link))
    return np.concatenate(links), np.concatenate(points)


@lru_cache(maxsize=4)
def mount_surface(hand: Hand, count: int = 200) -> NDArray[np.float64]:
    """Return points (count, 3), hand frame, on the convex hulls of panda_link7 and of the box of the hand's mount.

    They are rigid in the hand frame, whatever the fingers do.
    """
    mount = hand.mount
    assert mount is not None
    root = ElementTree.parse(panda_description()).getroot()
    collision = root.find(f"link[@name='{FLANGE_LINK}']/collision")
    assert collision is not None
    mesh = collision.find("geometry/mesh")
    assert mesh is not None
    flange = trimesh.load_mesh(panda_description().parent / mesh.get("filename", ""))
    flange = flange.convex_hull.apply_transform(origin_matrix(collision.find("origin")))
    corners = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3) * mount.box_half
    box_pose = mount.T_link7_box
    rng = np.random.Generator(np.random.PCG64(0))
    raw = np.concatenate(
        [
            flange.vertices,
            trimesh.sample.sample_surface(flange, count * 5, seed=0)[0],
            corners @ box_pose[:3, :3].T + box_pose[:3, 3],
            _box_samples(mount.box_half, count * 2, rng) @ box_pose[:3, :3].T + box_pose[:3, 3],
        ]
    )
    T_hand_link7 = np.linalg.inv(mount.T_link7_hand)
    raw = raw @ T_hand_link7[:3, :3].T + T_hand_link7[:3, 3]
    return raw[farthest_points(raw, count)]
