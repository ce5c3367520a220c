"""What a repair has changed: the surfaces of file and object held against each other, both ways; and the limits.

A figure is a share of a surface's area that lies further than :data:`NEAR` from the other surface. Repairs that merge,
drop repeated faces or turn them change nothing; a filled hole adds surface, a dropped sheet loses some, a filled cavity
adds volume.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.shapes.mass import solid_properties
from pipeline.shapes.rays import ray_scene

Surface = tuple[NDArray[np.float64], NDArray[np.int64]]

NEAR = 0.01  # of the largest extent
SAMPLES = 20_000  # on either surface
MOST_ADDED = 0.08  # of the new surface, that the file does not have
WIDEST_HOLE = 0.45  # of the smallest extent, between a filled hole's middle and its rim; a vessel's mouth is wider
MOST_LOST = 0.05  # of the file's surface, that is outside of the object
MOST_FILLED = 0.10  # of the file's volume, that filled cavities add
NOTABLE = 1e-4  # of the largest extent, and of the volume; below, nothing is recorded


@dataclass(frozen=True)
class Change:
    """How the surface of a file became that of a solid; lengths in m, volumes in m3, shares of areas."""

    added_share: float  # of the new surface, further than NEAR from the file's
    added_distance: float  # of the new surface from the file's, at most
    lost_share: float  # of the file's surface, further than NEAR outside of the new one
    lost_distance: float
    inner_share: float  # of the file's surface, further than NEAR inside the new one
    volume_in_file: float | None  # None: the surface in the file is not closed
    volume: float
    extents_in_file: tuple[float, float, float]
    extents: tuple[float, float, float]
    genus_in_file: int | None
    genus: int

    @property
    def notable(self) -> bool:
        """Whether anything has changed."""
        size = NOTABLE * max(self.extents_in_file)
        before = self.volume if self.volume_in_file is None else self.volume_in_file
        return (
            max(self.added_distance, self.lost_distance) > size
            or self.inner_share > 0
            or abs(self.volume - before) > NOTABLE * abs(before)
            or self.genus_in_file not in (None, self.genus)
        )

    def record(self) -> dict[str, Any]:
        """Return the figures for the record of a prepared object."""
        return asdict(self)


def sampled(surface: Surface, count: int) -> NDArray[np.float32]:
    """Return points (count, 3) spread evenly over the area of a surface, the same every time."""
    vertices, faces = surface
    a, b, c = vertices[faces].transpose(1, 0, 2)
    areas = np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))
    random = np.random.default_rng(0)
    places = (np.arange(count) + random.random(count)) / count * areas[-1]
    face = np.minimum(np.searchsorted(areas, places), len(faces) - 1)
    u, v = random.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return (a[face] + u * (b - a)[face] + v * (c - a)[face]).astype(np.float32)


def _welded(surface: Surface) -> Surface:
    vertices, faces = surface
    cells = np.round(vertices / (1e-7 * np.ptp(vertices, axis=0).max())).astype(np.int64)
    _, first, index = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return vertices[first], index.ravel()[faces]


def _topology(surface: Surface) -> tuple[bool, int]:
    """Return whether a surface is closed and consistently turned, and its genus if it is one surface."""
    faces = surface[1]
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = int(faces.max()) + 1
    forward, backward = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    closed = len(np.unique(forward)) == len(forward) and np.array_equal(np.sort(forward), np.sort(backward))
    euler = len(np.unique(faces)) - len(edges) // 2 + len(faces)
    return closed, (2 - euler) // 2


def compared(file: Surface, solid: Surface) -> Change:
    """Return what lies between the triangles of a file and the solid that was made of them, both in m."""
    used, index = np.unique(file[1], return_inverse=True)
    file = _welded((file[0][used], index.reshape(file[1].shape)))
    extents = [tuple(np.ptp(vertices, axis=0).tolist()) for vertices, _ in (file, solid)]
    near = NEAR * max(extents[0])
    added = ray_scene(file).compute_distance(sampled(solid, SAMPLES), nthreads=1).numpy()
    signed = ray_scene(solid).compute_signed_distance(sampled(file, SAMPLES), nthreads=1, nsamples=3).numpy()
    closed, genus = _topology(file)
    return Change(
        added_share=float((added > near).mean()),
        added_distance=float(added.max()),
        lost_share=float((signed > near).mean()),
        lost_distance=float(max(signed.max(), 0.0)),
        inner_share=float((signed < -near).mean()),
        volume_in_file=abs(solid_properties(*file)[0]) if closed else None,
        volume=solid_properties(*solid)[0],
        extents_in_file=extents[0],
        extents=extents[1],
        genus_in_file=genus if closed else None,
        genus=_topology(solid)[1],
    )


def check(change: Change, is_open: bool, name: str, whole: bool = True) -> None:
    """Refuse a repair that has made another shape.

    Args:
        is_open: whether the surface in the file has open edges.
        whole: whether all bodies of the file were to become the object.

    Raises:
        UserError: a limit is passed.
    """
    accept = "`accept_repair: true`"
    mouth = change.added_distance > WIDEST_HOLE * min(change.extents_in_file)
    if is_open and (mouth or change.added_share > MOST_ADDED):
        raise UserError(
            f"{name}: {change.added_share:.0%} of the solid's surface is not in the file, whose surface is open and "
            f"has no thickness there; set `wall: 0.002` for a vessel with a wall of 2 mm, or {accept} to have it "
            f"filled ({1e6 * change.volume:.1f} cm3)."
        )
    if change.added_share > MOST_ADDED:
        raise UserError(
            f"{name}: {change.added_share:.0%} of the repaired surface is not in the file (up to "
            f"{1000 * change.added_distance:.1f} mm away); mend the mesh in a modeller, or set {accept}."
        )
    if not whole:
        return
    if change.lost_share > MOST_LOST:
        raise UserError(
            f"{name}: the repair loses {change.lost_share:.0%} of the surface in the file (up to "
            f"{1000 * change.lost_distance:.1f} mm away); mend the mesh in a modeller, or set {accept}."
        )
    if change.volume_in_file is not None and change.volume > (1 + MOST_FILLED) * change.volume_in_file:
        raise UserError(
            f"{name}: filling its cavities changes the volume from {1e6 * change.volume_in_file:.1f} to "
            f"{1e6 * change.volume:.1f} cm3; set {accept} and a `density` that gives its mass."
        )


def table(record: dict[str, Any]) -> list[str]:
    """Return the lines of a table of what changed, file beside object; see :meth:`Change.record`."""

    def millimetres(extents: list[float]) -> str:
        return " x ".join(f"{1000 * extent:.1f}" for extent in extents)

    def or_open(value: Any, text: str) -> str:
        return "open" if value is None else text.format(value)

    in_file = record["volume_in_file"]
    rows = [
        ("", "in the file", "prepared"),
        ("extents, mm", millimetres(record["extents_in_file"]), millimetres(record["extents"])),
        (
            "volume, cm3",
            or_open(None if in_file is None else 1e6 * in_file, "{:.2f}"),
            f"{1e6 * record['volume']:.2f}",
        ),
        ("handles and tunnels", or_open(record["genus_in_file"], "{}"), str(record["genus"])),
        ("surface new, lost", f"{record['lost_share']:.1%} lost", f"{record['added_share']:.1%} new"),
        ("at most, mm", f"{1000 * record['lost_distance']:.2f}", f"{1000 * record['added_distance']:.2f}"),
        ("surface inside now", f"{record['inner_share']:.1%}", ""),
    ]
    return [f"  {what:20} {before:24} {after}".rstrip() for what, before, after in rows]
