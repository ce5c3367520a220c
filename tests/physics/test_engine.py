"""Tests of grasps and trials need nothing but the interface of an engine, and nobody goes round it."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NOT_PHYSICS = {("replay", "sapien_camera"), ("hand", "mjcf")}  # pictures by its renderer; reading MuJoCo's own format


def imports(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def test_engines_stay_behind_the_interface() -> None:
    for path in sorted((ROOT / "pipeline").rglob("*.py")):
        room, name = path.parent.name, path.stem
        used = imports(path)
        for engine in ("sapien", "mujoco"):
            package = {module for module in used if module.split(".")[0] == engine}
            behind = {module for module in used if module.startswith(f"pipeline.physics.{engine}_")}
            if (room, name) == ("validate", "table"):  # the gravities of all candidates at once on a GPU
                behind = {module for module in behind if not module.startswith("pipeline.physics.sapien_holding")}
            if room != "physics" or not (name == "world" or name.startswith(f"{engine}_")):
                assert not behind, path
                assert not package or (room, name) in NOT_PHYSICS, path
