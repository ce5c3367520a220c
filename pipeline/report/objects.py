"""What the report needs of a prepared object: its mesh, and where it comes from; grids and samples stay on disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.pictures.decimation import Mesh
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.geometry import read_geometry_file
from pipeline.records.reading import read_json

MEND = "run `dvc repro prepare` to make it again"


@dataclass(frozen=True)
class ObjectFacts:
    """Where an object comes from."""

    name: str
    source: str
    licence: str
    extents: Sequence[float]  # m
    mass: float  # kg


def read_facts(name: str) -> ObjectFacts:
    """Read what is known of a prepared object.

    Raises:
        UserError: its file is missing or damaged.
    """
    file = paths.prepared_folder(name) / "object.json"
    content = read_json(file, MEND)
    try:
        provenance = content["provenance"]
        extents = [float(extent) for extent in content["extents"]]
        return ObjectFacts(name, provenance["source"], provenance["licence"], extents, float(content["mass"]))
    except (LookupError, TypeError, ValueError) as error:
        raise UserError(f"{file} is damaged ({error}); delete it and {MEND}.") from error


def read_mesh(name: str) -> Mesh:
    """Read the solid of a prepared object, in its frame.

    Raises:
        UserError: its file is missing or damaged.
    """
    file = paths.prepared_folder(name) / "mesh.ply"
    try:
        mesh = read_geometry_file(file)
        return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    except FileNotFoundError as error:
        raise UserError(f"{file} is missing; {MEND}.") from error
    except (OSError, ValueError, TypeError, LookupError, AttributeError, EOFError) as error:
        raise UserError(f"{file} is damaged ({error}); delete it and {MEND}.") from error
