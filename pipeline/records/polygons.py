"""OFF and OBJ files with polygons, which are cut into triangles that cover just the polygon, even a concave one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

MOST_CORNERS = 2000  # of one polygon; cutting it takes the square of their number

Surface = tuple[NDArray[np.float64], NDArray[np.int64]]


def read_off(content: bytes) -> Surface:
    """Return vertices (V, 3) and triangles (F, 3) of a text file in OFF, with or without colours.

    Raises:
        ValueError: it is no such file.
    """
    lines = _lines(content)
    head = next(lines, [""])
    if not head[0].upper().endswith("OFF"):
        raise ValueError("it does not begin with OFF")
    if "BINARY" in (word.upper() for word in head):
        raise ValueError("binary OFF is not read")
    if "4" in head[0] or "n" in head[0]:
        raise ValueError(f"{head[0]} has other than three dimensions")
    counts = head[1:] or next(lines, [])
    if len(counts) < 2:
        raise ValueError("its numbers of vertices and faces are missing")
    vertices = [_numbers(row, 3) for _, row in zip(range(int(counts[0])), lines, strict=False)]
    polygons = []
    for _, row in zip(range(int(counts[1])), lines, strict=False):
        corners = int(row[0])
        if len(row) <= corners:
            raise ValueError("a face has fewer corners than it says")
        polygons.append([int(corner) for corner in row[1 : corners + 1]])
    if len(vertices) < int(counts[0]) or len(polygons) < int(counts[1]):
        raise ValueError("it ends before all that it announces")
    return _triangles(np.array(vertices).reshape(-1, 3), polygons)


def read_obj(content: bytes) -> Surface:
    """Return vertices (V, 3) and triangles (F, 3) of all groups of an OBJ file.

    Raises:
        ValueError: a line is no vertex or face.
    """
    vertices: list[list[float]] = []
    polygons: list[list[int]] = []
    for row in _lines(content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")):
        if row[0] == "v":
            vertices.append(_numbers(row[1:], 3))
        elif row[0] == "f":
            corners = [int(corner.split("/")[0]) for corner in row[1:]]
            polygons.append([corner - 1 if corner > 0 else len(vertices) + corner for corner in corners])
    return _triangles(np.array(vertices).reshape(-1, 3), polygons)


def has_polygons(content: bytes) -> bool:
    """Return whether an OBJ file has faces of more than three corners."""
    return any(line.startswith(b"f") and len(line.split()) > 4 for line in content.splitlines())


def _lines(content: bytes) -> Iterator[list[str]]:
    for line in content.decode("utf-8", errors="replace").splitlines():
        if row := line.split("#", 1)[0].split():
            yield row


def _numbers(row: Sequence[str], count: int) -> list[float]:
    if len(row) < count:
        raise ValueError("a vertex has fewer than three coordinates")
    return [float(value) for value in row[:count]]


def _triangles(vertices: NDArray[np.float64], polygons: Sequence[Sequence[int]]) -> Surface:
    found: list[Sequence[int]] = []
    for polygon in polygons:
        if len(polygon) < 3:
            continue
        if min(polygon) < 0 or max(polygon) >= len(vertices):
            raise ValueError("its faces refer to vertices that it does not hold")
        found += [polygon] if len(polygon) == 3 else cut(vertices, polygon)
    return vertices, np.array(found, np.int64).reshape(-1, 3)


def cut(vertices: NDArray[np.float64], polygon: Sequence[int]) -> list[tuple[int, int, int]]:
    """Return the triangles, as indices into ``vertices`` (V, 3), that a flat or nearly flat polygon consists of.

    Raises:
        ValueError: it has too many corners.
    """
    if len(polygon) > MOST_CORNERS:
        raise ValueError(f"a face has {len(polygon)} corners; at most {MOST_CORNERS} are read")
    corners = vertices[list(polygon)]
    after = np.roll(corners, -1, axis=0)
    normal = np.cross(corners, after).sum(axis=0)  # Newell: twice the area
    axis = int(np.abs(normal).argmax())
    x, y = ((axis + 1) % 3, (axis + 2) % 3) if normal[axis] >= 0 else ((axis + 2) % 3, (axis + 1) % 3)
    flat = corners[:, [x, y]]
    left = list(range(len(polygon)))
    found = []
    while len(left) > 3:
        ear = next((place for place in range(len(left)) if _is_ear(flat, left, place)), 0)
        found.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return [(polygon[a], polygon[b], polygon[c]) for a, b, c in [*found, (left[0], left[1], left[2])]]


def _is_ear(flat: NDArray[np.float64], left: Sequence[int], place: int) -> bool:
    """Return whether the triangle at a corner lies within the counter-clockwise polygon ``left``."""
    one, own, other = left[place - 1], left[place], left[(place + 1) % len(left)]
    a, b, c = flat[[one, own, other]]
    if _turn(a, b, c) <= 0:
        return False
    rest = flat[[corner for corner in left if corner not in (one, own, other)]]
    inside = (_turn(a, b, rest.T) >= 0) & (_turn(b, c, rest.T) >= 0) & (_turn(c, a, rest.T) >= 0)
    return not inside.any()


def _turn(a: NDArray[np.float64], b: NDArray[np.float64], p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return twice the signed area of the triangle a, b, p; ``p`` may be (2, n)."""
    result: NDArray[np.float64] = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
    return result
