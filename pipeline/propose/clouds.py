"""Point clouds as depth cameras and tools give them: layouts, missing points, flying pixels, several bodies."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.records.errors import UserError

KINDS = (".npy", ".npz", ".pcd", ".xyz", ".txt", ".csv")
APART = 6.0  # times the typical distance of neighbours: points that are further from all others are another body
NOTABLE = 0.05  # of all points: a smaller group is taken for flying pixels
MOST_POINTS = 5_000_000
_PCD_TYPES = {("F", 4): "<f4", ("F", 8): "<f8", ("U", 1): "u1", ("U", 2): "<u2", ("U", 4): "<u4", ("I", 4): "<i4"}


@dataclass(frozen=True)
class Cleaned:
    """The points of one body, and what was left out, in words."""

    points: NDArray[np.float64]  # (n, 3)
    dropped: tuple[str, ...]


def read_cloud(source: Path) -> NDArray[np.float64]:
    """Return the points (n, 3) of a file of one of :data:`KINDS`, as they are there, missing ones included.

    Raises:
        OSError: it cannot be read.
        ValueError: it holds no points in a layout that is known.
    """
    content = source.read_bytes()
    try:
        return _points_in(content, source.suffix.lower())
    except Exception as error:  # the readers raise whatever the damage happens to trigger
        raise ValueError(" ".join(str(error).split())[:160] or type(error).__name__) from error


def _points_in(content: bytes, kind: str) -> NDArray[np.float64]:
    if kind == ".npy":
        return _as_points(np.load(io.BytesIO(content), allow_pickle=False))
    if kind == ".npz":
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            names = [name for name in arrays.files if "point" in name.lower() or name in ("xyz", "arr_0")]
            if len(names) != 1 and len(arrays.files) != 1:
                raise ValueError(f"it holds the arrays {', '.join(arrays.files[:6])}; name one of them `points`")
            return _as_points(arrays[(names or arrays.files)[0]])
    return _as_points(_pcd(content) if kind == ".pcd" else _text(content))


def _as_points(array: NDArray[Any]) -> NDArray[np.float64]:
    """Return an array in any usual layout as points (n, 3)."""
    if array.dtype.names:
        if not {"x", "y", "z"} <= set(array.dtype.names):
            raise ValueError(f"its fields are {', '.join(array.dtype.names)}; x, y and z are needed")
        array = np.stack([array[name] for name in "xyz"], axis=-1)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"it holds {array.dtype}, not numbers")
    shape = array.shape
    while array.ndim > 2 and array.shape[0] == 1:
        array = array[0]
    if array.ndim == 3 and array.shape[2] in (3, 4, 6):  # an image of points
        array = array.reshape(-1, array.shape[2])
    if array.ndim != 2:
        raise ValueError(f"it has the shape {shape}; a cloud is n x 3, height x width x 3 or 3 x n")
    if array.shape[0] in (3, 4) and array.shape[1] > 6:
        array = array.T
    if array.shape[1] < 3:
        raise ValueError(f"it has the shape {shape}; a cloud is n x 3, height x width x 3 or 3 x n")
    if len(array) > MOST_POINTS:
        raise ValueError(f"it holds {len(array)} points; at most {MOST_POINTS} are read")
    return np.asarray(array[:, :3], np.float64)


def _text(content: bytes) -> NDArray[np.float64]:
    """Return the first three numbers of every line, separated by spaces, commas or semicolons."""
    rows: list[list[float]] = []
    for number, line in enumerate(content.decode("utf-8", errors="replace").splitlines()):
        words = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        try:
            values = [float(word) for word in words[:3]]
        except ValueError as error:
            if not rows and number < 20:
                continue  # a header
            raise ValueError(f"line {number + 1} holds no numbers") from error
        if len(values) == 3:
            rows.append(values)
    return np.array(rows, np.float64).reshape(-1, 3)


def _pcd(content: bytes) -> NDArray[Any]:
    """Return the points of a PCD file, as text or binary."""
    head, found, body = content.partition(b"DATA ")
    if not found:
        raise ValueError("its header has no line DATA")
    kind, _, data = body.partition(b"\n")
    header = {row[0]: row[1:] for row in (line.split() for line in head.decode("ascii", "replace").splitlines()) if row}
    names, count = header["FIELDS"], int(header["POINTS"][0])
    if kind.strip() == b"ascii":
        columns = [names.index(axis) for axis in "xyz"]
        rows = [line.split() for line in data.decode("ascii", "replace").splitlines() if line.strip()]
        return np.array([[float(row[column]) for column in columns] for row in rows])
    if kind.strip() != b"binary":
        raise ValueError(f"its data are {kind.decode(errors='replace').strip()[:30]}; save it as binary or ascii")
    sizes = [int(size) for size in header["SIZE"]]
    lengths = [int(length) for length in header.get("COUNT", ["1"] * len(names))]
    fields = [
        (
            f"{name}_{place}" if name not in ("x", "y", "z") else name,
            _PCD_TYPES.get((kind_of, size), f"V{size}"),
            length,
        )
        for place, (name, kind_of, size, length) in enumerate(zip(names, header["TYPE"], sizes, lengths, strict=True))
    ]
    layout = np.dtype([(name, kind_of) if length == 1 else (name, kind_of, length) for name, kind_of, length in fields])
    if count * layout.itemsize > len(data):
        raise ValueError(f"it announces {count} points and holds {len(data) // layout.itemsize}")
    return np.frombuffer(data, layout, count)


def cleaned(points: NDArray[np.float64], where: str) -> Cleaned:
    """Return the valid points of one body.

    Cameras mark missing points by NaN or by zeros. A point at exactly the origin is missing if there are several.

    Raises:
        UserError: there are several bodies.
    """
    dropped: list[str] = []
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        dropped.append(f"{int((~finite).sum())} points that are no numbers")
        points = points[finite]
    zero = (points == 0).all(axis=1)
    if zero.sum() > 1:
        dropped.append(f"{int(zero.sum())} missing points (all zeros)")
        points = points[~zero]
    label = _groups(points)
    sizes = np.bincount(label) if len(label) else np.zeros(1, int)
    large = np.flatnonzero(sizes >= NOTABLE * len(points))
    if len(large) > 1:
        boxes = "; ".join(
            f"{sizes[each]} points around {np.array2string(points[label == each].mean(axis=0), precision=3)}"
            for each in sorted(large, key=lambda each: -sizes[each])[:4]
        )
        raise UserError(f"{where} holds {len(large)} bodies that do not touch ({boxes}); keep the points of one.")
    kept = label == sizes.argmax() if len(label) else np.zeros(0, bool)
    if not kept.all():
        dropped.append(f"{int((~kept).sum())} flying points, away from all others")
    return Cleaned(points[kept], tuple(dropped))


def _groups(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return a group for every point (n,): points of a group are linked by steps that are usual in the cloud."""
    if len(points) < 3:
        return np.zeros(len(points), np.int64)
    tree = cKDTree(points)
    usual = np.median(tree.query(points, k=min(5, len(points)))[0][:, -1])
    step = max(APART * float(usual), 1e-9)
    # Neighbours in cells of that step are linked cell by cell, as pairs of points can be too many.
    cells = np.floor((points - points.min(axis=0)) / step).astype(np.int64)
    occupied, cell = np.unique(cells, axis=0, return_inverse=True)
    pairs = cKDTree(occupied).query_pairs(1.8, output_type="ndarray")  # cells that touch, also by an edge or a corner
    graph = coo_matrix((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(len(occupied), len(occupied)))
    label: NDArray[np.int64] = connected_components(graph, directed=False)[1].astype(np.int64)
    return label[cell.ravel()]
