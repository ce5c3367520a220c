"""`./dev add-object FILE --style auto|pinch|side|both`: turn a mesh file into an object of the pipeline.

The object is prepared first, so that an unusable mesh leaves no trace. Then the file is copied to `data/raw/` and
entries are added to `params.yaml`. The prepared folder is only written for inspection: the stage `prepare` makes the
same one again, as it does for every new object.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from pydantic import ValidationError

from pipeline.assets.naming import plain
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.parameters import OBJECT_NAME, Parameters, read_parameters
from pipeline.records.parameters.objects import RESTING, MeshParameters
from pipeline.records.writing import check_writable, whole_file
from pipeline.stages.running import command
from tools.parameter_text import with_mesh

if TYPE_CHECKING:
    from pipeline.prepare.sources import RawMesh

FITTING = "auto"  # the styles that fit the object's size
STYLES: dict[str, list[str]] = {"pinch": ["pinch"], "side": ["side"], "both": ["pinch", "side"], FITTING: []}
UNITS = ("m", "cm", "mm", "inch")
WISHES = ("unit", "up", "pose", "turn", "scale", "fit_longest", "density", "bodies", "wall", "accept_repair")
AXES = ("+x", "-x", "+y", "-y", "+z", "-z", RESTING)


@dataclass(frozen=True)
class Addition:
    """An object to be added."""

    name: str
    source: Path  # the user's file
    content: bytes  # of the shape in it
    entry: dict[str, Any]  # under `meshes`
    styles: list[str]
    raw: RawMesh

    @property
    def target(self) -> Path:
        """Where the file will be stored."""
        return Path(self.entry["file"])


def plain_name(stem: str) -> str:
    """Return an object name derived from a file's name: ``my_mug_2`` from ``My Mug (2)``; '' if nothing is left."""
    return plain(stem).lstrip("0123456789_")


def _checked_name(name: str | None, source: Path) -> str:
    found = plain_name(source.stem) if name is None else name
    if not OBJECT_NAME.fullmatch(found):
        what = f"{source.name!r} yields no object name" if name is None else f"{name!r} is not a valid object name"
        raise UserError(f"{what}; give --name with lowercase letters, digits and underscores, starting with a letter.")
    return found


def planned(chosen: argparse.Namespace, parameters: Parameters) -> Addition:
    """Check the command line against the file, the folder and the parameters.

    Raises:
        UserError: the file is not a mesh, or the name is taken and ``--force`` is not given.
    """
    from pipeline.prepare.sources import check_file, raw_mesh, shape_content

    source: Path = chosen.folder / chosen.file
    check_file(source, str(source))
    name = _checked_name(chosen.name, source)
    if name in parameters.objects:
        raise UserError(f"params.yaml already has an object {name} under `objects`; choose another --name.")
    if name in parameters.meshes and not chosen.force:
        raise UserError(
            f"params.yaml already has an object {name} under `meshes`; choose another --name, or add --force."
        )
    shape = shape_content(source, str(source))
    target = paths.RAW_FOLDER / f"{name}.{shape.kind}"
    if target.exists() and not chosen.force and target.read_bytes() != shape.content:
        raise UserError(f"{target} is a different file; choose another --name, or add --force to overwrite it.")
    asked = {key: getattr(chosen, key) for key in WISHES}
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
    entry.setdefault("up", raw.up)
    return Addition(
        name, source, shape.content, entry, STYLES[chosen.style], replace(raw, guessed_unit="", longest=0.0)
    )


def _shape(entry: dict[str, Any]) -> MeshParameters:
    try:
        return MeshParameters.model_validate(entry)
    except ValidationError as error:
        first = error.errors()[0]
        where = "".join(f"--{str(part).replace('_', '-')}: " for part in first["loc"])
        raise UserError(f"{where}{first['msg'].removeprefix('Value error, ')}.") from error


def describe(addition: Addition, prepared: PreparedObject) -> list[str]:
    """Return the lines that tell the user what became of the mesh."""
    from pipeline.prepare.change import table
    from pipeline.prepare.graspable import size_of, verdict

    facts = prepared.provenance
    size = " x ".join(f"{1000 * extent:.1f}" for extent in prepared.extents)
    repairs = "; ".join(facts["repairs"]) or "none needed"
    unit = addition.entry.get("unit", "scaled to fit" if "fit_longest" in addition.entry else "in the file's unit")
    lines = [
        f"{addition.name}: {addition.target} ({unit})",
        f"  extents       {size} mm (x, y, z; z is up)",
        f"  volume        {1e6 * prepared.volume:.1f} cm3",
        f"  mass          {1000 * prepared.mass:.1f} g at {facts['density']:g} kg/m3",
        f"  faces         {facts['faces']} (file: {facts['raw_faces']})",
        f"  repairs       {repairs}",
        *(table(facts["changes"]) if "changes" in facts else []),
        f"  convex parts  {len(prepared.parts)}",
        f"  picture       {paths.prepared_folder(addition.name) / 'picture.png'}",
    ]
    return lines + [f"  {style:13} {verdict(style, size_of(prepared.vertices))}" for style in addition.styles]


