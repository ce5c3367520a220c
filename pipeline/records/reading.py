"""Reading of files that stages wrote: one that is missing or damaged is reported in one sentence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.geometry import read_geometry_file
from pipeline.records.texts import parse_json


@contextmanager
def _explaining(source: Path, mend: str) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError as error:
        raise UserError(f"{source} is missing; {mend}.") from error
    except (OSError, ValueError) as error:
        raise UserError(f"{source} is damaged ({error}); delete it and {mend}.") from error


def read_json(source: Path, mend: str) -> dict[str, Any]:
    """Read a JSON file that holds one object.

    Args:
        mend: what the user should do, such as ``run `dvc repro report```.

    Raises:
        UserError: it is missing or damaged.
    """
    with _explaining(source, mend):
        content = parse_json(source.read_text())
    if not isinstance(content, dict):
        raise UserError(f"{source} is damaged (it holds no object); delete it and {mend}.")
    return content


def read_vertices(source: Path, mend: str) -> NDArray[np.float64]:
    """Return the vertices (V, 3) of a mesh, in the order of the file.

    Raises:
        UserError: it is missing or damaged.
    """
    with _explaining(source, mend):
        vertices = np.asarray(read_geometry_file(source).vertices, np.float64)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        raise UserError(f"{source} is damaged (it holds no points); delete it and {mend}.")
    return vertices
