"""The two engines with materials that both can take."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.records.parameters.physics import PhysicsParameters

in_both = pytest.mark.parametrize("engine", ["sapien", "mujoco"])


def settings(engine: str, friction: float | None = None, **changes: Any) -> PhysicsParameters:
    """Standard settings with one friction coefficient of the tips; ``friction``: that of all materials."""
    tip = PhysicsParameters().tip_dynamic_friction
    materials = {"tip_static_friction": tip, "tip_dynamic_friction": tip}
    if friction is not None:
        names = ("object", "tip_static", "tip_dynamic", "link", "support")
        materials = {f"{name}_friction": friction for name in names}
    return PhysicsParameters.model_validate({"engine": engine, **materials, **changes})


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T