def write(addition: Addition, prepared: PreparedObject) -> None:
    """Copy the file, write the prepared folder and change ``params.yaml``, in this order."""
    from pipeline.prepare.portrait import portrait
    from pipeline.records.objects import write_prepared_object

    text = with_mesh(paths.PARAMETERS_FILE.read_text(), addition.name, addition.entry, addition.styles)
    Parameters.model_validate(yaml.safe_load(text))
    picture = portrait(prepared)
    if addition.source.resolve() != addition.target.resolve():
        with whole_file(addition.target) as temporary:
            temporary.write_bytes(addition.content)
    write_prepared_object(paths.prepared_folder(addition.name), prepared, picture)
    with whole_file(paths.PARAMETERS_FILE) as temporary:
        temporary.write_text(text)


def add(chosen: argparse.Namespace) -> None:
    """Check, prepare and write an object, and report it.

    Raises:
        UserError: the mesh or the command line is refused; nothing has been changed then.
    """
    parameters = read_parameters()
    addition = planned(chosen, parameters)
    for path in (addition.target, paths.prepared_folder(addition.name), paths.PARAMETERS_FILE):
        check_writable(path)
    from pipeline.prepare.preparation import prepare_object

    prepared = prepare_object(addition.name, _shape(addition.entry), parameters.prepare, addition.raw)
    if chosen.style == FITTING:
        addition = replace(addition, styles=_fitting(addition.name, prepared))
    write(addition, prepared)
    print("\n".join(describe(addition, prepared)))
    stages = " ".join(f"validate@{style}" for style in addition.styles)
    print(f"Next: look at the picture; `./dev repro {stages}` for grasps of it alone, `./dev repro` for its pairs too.")


def _fitting(name: str, prepared: PreparedObject) -> list[str]:
    """Return the styles that fit an object.

    Raises:
        UserError: there is none.
    """
    from pipeline.prepare.graspable import fitting_styles, size_of, verdict

    size = size_of(prepared.vertices)
    if styles := fitting_styles(size):
        return styles
    said = "; ".join(f"{style}: {verdict(style, size)}" for style in ("pinch", "side"))
    raise UserError(f"{name} fits no style ({said}); scale it, or name a --style to add it all the same.")


def _bodies(text: str) -> str | int:
    return int(text) if text.isdecimal() else text


def command_line() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = argparse.ArgumentParser(
        prog="./dev add-object", description="Turn a mesh file into an object of the pipeline."
    )
    parser.add_argument("file", type=Path, help="obj, stl, ply, off, glb, gltf, dae or 3mf, or a zip of one")
    parser.add_argument("--folder", type=Path, default=Path(), help=argparse.SUPPRESS)  # where ./dev was called
    parser.add_argument(
        "--style",
        required=True,
        choices=STYLES,
        help="pinch: thumb, index and middle finger; side: ring finger and palm; auto: those that fit the size",
    )
    parser.add_argument("--name", help="name of the object (default: derived from the file's name)")
    parser.add_argument("--unit", choices=UNITS, help="unit of the file (default: guessed from its size)")
    parser.add_argument("--scale", type=float, help="scale factor")
    parser.add_argument("--fit-longest", type=float, help="longest extent in metres, instead of --unit and --scale")
    parser.add_argument(
        "--up",
        choices=AXES,
        help="axis of the file that points up (--up=-y; default: of its format, mostly +z); auto: as the solid rests",
    )
    parser.add_argument("--pose", type=int, help="with --up auto: the pose in which it rests, 1 being the likeliest")
    parser.add_argument("--turn", type=float, help="rotation about the vertical axis in degrees")
    parser.add_argument("--density", type=float, help="kg/m3 (default: 500)")
    parser.add_argument(
        "--bodies",
        type=_bodies,
        help="of several separate bodies: largest, all (as one rigid object), or the number of one (1 is the largest)",
    )
    parser.add_argument("--wall", type=float, help="thickness in metres for a surface without one")
    parser.add_argument(
        "--accept-repair", action="store_true", default=None, help="even if the repair changes the shape beyond limits"
    )
    parser.add_argument("--force", action="store_true", help="replace an object or file of the same name")
    return parser


@command("add-object")
def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    add(command_line().parse_args(arguments))
    return 0


if __name__ == "__main__":
    sys.exit(main())
