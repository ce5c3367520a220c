"""What was reconstructed from a capture.

Layout of ``data/reconstruct/<capture>/``::

    cameras.json              per photo its pinhole camera (undistorted) in the scene frame
    metrics.json              how well it went (docs/metrics.md)
    pictures/<photo>.jpg      a few photos, undistorted and shrunk
    pictures/<photo>-surfaces.jpg  what was found, as the same camera sees it
    objects/<name>/mesh.ply   closed surface, object frame; below what photos show, it is assumed
    objects/<name>/points.npy (n, 6) float32 points and outward unit normals, farthest-point samples, object frame
    objects/<name>/seen.npy   (n,) bool: measured nearby; False: assumed (underside, base on the support)
    objects/<name>/object.json  T_scene_object and sizes

Object frame, as that of prepared objects: origin at the centre of mass (uniform density) of the reconstructed solid,
z up, turned about z as ``scene.yaml`` says.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.geometry import read_geometry_file
from pipeline.records.objects import write_mesh
from pipeline.records.reading import read_json
from pipeline.records.texts import parse_json
from pipeline.records.writing import whole_folder, write_json

SURFACES = "-surfaces.jpg"


@dataclass(frozen=True)
class ReconstructedObject:
    """One object as reconstructed from the photos."""

    name: str
    vertices: NDArray[np.float64]  # (V, 3), object frame, m
    faces: NDArray[np.int64]  # (F, 3), counter-clockwise from outside
    points: NDArray[np.float64]  # (n, 3), object frame
    normals: NDArray[np.float64]  # (n, 3), outward
    seen: NDArray[np.bool_]  # (n,) measured nearby
    T_scene_object: NDArray[np.float64]  # (4, 4)
    volume: float  # m3


def write_reconstruction(
    folder: Path,
    objects: Mapping[str, ReconstructedObject],
    cameras: Any,
    metrics: Mapping[str, Any],
    pictures: Mapping[str, tuple[bytes, bytes]],
) -> None:
    """Write everything as a whole folder.

    Args:
        pictures: per photo shown, itself and what was found, as JPEG.

    Raises:
        UserError: the folder cannot be written to.
    """
    with whole_folder(folder) as temporary:
        write_json(temporary / "cameras.json", cameras)
        write_json(temporary / "metrics.json", metrics)
        (temporary / "pictures").mkdir()
        for name, (photo, surfaces) in pictures.items():
            (temporary / "pictures" / f"{name}.jpg").write_bytes(photo)
            (temporary / "pictures" / f"{name}{SURFACES}").write_bytes(surfaces)
        for name, item in objects.items():
            target = temporary / "objects" / name
            target.mkdir(parents=True)
            write_mesh(target / "mesh.ply", item.vertices, item.faces)
            samples = np.concatenate([item.points, item.normals], axis=1).astype(np.float32)
            np.save(target / "points.npy", samples, allow_pickle=False)
            np.save(target / "seen.npy", item.seen, allow_pickle=False)
            write_json(
                target / "object.json",
                {
                    "T_scene_object": item.T_scene_object.tolist(),
                    "volume": item.volume,
                    "extents": np.ptp(item.vertices, axis=0).tolist(),
                    "closed_at_support": True,
                },
            )


def load_reconstructed_object(capture: str, name: str) -> ReconstructedObject:
    """Load one object of ``data/reconstruct/<capture>``.

    Raises:
        UserError: it is missing or damaged.
    """
    folder = paths.reconstruction_folder(capture) / "objects" / name
    mend = "run `dvc repro reconstruct`"
    try:
        facts = parse_json((folder / "object.json").read_text())
        mesh = read_geometry_file(folder / "mesh.ply")
        samples = np.load(folder / "points.npy", allow_pickle=False).astype(np.float64)
        return ReconstructedObject(
            name=name,
            vertices=np.asarray(mesh.vertices, np.float64),
            faces=np.asarray(mesh.faces, np.int64),
            points=samples[:, :3],
            normals=samples[:, 3:],
            seen=np.load(folder / "seen.npy", allow_pickle=False),
            T_scene_object=np.asarray(facts["T_scene_object"], np.float64).reshape(4, 4),
            volume=float(facts["volume"]),
        )
    except FileNotFoundError as error:
        raise UserError(f"{error.filename or folder} is missing; {mend}.") from error
    except (ValueError, TypeError, LookupError, AttributeError, EOFError, OSError, MemoryError) as error:
        raise UserError(f"{folder} is damaged ({error}); delete it and {mend}.") from error


def load_reconstruction_metrics(capture: str) -> dict[str, Any]:
    """Load ``metrics.json`` of one capture.

    Raises:
        UserError: it is missing or damaged.
    """
    source = paths.reconstruction_folder(capture) / "metrics.json"
    return read_json(source, "run `dvc repro reconstruct`")


def load_reconstruction_pictures(capture: str) -> dict[str, tuple[bytes, bytes]]:
    """Load the photos of a capture that are shown, each with a picture of the surfaces found, as JPEG.

    Raises:
        UserError: there are none, or one of a pair is missing.
    """
    folder, mend = paths.reconstruction_folder(capture) / "pictures", "run `dvc repro reconstruct`"
    found = {}
    for surfaces in sorted(folder.glob(f"*{SURFACES}")):
        name = surfaces.name.removesuffix(SURFACES)
        try:
            found[name] = ((folder / f"{name}.jpg").read_bytes(), surfaces.read_bytes())
        except OSError as error:
            raise UserError(f"{error.filename} is missing; {mend}.") from error
    if not found:
        raise UserError(f"{folder} holds no pictures; {mend}.")
    return found
