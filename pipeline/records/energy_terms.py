"""The terms of the grasp energy: their order in the kernel, their weights, and their columns in tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.records.parameters.synthesize import EnergyParameters, StyleParameters

WEIGHT = "weight"  # in a field's metadata: the name of its weight, see :func:`weights`


@dataclass(frozen=True)
class Terms:
    """Energies of a batch of grasps and their unweighted terms, each (B,)."""

    energy: NDArray[np.float64]
    # Dimensionless where torques are divided by the object's size.
    force_closure: NDArray[np.float64] = field(metadata={WEIGHT: "force_closure"})
    # m, sum over contacts.
    distance: NDArray[np.float64] = field(metadata={WEIGHT: "distance"})
    # m, sum over object surface points of their depth in the deepest hand part.
    penetration: NDArray[np.float64] = field(metadata={WEIGHT: "penetration"})
    # m, sum over hand (and flange) surface points.
    table: NDArray[np.float64] = field(metadata={WEIGHT: "penetration"})
    # m, sum over hand surface points.
    self_penetration: NDArray[np.float64] = field(metadata={WEIGHT: "self_penetration"})
    # rad beyond limits.
    joints: NDArray[np.float64] = field(metadata={WEIGHT: "joints"})
    # m2, squared distance of the contacts' middle from the centre of mass.
    offset: NDArray[np.float64] = field(metadata={WEIGHT: "offset"})
    # m, sum over points that the other object of a pair and its fingers need.
    keep_out: NDArray[np.float64] = field(metadata={WEIGHT: "penetration"})

    def weighted(self, weights: Mapping[str, float]) -> Terms:
        """Return the same terms with the energy that their weights give; terms of one weight are summed first."""
        totals: dict[str, NDArray[np.float64]] = {}
        for name, weight in WEIGHTS.items():
            term = getattr(self, name)
            totals[weight] = totals[weight] + term if weight in totals else term
        energy = sum(weights[weight] * total for weight, total in totals.items())
        return replace(self, energy=np.asarray(energy, np.float64))

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Return energy and terms by the names of their columns."""
        return {column: getattr(self, name) for name, column in COLUMNS.items()}


WEIGHTS = {item.name: item.metadata[WEIGHT] for item in fields(Terms) if WEIGHT in item.metadata}  # in kernel order
COLUMNS = {"energy": "energy"} | {name: f"energy_{name}" for name in WEIGHTS}


def weights(energy: EnergyParameters, style: StyleParameters) -> dict[str, float]:
    """Return the weights of the terms for grasps of one style, which has its own weight of the offset."""
    common = {name: getattr(energy, f"weight_{name}") for name in WEIGHTS.values() if name != "offset"}
    return common | {"offset": style.weight_offset}


def index_of(term: str) -> int:
    """Return the place of a term among the kernel's."""
    return list(WEIGHTS).index(term)
