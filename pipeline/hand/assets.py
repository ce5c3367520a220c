"""Where the robot descriptions lie: inside the installed mani_skill package, found without importing it."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from pipeline.records.errors import UserError


def robot_assets() -> Path:
    """Return the folder of mani_skill that holds ``allegro/`` and ``panda/``.

    Raises:
        UserError: mani_skill is not installed.
    """
    spec = find_spec("mani_skill")
    if spec is None or not spec.submodule_search_locations:
        raise UserError("the package mani_skill is not installed; run `./dev doctor` to set the environment up.")
    return Path(spec.submodule_search_locations[0]) / "assets" / "robots"


def panda_description() -> Path:
    """URDF of the Panda arm with stock joint limits, with its meshes beside it."""
    return robot_assets() / "panda" / "panda_v2.urdf"
