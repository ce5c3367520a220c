"""`python -m pipeline.share.export grasps.h5`: two-object grasps as one file, from here or from a git address.

FILE.parquet holds the table of `load_grasps`. FILE.h5 has the schema of the paper's released code, in which all grasps
of a file have as many contacts: where they differ, one file per number is written, such as FILE-2-2.h5 and FILE-3-2.h5.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.records.errors import UserError
from pipeline.records.hands import ALLEGRO
from pipeline.records.sources import OF_ALL_PAIRS, SOURCES
from pipeline.records.tables import write_table
from pipeline.share.grasps import grasps_of, pairs_asked_for
from pipeline.share.project import STYLES, Project, objects_of, open_project
from pipeline.share.publication import TABLE
from pipeline.share.released import (
    pair_arrays,
    read_single_grasps,
    single_arrays,
    write_hdf5,
    write_meshes,
)
from pipeline.stages.running import command

HDF5 = (".h5", ".hdf5")


def command_line() -> argparse.ArgumentParser:
    """Return the parser."""
    parser = argparse.ArgumentParser(
        prog="python -m pipeline.share.export",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", type=Path, help="to write: FILE.parquet, or FILE.h5 in the released code's schema")
    parser.add_argument("--repository", default=".", help="folder of a clone (default: this one), or a git address")
    parser.add_argument("--rev", help="branch, tag or commit; then data come from DVC's cache or remote")
    parser.add_argument("--first", nargs="+", metavar="OBJECT", help="only these, picked first")
    parser.add_argument("--second", nargs="+", metavar="OBJECT", help="only these, picked second")
    parser.add_argument("--source", nargs="+", choices=tuple(OF_ALL_PAIRS), default=["synthesized"])
    parser.add_argument("--all", action="store_true", help="rejected rows too; parquet only")
    parser.add_argument("--no-contacts", action="store_true", help="leave contact indices out; one HDF5 file then")
    parser.add_argument(
        "--single", choices=STYLES, help="instead of pairs, validated single grasps of one object; HDF5 only"
    )
    parser.add_argument("--object", help="the object of --single")
    parser.add_argument("--meshes", type=Path, metavar="FOLDER", help="write the objects' meshes there too")
    return parser


def export(arguments: argparse.Namespace) -> list[Path]:
    """Do what the command line says and return the files written.

    Raises:
        UserError: the arguments do not go together, or grasps are missing.
    """
    file = arguments.file
    if file.suffix not in (*HDF5, ".parquet"):
        raise UserError(f"{file} has neither the ending .parquet nor .h5; name the format by the ending.")
    if arguments.all and file.suffix in HDF5:
        raise UserError("the released schema cannot say what was rejected; leave --all out, or write FILE.parquet.")
    if bool(arguments.single) != bool(arguments.object) or (arguments.single and file.suffix not in HDF5):
        raise UserError(
            "single grasps are written as `FILE.h5 --single pinch --object cube`, with another style or name."
        )
    if file.exists():
        raise UserError(f"{file} is there already; remove it or name another file.")
    with open_project(arguments.repository, arguments.rev) as project:
        if arguments.single:
            names = [arguments.object]
            written = _export_single(project, file, arguments.single, arguments.object)
        else:
            pairs = pairs_asked_for(project, arguments.first, arguments.second)
            grasps = grasps_of(project, pairs, arguments.source, not arguments.all)
            names = sorted({name for pair in pairs for name in pair})
            written = _export_pairs(project, file, grasps, arguments.no_contacts)
        if arguments.meshes is not None:
            written += write_meshes(project, names, arguments.meshes)
    return written


def _export_single(project: Project, file: Path, style: str, name: str) -> list[Path]:
    from pipeline.hand.model import load_hand

    known = objects_of(project)[style]
    if name not in known:
        raise UserError(f"there are no {style} grasps of {name!r}; choose among {', '.join(known) or 'none'}.")
    return write_hdf5(file, single_arrays(name, read_single_grasps(project, style, name), load_hand(ALLEGRO)))


def _export_pairs(project: Project, file: Path, grasps: pd.DataFrame, no_contacts: bool) -> list[Path]:
    if file.suffix not in HDF5:
        write_table(file, grasps, TABLE)
        return [file]
    from pipeline.hand.model import load_hand

    without = [name for name in grasps["source"].unique() if not SOURCES[name].of_single_grasps]
    if without and not no_contacts:
        raise UserError(
            f"{without[0]} grasps have no contact indices; give --no-contacts, as the released sampler does."
        )
    singles = None
    if not no_contacts:
        wanted = [(style, name) for index, style in enumerate(STYLES) for name in grasps[f"object{index}"].unique()]
        singles = {(style, name): read_single_grasps(project, style, name) for style, name in wanted}
    return write_hdf5(file, pair_arrays(grasps, singles, load_hand(ALLEGRO)))


@command("export")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    for path in export(command_line().parse_args(arguments)):
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
