"""Which shapes meet in MuJoCo, with which friction, and how stiff a contact is.

MuJoCo would take the larger of two frictions; this project averages them, so every pair of shapes that can meet is
stated. A contact is a critically damped spring in MuJoCo. Let ``A`` be the inverse mass that it moves, ``T`` its time
constant and ``d`` its impedance: pressed by a force N for good it overlaps by about ``A (1 - d) d T^2 N``, and under
a tangential force F that friction bears it creeps at about ``A (1 - d) T F / (2 s)``, ``s`` being the setting
``friction_stiffness``. For an object of 40 g under 6 N and its own weight that is 0.1 mm, and 0.2 mm in 2.5 s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

from pipeline.physics.engine import torsional_friction
from pipeline.records.parameters.physics import PhysicsParameters

TIME_CONSTANT = 0.004  # s; MuJoCo is stable from two time steps on, 0.002 s
IMPEDANCE = (0.95, 0.99, 0.001, 0.5, 2.0)  # at an overlap of 0 and of 0.001 m, and how it grows between


@dataclass(frozen=True)
class Surface:
    """A collision shape."""

    geom: str  # its name
    body: str  # name of the body that it belongs to
    friction: float
    patch_radius: float  # m, of the contact patch that gives it torsional friction; 0 without
    fixed: bool  # no force moves it


def add_pairs(
    spec: Any, surfaces: Sequence[Surface], never_meet: Callable[[str, str], bool], settings: PhysicsParameters
) -> None:
    """Let all shapes meet that are of different bodies, unless neither moves or ``never_meet`` of their bodies."""
    for first, second in combinations(surfaces, 2):
        if first.body == second.body or first.fixed and second.fixed or never_meet(first.body, second.body):
            continue
        friction = (first.friction + second.friction) / 2
        torsion = torsional_friction(friction, max(first.patch_radius, second.patch_radius))
        spec.add_pair(
            geomname1=first.geom,
            geomname2=second.geom,
            condim=4 if torsion else 3,
            friction=[friction, friction, torsion, 0.0, 0.0],
            solref=[TIME_CONSTANT, 1.0],
            solimp=IMPEDANCE,
        )
