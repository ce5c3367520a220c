"""Evenly spread surface points with outward normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

RAW_PER_POINT = 10  # raw samples per kept point


def face_normals(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return unit normals (F, 3) and areas (F,) of faces."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    return normal / np.maximum(length, 1e-30)[:, None], length / 2


def area_samples(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], count: int, generator: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return ``count`` points (n, 3) uniform over the surface, and the face (n,) of each."""
    _, areas = face_normals(vertices, faces)
    cumulative = np.cumsum(areas)
    # Stratified along the cumulated area: every face gets its share to within one point.
    position = (np.arange(count) + generator.random(count)) / count * cumulative[-1]
    face = np.minimum(np.searchsorted(cumulative, position, side="right"), len(faces) - 1)
    u, v = generator.random((2, count))
    root = np.sqrt(u)
    weights = np.stack([1 - root, root * (1 - v), root * v], axis=1)
    return np.einsum("nk,nki->ni", weights, vertices[faces[face]]), face


def farthest_point_order(points: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Return indices (count,): the point farthest from the centroid, then always the point farthest from all chosen.

    Ties go to the lower index.
    """
    x, y, z = np.ascontiguousarray((points - points.mean(axis=0)).T, dtype=np.float32)
    distance = np.full(len(points), np.inf, np.float32)
    chosen = np.zeros(count, np.int64)
    last = int((x * x + y * y + z * z).argmax())
    for index in range(count):
        chosen[index] = last
        dx, dy, dz = x - x[last], y - y[last], z - z[last]
        np.minimum(distance, dx * dx + dy * dy + dz * dz, out=distance)
        last = int(distance.argmax())
    return chosen


def surface_samples(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], count: int, generator: np.random.Generator
) -> NDArray[np.float32]:
    """Return (count, 6): points and outward face normals in farthest-point order, float32 as saved."""
    raw, face = area_samples(vertices, faces, RAW_PER_POINT * count, generator)
    order = farthest_point_order(raw, count)
    normals, _ = face_normals(vertices, faces)
    return np.concatenate([raw[order], normals[face[order]]], axis=1).astype(np.float32)
