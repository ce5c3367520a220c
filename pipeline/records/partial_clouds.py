"""What one depth picture shows of an object: points without a surface, in the files of a reconstructed object."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.records.writing import whole_folder, write_json


def write_partial_cloud(
    folder: Path, points: NDArray[np.float64], normals: NDArray[np.float64], T_scene_object: NDArray[np.float64]
) -> None:
    """Write ``points.npy`` and ``object.json`` as of a reconstructed object, without a surface, as a whole folder.

    Args:
        points: (n, 3), object frame, m.
        normals: (n, 3), unit.
        T_scene_object: (4, 4).

    Raises:
        UserError: the folder cannot be written to.
    """
    with whole_folder(folder) as temporary:
        samples = np.concatenate([points, normals], axis=1).astype(np.float32)
        np.save(temporary / "points.npy", samples, allow_pickle=False)
        extents = np.ptp(points, axis=0).tolist()
        write_json(temporary / "object.json", {"T_scene_object": T_scene_object.tolist(), "extents": extents})
