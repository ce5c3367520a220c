"""`params.yaml` composed from `conf/`: by DVC's own Hydra composition, and never over hand edits by accident.

A parameter has its typed default (`pipeline/records/parameters/`) unless a file of `conf/` gives another value: for a
scale in `conf/scale`, for the fingers of a hand in `conf/hand`, for the synthesis, the validation or the model in
`conf/preset`. `conf/config.yaml` gives the values of parameters that have no default.
The composed file is committed, because DVC and the stages read it alone; it may be edited by hand at any time.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import yaml

from pipeline.hand.model import load_hand
from pipeline.hand.robot import require_arm
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.hands import ALLEGRO
from pipeline.records.parameters import read_parameters, require_conditions, require_picks
from pipeline.records.writing import whole_file
from pipeline.stages.running import command
from tools.parameter_text import own_meshes, with_mesh, without_meshes

CONFIG_FOLDER = Path("conf")
CONFIG_NAME = "config"
DEFAULT_PRESET = "ours"


def choices(group: str) -> list[str]:
    """Return the names of the files in ``conf/<group>``: the scales, the hands, or the presets."""
    return sorted(path.stem for path in (CONFIG_FOLDER / group).glob("*.yaml"))


def compose(scale: str, target: Path, preset: str = DEFAULT_PRESET, hand: str = ALLEGRO) -> None:
    """Write the composed parameters to ``target``, byte for byte as `dvc exp run -S scale=... -S hand=...` does.

    Raises:
        UserError: there is no such scale, hand or preset, or the composed values are refused by the typed models.
    """
    for group, name in (("scale", scale), ("hand", hand), ("preset", preset)):
        if name not in choices(group):
            known = ", ".join(choices(group))
            raise UserError(f"there is no {group} {name!r} in {CONFIG_FOLDER}/{group}; use one of {known}.")
    from dvc.utils.hydra import compose_and_dump

    from tools.typed_defaults import register

    register()
    with tempfile.TemporaryDirectory() as folder:
        composed = Path(folder) / "params.yaml"
        chosen = [f"scale={scale}", f"hand={hand}", f"preset={preset}"]
        compose_and_dump(composed, str(CONFIG_FOLDER.resolve()), None, CONFIG_NAME, "", chosen)
        read_parameters(composed)
        target.write_bytes(composed.read_bytes())


def flatten(content: Any, prefix: str = "") -> dict[str, Any]:
    """Return nested dictionaries as one with dotted keys; lists are values."""
    if not isinstance(content, dict) or not content:
        return {prefix: content}
    return {
        key: value
        for name, item in content.items()
        for key, value in flatten(item, f"{prefix}.{name}" if prefix else str(name)).items()
    }


def differences(scale: str, preset: str = DEFAULT_PRESET, count_meshes: bool = True, hand: str = ALLEGRO) -> list[str]:
    """Return the dotted names of the values in which ``params.yaml`` differs from what ``conf/`` composes.

    Args:
        count_meshes: whether objects under ``meshes``, and their place in the styles, are differences.
    """
    present = yaml.safe_load(paths.PARAMETERS_FILE.read_text())
    with tempfile.TemporaryDirectory() as folder:
        composed = Path(folder) / "params.yaml"
        compose(scale, composed, preset, hand)
        here = flatten(present if count_meshes else without_meshes(present))
        there = flatten(yaml.safe_load(composed.read_text()))
    absent = object()
    return sorted(name for name in here.keys() | there.keys() if here.get(name, absent) != there.get(name, absent))


def _named(names: list[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def _own_meshes_of_a_sound_file() -> dict[str, tuple[dict[str, Any], list[str]]]:
    """Return the objects under ``meshes`` in ``params.yaml``; none where the file is missing or refused."""
    try:
        read_parameters()
    except UserError:
        return {}
    return own_meshes(yaml.safe_load(paths.PARAMETERS_FILE.read_text()))


def _title(scale: str, preset: str, hand: str) -> str:
    parts = [f"the hand {hand}"] * (hand != ALLEGRO) + [f"the {preset} preset"] * (preset != DEFAULT_PRESET)
    return f"scale {scale}" + (f" with {' and '.join(parts)}" if parts else "")


def switch(scale: str, force: bool, preset: str = DEFAULT_PRESET, hand: str = ALLEGRO) -> str:
    """Compose ``params.yaml`` for ``scale``, ``hand`` and ``preset`` and return what to tell the user.

    The user's own objects (``meshes``) belong to no scale: they are kept, in the styles that list them, also with
    ``force``.

    Raises:
        UserError: ``params.yaml`` holds hand edits and ``force`` is not set.
    """
    own = _own_meshes_of_a_sound_file()
    if paths.PARAMETERS_FILE.exists() and not force:
        try:
            present = read_parameters()
        except UserError as error:
            raise UserError(f"{str(error).removesuffix('.')}; or add --force to compose the file anew.") from error
        edited = differences(present.scale, present.preset, count_meshes=False, hand=present.hand)
        if edited:
            raise UserError(
                f"params.yaml differs from the {_title(present.scale, present.preset, present.hand)} of conf/ in "
                f"{_named(edited)}; add --force to overwrite it, or leave out --scale to use it as it is."
            )
    with tempfile.TemporaryDirectory() as folder:
        composed = Path(folder) / "params.yaml"
        compose(scale, composed, preset, hand)
        text = composed.read_text()
    for name, (entry, styles) in own.items():
        text = with_mesh(text, name, entry, styles)
    with whole_file(paths.PARAMETERS_FILE) as temporary:
        temporary.write_text(text)
    kept = f"; kept from meshes: {', '.join(own)}" if own else ""
    return f"{_title(scale, preset, hand)}, composed from conf/ into params.yaml{kept}"


def describe() -> str:
    """Return one line: which scale ``params.yaml`` holds and where it was edited by hand."""
    present = read_parameters()
    edited = differences(present.scale, present.preset, hand=present.hand)
    return _title(present.scale, present.preset, present.hand) + (
        f", edited in params.yaml: {_named(edited)}" if edited else ""
    )


@command("scales")
def main(arguments: list[str] | None = None) -> int:
    """Command line of this module."""
    parser = argparse.ArgumentParser(prog="python -m tools.scales", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    checking = commands.add_parser("check", help="say which scale params.yaml holds and where it was edited")
    checking.add_argument("--everything", action="store_true", help="refuse a hand that cannot go through all stages")
    composing = commands.add_parser("compose", help="write params.yaml from conf/")
    composing.add_argument("scale")
    composing.add_argument("--preset", default=DEFAULT_PRESET, help="a file of conf/preset (default: %(default)s)")
    composing.add_argument("--hand", default=ALLEGRO, help="a file of conf/hand (default: %(default)s)")
    composing.add_argument("--force", action="store_true", help="overwrite hand edits")
    chosen = parser.parse_args(arguments)
    composing_now = chosen.command == "compose"
    if not composing_now and chosen.everything:
        parameters = read_parameters()
        require_picks(parameters)
        require_arm(load_hand(parameters.hand))
        require_conditions(parameters)
    said = switch(chosen.scale, chosen.force, chosen.preset, chosen.hand) if composing_now else describe()
    print(said, file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
