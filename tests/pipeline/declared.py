"""What `dvc.yaml` declares."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import yaml

# What a run writes and git keeps.
IN_GIT = {
    "code.yaml",
    "dvc.lock",
    "reports/dataset.md",
    "reports/summary.json",
    "reports/tracking.json",
    "reports/durations.json",
    "reports/survival.csv",
    "reports/success.csv",
}
SETTINGS = "settings."  # what lines of code.yaml begin with that stand for sections of params.yaml
# Packages that take long to load: nothing may do so before the parameters were checked.
HEAVY = {
    "torch",
    "warp",
    "sapien",
    "mani_skill",
    "mujoco",
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
    parameters: tuple[str, ...]  # sections of params.yaml, through their lines of code.yaml
    lines: tuple[str, ...]  # of code.yaml that stand for code
    outputs: tuple[str, ...]

    @property
    def room(self) -> str:
        """The stage's folder below `pipeline`."""
        return self.module.split(".")[1]

    @property
    def module(self) -> str:
        """The module that the command runs, such as `pipeline.merge.__main__`; of several commands, the last."""
        found = re.findall(r"python -m (pipeline\.\w+)(\.\w+)?(?: |$)", self.command, flags=re.MULTILINE)
        assert found, self.command
        return found[-1][0] + (found[-1][1] or ".__main__")

    @property
    def options(self) -> dict[str, str]:
        """The command line's options, such as {"style": "pinch"}."""
        return dict(re.findall(r"--(\w+) (\S+)", self.command))

    @property
    def reads_everything(self) -> bool:
        """Whether the stage shows all of params.yaml."""
        return not hasattr(import_module(self.module), "sections")

    def sections(self) -> list[str]:
        """What the stage's own ``sections()`` says for these options."""
        return import_module(self.module).sections(*self.options.values())


def _filled(value, variables: dict[str, str]) -> str:
    """Return an entry with its variables replaced; of an output with settings, its path."""
    if isinstance(value, dict):
        (value,) = value
    return re.sub(r"\$\{([\w.]+)\}", lambda match: variables[match[1]], value)


def _stage(name: str, body: dict, variables: dict[str, str]) -> Stage:
    def filled(entries) -> tuple[str, ...]:
        return tuple(_filled(entry, variables) for entry in entries)

    lines = filled(line for entry in body.get("params", []) for line in entry["code.yaml"])
    return Stage(
        name=name,
        command="\n".join(filled([body["cmd"]] if isinstance(body["cmd"], str) else body["cmd"])),
        dependencies=filled(body.get("deps", [])),
        parameters=tuple(line.removeprefix(SETTINGS) for line in lines if line.startswith(SETTINGS)),
        lines=tuple(line for line in lines if not f"{line}.".startswith(SETTINGS)),
        outputs=filled([*body.get("outs", []), *body.get("metrics", [])]),
    )


def declared_stages(root: Path) -> list[Stage]:
    """Return all stages of ``dvc.yaml``, with the hand of ``params.yaml``."""
    content = yaml.safe_load((root / "dvc.yaml").read_text())
    hand = {"hand": yaml.safe_load((root / "params.yaml").read_text())["hand"]}
    found = []
    for name, stage in content["stages"].items():
        if "foreach" not in stage:
            found.append(_stage(name, stage, hand))
            continue
        for key in stage["foreach"]:
            fields = stage["foreach"][key] if isinstance(stage["foreach"], dict) else {}
            own = {f"item.{field}": text for field, text in fields.items()}
            found.append(_stage(f"{name}@{key}", stage["do"], {**hand, **own, "key": key, "item": key}))
    return found
