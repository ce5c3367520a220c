"""Compare all results of two checkouts, whatever files they are cut into: `python benchmarks/same_tables.py OLD NEW`.

Tables of two objects are compared with a column per object, as they were before they held lists.

Tables are compared row by row and column by column, prepared objects array by array, and everything else by its bytes.
Knows the layout before and after stages became constant in number. Exit code 1: something differs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import trimesh

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from pipeline.records.flat import PAIR_GRASPS, PAIR_TRIALS, flat  # noqa: E402
from pipeline.records.objects import read_prepared_object  # noqa: E402

# Where tables of pairs lie: earlier with one file per pair, now with one per first object.
PAIRS = {
    "merge": ("data/merge", "data/merge"),
    "sample learned": ("data/train", "data/sample/learned"),
    "sample reconstructed": ("data/train_reconstructed", "data/sample/reconstructed"),
}
AS_THEY_ARE = ("data/synthesize", "data/validate", "data/evaluate")
BYTES = ("models/train", "data/capture", "data/reconstruct")

Member = TypeVar("Member")


def read(path: Path) -> pd.DataFrame:
    """Return a table, one of pairs with a column per object."""
    table = pq.read_table(path)
    if "objects" not in table.column_names:
        return table.to_pandas(ignore_metadata=True)
    return flat(table, PAIR_GRASPS if "grasp_ids" in table.column_names else PAIR_TRIALS).to_pandas(
        ignore_metadata=True
    )


def tables(root: Path) -> dict[str, pd.DataFrame]:
    """Return all tables of a checkout by a name that does not depend on its layout."""
    found = {}
    for folder in AS_THEY_ARE:
        for path in sorted((root / folder).rglob("*.parquet")):
            found[path.relative_to(root / "data").as_posix()] = read(path)
    for name, folders in PAIRS.items():
        for folder in dict.fromkeys(folders):
            for path in sorted((root / folder).rglob("*.parquet")):
                for (first, second), rows in read(path).groupby(["object0", "object1"], sort=False):
                    found[f"{name} {first} {second}"] = rows.reset_index(drop=True)
    return found


def prepared(folder: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a prepared object."""
    mesh = trimesh.load_mesh(folder / "mesh.ply", process=False)
    arrays: dict[str, np.ndarray] = {"vertices": mesh.vertices, "faces": mesh.faces}
    if (folder / "shapes.npz").exists():
        item = read_prepared_object(folder)
        parts, distance = item.parts, item.distance
        surface = np.concatenate([item.surface_points, item.surface_normals], axis=1).astype(np.float32)
    else:
        loaded = [trimesh.load_mesh(path, process=False) for path in sorted((folder / "parts").glob("*.ply"))]
        parts = tuple((np.asarray(part.vertices), np.asarray(part.faces)) for part in loaded)
        distance, surface = np.load(folder / "distance.npy"), np.load(folder / "surface.npy")
    arrays |= {"distance": distance, "surface": surface}
    for number, (vertices, faces) in enumerate(parts):
        arrays |= {f"part {number} vertices": vertices, f"part {number} faces": faces}
    return arrays


def objects(root: Path) -> dict[str, np.ndarray]:
    """Return the arrays of all prepared objects of a checkout."""
    return {
        f"{path.name} {key}": value
        for path in sorted((root / "data/prepare").glob("*"))
        for key, value in prepared(path).items()
    }


def files(root: Path) -> dict[str, bytes]:
    """Return all files of a checkout that are compared by their bytes."""
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for folder in BYTES
        for path in sorted((root / folder).rglob("*"))
        if path.is_file() and path.name != ".gitkeep"
    }


def same_cell(one: object, other: object) -> bool:
    """Return whether two cells are equal, NaN and None being equal to themselves."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return len(one) == len(other) and all(same_cell(a, b) for a, b in zip(one, other, strict=True))
    if one is None or other is None:
        return one is other
    return bool(one == other) or (one != one and other != other)


def differences(old: pd.DataFrame, new: pd.DataFrame) -> list[str]:
    """Return what differs between two tables."""
    if list(old.columns) != list(new.columns):
        return [f"columns {sorted(set(old.columns) ^ set(new.columns))}"]
    if len(old) != len(new):
        return [f"{len(old)} rows and {len(new)}"]
    return [
        f"column {name}: {wrong} of {len(old)} rows"
        for name in old.columns
        if (wrong := sum(not same_cell(a, b) for a, b in zip(old[name], new[name], strict=True)))
    ]


def compare(
    name: str, old: dict[str, Member], new: dict[str, Member], differ: Callable[[Member, Member], list[str]]
) -> int:
    """Print what differs between two collections, and return how many members do."""
    wrong = 0
    for key in sorted(old.keys() | new.keys()):
        found = ["only in OLD"] * (key not in new) + ["only in NEW"] * (key not in old)
        found = found or differ(old[key], new[key])
        wrong += bool(found)
        for text in found:
            print(f"{name} {key}: {text}")
    print(f"{name}: {len(old.keys() | new.keys()) - wrong} of {len(old.keys() | new.keys())} are the same")
    return wrong


def main() -> int:
    """Compare and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path, metavar="OLD")
    parser.add_argument("new", type=Path, metavar="NEW")
    chosen = parser.parse_args()
    old, new = chosen.old, chosen.new
    wrong = compare("table", tables(old), tables(new), differences)
    wrong += compare("array", objects(old), objects(new), lambda a, b: [] if np.array_equal(a, b) else ["values"])
    wrong += compare("file", files(old), files(new), lambda a, b: [] if a == b else ["bytes"])
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
