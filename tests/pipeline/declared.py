"""What `dvc.yaml` declares, and what the code truly imports."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import yaml

# Packages that take long to load: nothing may do so before the parameters were checked.
HEAVY = {
    "torch",
    "warp",
    "sapien",
    "mani_skill",
    "open3d",
    "pinocchio",
    "coal",
    "trimesh",
    "mlflow",
    "plotly",
    "pycolmap",
    "cv2",
}


@dataclass(frozen=True)
class Stage:
    """One item of `dvc.yaml` after interpolation."""

    name: str
    command: str
    dependencies: tuple[str, ...]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def room(self) -> str:
        """The stage's folder below `pipeline`."""
        return self.module.split(".")[1]

    @property
    def module(self) -> str:
        """The module that the command runs, such as `pipeline.merge.__main__` or `pipeline.train.sample`."""
        match = re.search(r"python -m (pipeline\.\w+)(\.\w+)?(?: |$)", self.command)
        assert match, self.command
        return match[1] + (match[2] or ".__main__")

    @property
    def options(self) -> dict[str, str]:
        """The command line's options, such as {"style": "pinch", "object": "cube"}."""
        return dict(re.findall(r"--(\w+) (\S+)", self.command))

    def sections(self) -> list[str]:
        """What the stage's own ``sections()`` says for these options."""
        function = import_module(self.module).sections
        known = {**self.options, "object_name": self.options.get("object", "")}
        return function(**{name: known.get(name, "") for name in inspect.signature(function).parameters})


def _filled(value, variables: dict[str, str]):
    if isinstance(value, dict):
        return [_filled(key, variables) for key in value][0]
    return re.sub(r"\$\{([\w.]+)\}", lambda match: variables[match[1]], value)


def _items(body: dict) -> list[tuple[str, dict[str, str]]]:
    """Names of the items of a ``foreach`` list or dictionary, with what their variables stand for."""
    each = body.get("foreach")
    if each is None:
        return [("", {})]
    if isinstance(each, list):
        return [(f"@{name}", {"item": name}) for name in each]
    return [
        (f"@{name}", {"key": name, **{f"item.{field}": str(value) for field, value in fields.items()}})
        for name, fields in each.items()
    ]


def declared_stages(root: Path) -> list[Stage]:
    """Return all stages of ``dvc.yaml``, for the hand of ``params.yaml``; their lines of code.yaml are left out."""
    content = yaml.safe_load((root / "dvc.yaml").read_text())
    hand = yaml.safe_load((root / "params.yaml").read_text())["hand"]
    found = []
    for name, stage in content["stages"].items():
        body = stage.get("do", stage)
        for suffix, own in _items(stage):
            variables = {"hand": hand, **own}
            found.append(
                Stage(
                    name=name + suffix,
                    command=_filled(body["cmd"], variables),
                    dependencies=tuple(_filled(entry, variables) for entry in body["deps"]),
                    parameters=tuple(
                        _filled(entry, variables) for entry in body.get("params", []) if isinstance(entry, str)
                    ),
                    outputs=tuple(
                        _filled(entry, variables) for entry in [*body.get("outs", []), *body.get("metrics", [])]
                    ),
                )
            )
    return found


def _module_file(root: Path, module: str) -> Path | None:
    path = root.joinpath(*module.split("."))
    for candidate in (path.with_suffix(".py"), path / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None


def _imported(root: Path, source: Path) -> Iterator[str]:
    """Names of first-party modules that ``source`` imports anywhere, also inside functions."""
    package = source.relative_to(root).parent.parts
    for node in ast.walk(ast.parse(source.read_text())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(filter(None, [base, node.module or ""]))
            names = [module, *(f"{module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names = re.findall(r"^pipeline(?:\.\w+)+$", node.value)  # import_module("pipeline.x") and the like
        for name in names:
            if name.split(".")[0] == "pipeline" and _module_file(root, name):
                yield name


def true_imports(root: Path, module: str) -> set[Path]:
    """Return the first-party files that ``module`` loads, transitively, relative to ``root``."""
    seen: set[Path] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        for length in range(1, name.count(".") + 2):  # importing a.b.c runs a and a.b
            path = _module_file(root, ".".join(name.split(".")[:length]))
            if path is not None and path.relative_to(root) not in seen:
                seen.add(path.relative_to(root))
                waiting.extend(_imported(root, path))
    return seen
