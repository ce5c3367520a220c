"""`./dev add-object FILE --style pinch|side|both`: a mesh file becomes an object of the pipeline.

The object is prepared first, so that a mesh which cannot be used leaves no trace. Then the file is copied to
`data/raw/` and entries are added to `params.yaml`. The prepared folder is there to look at: the stage `prepare` makes
the same one again, as it makes whatever is new.
"""

from __future__ import annotations

import argparse
import re
import sys
import unicodedata
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from pydantic import ValidationError

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters import OBJECT_NAME, Parameters, read_parameters
from pipeline.records.parameters.objects import MeshParameters
from pipeline.records.writing import check_writable, whole_file
from pipeline.stages.running import command
from tools.parameter_text import with_mesh

if TYPE_CHECKING:
    from pipeline.prepare.sources import RawMesh

STYLES = {"pinch": ["pinch"], "side": ["side"], "both": ["pinch", "side"]}
UNITS = ("m", "cm", "mm", "inch")
AXES = ("+x", "-x", "+y", "-y", "+z", "-z")


@dataclass(frozen=True)
class Addition:
    """What will be added."""

    name: str
    source: Path  # the user's file
    entry: dict[str, Any]  # under `meshes`
    styles: list[str]
    raw: RawMesh

    @property
    def target(self) -> Path:
        """Where the file will lie."""
        return Path(self.entry["file"])


def plain_name(stem: str) -> str:
    """Return an object name made of a file's name, such as ``my_mug_2`` of ``My Mug (2)``; '' when nothing is left."""
    ascii_only = unicodedata.normalize("NFKD", stem).encode("ascii", "ignore").decode().lower()
    return re.sub(r"^[^a-z]+|_+$", "", re.sub(r"[^a-z0-9]+", "_", ascii_only))


def _checked_name(name: str | None, source: Path) -> str:
    found = plain_name(source.stem) if name is None else name
    if not OBJECT_NAME.fullmatch(found):
        what = f"no object name can be made of {source.name!r}" if name is None else f"{name!r} is no object name"
        raise UserError(f"{what}; give --name with small letters, digits and underscores, a letter first.")
    return found


def planned(chosen: argparse.Namespace, parameters: Parameters) -> Addition:
    """Check the command line against the file, the folder and the parameters.

    Raises:
        UserError: the file is no mesh, or the name is taken by something else and ``--force`` is not given.
    """
    from pipeline.prepare.sources import check_file, raw_mesh

    source: Path = chosen.folder / chosen.file
    check_file(source, str(source))
    name = _checked_name(chosen.name, source)
    if name in parameters.objects:
        raise UserError(f"params.yaml has an object {name} under `objects` already; give another --name.")
    if name in parameters.meshes and not chosen.force:
        raise UserError(f"params.yaml has an object {name} under `meshes` already; give another --name, or --force.")
    target = paths.RAW_FOLDER / f"{name}{source.suffix.lower()}"
    if target.exists() and not chosen.force and target.read_bytes() != source.read_bytes():
        raise UserError(f"{target} is another file; give another --name, or --force to overwrite it.")
    asked = {key: getattr(chosen, key) for key in ("unit", "up", "turn", "scale", "fit_longest", "density")}
    entry = {"file": str(target)} | {key: value for key, value in asked.items() if value is not None}
    raw = raw_mesh(_shape(entry), name, read_from=source)
    if raw.guessed_unit:
        print(
            f"warning: the longest extent in {source.name} is {raw.longest:.4g}, taken as {raw.guessed_unit}; if that "
            "is wrong, run again with --unit and --force.",
            file=sys.stderr,
        )
        entry = {"file": str(target), "unit": raw.guessed_unit} | entry
    # With the unit in params.yaml, the stage has nothing to guess.
    return Addition(name, source, entry, STYLES[chosen.style], replace(raw, guessed_unit="", longest=0.0))


def _shape(entry: dict[str, Any]) -> MeshParameters:
    try:
        return MeshParameters.model_validate(entry)
    except ValidationError as error:
        first = error.errors()[0]
        where = "".join(f"--{str(part).replace('_', '-')}: " for part in first["loc"])
        raise UserError(f"{where}{first['msg'].removeprefix('Value error, ')}.") from error


