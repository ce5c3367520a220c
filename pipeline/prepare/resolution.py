"""Whether the distance grid holds the solid: narrow gaps, thin walls, a surface that passes through itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.shapes.distance_grid import DistanceGrid, distance_grid, enclosed_volume, volume_by_rays
from pipeline.shapes.mass import solid_properties

FINE = 0.05  # of the solid's volume; a grid that differs by more is made anew with FINER times the cells
FINER = 2
MOST_CELLS = 512  # along the longest axis
MOST = 0.10  # of the solid's volume; a grid that differs by more stands for another object
THROUGH_ITSELF = 0.03  # of the volume, by which rays and the sum over all faces differ


@dataclass(frozen=True)
class Resolved:
    """The distance grid of a solid, and how well it holds it."""

    grid: DistanceGrid
    difference: float  # of the volume inside the grid's zero surface from the solid's, as a share of the latter
    passes_through_itself: bool
    remarks: tuple[str, ...] = ()


def resolved(vertices: NDArray[np.float64], faces: NDArray[np.int64], parameters: PrepareParameters) -> Resolved:
    """Return the distance grid of a solid, finer than set where that is too coarse."""
    volume = solid_properties(vertices, faces)[0]

    def made(cells: int) -> tuple[DistanceGrid, float]:
        grid = distance_grid(vertices, faces, cells, parameters.distance_padding)
        return grid, enclosed_volume(grid) / volume - 1

    grid, difference = made(parameters.distance_cells)
    if abs(difference) <= FINE:
        return Resolved(grid, difference, False)
    if abs(volume_by_rays(vertices, faces) / volume - 1) > THROUGH_ITSELF:
        return Resolved(grid, difference, True)
    cells = min(FINER * parameters.distance_cells, MOST_CELLS)
    finer, left = made(cells)
    said = f"distance grid of {cells} cells, as {parameters.distance_cells} hold {1 + difference:.0%} of the volume"
    if abs(left) > FINE:
        said += f"; {cells} still hold {1 + left:.0%}"
    return Resolved(finer, left, False, (said,))


def check(resolved: Resolved, name: str) -> None:
    """Refuse a solid that the grid does not hold.

    Raises:
        UserError: its gaps or walls are too narrow, or its surface passes through itself.
    """
    if resolved.passes_through_itself:
        raise UserError(
            f"{name}: the surface passes through itself; mend the mesh in a modeller (a union with itself)."
        )
    if abs(resolved.difference) > MOST:
        what = "gaps" if resolved.difference > 0 else "walls"
        raise UserError(
            f"{name}: its {what} are narrower than the {1000 * resolved.grid.spacing:.2f} mm between points of the "
            f"distance grid, which holds {1 + resolved.difference:.0%} of the volume; raise `prepare.distance_cells`, "
            "make them wider, or set `accept_repair: true`."
        )