def describe(addition: Addition, prepared: PreparedObject) -> list[str]:
    """Return the lines that tell the user what has become of the mesh."""
    from tools.graspable import verdict

    facts = prepared.provenance
    size = " x ".join(f"{1000 * extent:.1f}" for extent in prepared.extents)
    repairs = "; ".join(facts["repairs"]) or "none needed"
    unit = addition.entry.get("unit", "scaled to fit")
    lines = [
        f"{addition.name}: {addition.target} ({unit})",
        f"  extents       {size} mm (x, y, z; z is up)",
        f"  volume        {1e6 * prepared.volume:.1f} cm3",
        f"  mass          {1000 * prepared.mass:.1f} g at {facts['density']:g} kg/m3",
        f"  faces         {facts['faces']} (file: {facts['raw_faces']})",
        f"  repairs       {repairs}",
        f"  convex parts  {len(prepared.parts)}",
        f"  picture       {paths.prepared_folder(addition.name) / 'picture.png'}",
    ]
    return lines + [f"  {style:13} {verdict(style, prepared)}" for style in addition.styles]


def write(addition: Addition, prepared: PreparedObject) -> None:
    """Copy the file, write the prepared folder and change ``params.yaml``, in this order."""
    from pipeline.prepare.portrait import portrait
    from pipeline.records.objects import write_prepared_object

    text = with_mesh(paths.PARAMETERS_FILE.read_text(), addition.name, addition.entry, addition.styles)
    Parameters.model_validate(yaml.safe_load(text))
    picture = portrait(prepared)
    if addition.source.resolve() != addition.target.resolve():
        with whole_file(addition.target) as temporary:
            temporary.write_bytes(addition.source.read_bytes())
    write_prepared_object(paths.prepared_folder(addition.name), prepared, picture)
    with whole_file(paths.PARAMETERS_FILE) as temporary:
        temporary.write_text(text)


def add(chosen: argparse.Namespace) -> None:
    """Do the whole of the command.

    Raises:
        UserError: the mesh or the command line is refused; then nothing has been changed.
    """
    parameters = read_parameters()
    addition = planned(chosen, parameters)
    for path in (addition.target, paths.prepared_folder(addition.name), paths.PARAMETERS_FILE):
        check_writable(path)
    from pipeline.prepare.preparation import prepare_object

    prepared = prepare_object(addition.name, _shape(addition.entry), parameters.prepare, addition.raw)
    write(addition, prepared)
    print("\n".join(describe(addition, prepared)))
    stages = " ".join(f"validate@{style}" for style in addition.styles)
    print(f"Next: look at the picture; `./dev repro {stages}` for grasps of it alone, `./dev repro` for its pairs too.")


def command_line() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = argparse.ArgumentParser(prog="./dev add-object", description="A mesh file becomes an object.")
    parser.add_argument("file", type=Path, help="obj, stl, ply, off or glb")
    parser.add_argument("--folder", type=Path, default=Path(), help=argparse.SUPPRESS)  # where ./dev was called
    parser.add_argument("--style", required=True, choices=STYLES, help="who holds it: pinch is thumb, index, middle")
    parser.add_argument("--name", help="of the object; made of the file's name when left out")
    parser.add_argument("--unit", choices=UNITS, help="of the file; guessed from the size when left out")
    parser.add_argument("--scale", type=float, help="factor on the shape")
    parser.add_argument("--fit-longest", type=float, help="longest extent in metres, instead of --unit and --scale")
    parser.add_argument("--up", choices=AXES, default="+z", help="axis of the file that points up (--up=-y)")
    parser.add_argument("--turn", type=float, help="about the vertical, degrees")
    parser.add_argument("--density", type=float, help="kg/m3; 500 when left out")
    parser.add_argument("--force", action="store_true", help="replace an object or file of that name")
    return parser


@command("add-object")
def main(arguments: list[str] | None = None) -> int:
    """Command line of this module."""
    add(command_line().parse_args(arguments))
    return 0


if __name__ == "__main__":
    sys.exit(main())
