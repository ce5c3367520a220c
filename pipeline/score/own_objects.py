"""The objects that are scored: prepared ones of this project, or mesh files, in which the grasps' poses are given."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.prepare import repair
from pipeline.prepare.preparation import prepare_object
from pipeline.prepare.sources import RawMesh, check_file, raw_mesh
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject, load_prepared_object
from pipeline.records.parameters import OBJECT_NAME
from pipeline.records.parameters.objects import MeshParameters
from pipeline.records.parameters.prepare import PrepareParameters
from pipeline.shapes import frame, mass
from pipeline.share.released import Z_UP_FROM_Y_UP

MESH_FILE = "mesh.ply"  # of a prepared object


@dataclass(frozen=True)
class ScoredObject:
    """An object and the frame in which a file gives poses."""

    prepared: PreparedObject
    T_prepared_mesh: NDArray[np.float64]  # (4, 4)
    up: str = "+z"  # axis of the mesh that points up

    def T_prepared_poses(self, y_up: bool) -> NDArray[np.float64]:
        """Return the frame (4, 4) in which a file gives poses.

        Args:
            y_up: they are of SeqMultiGrasp's y-up meshes, of which a mesh with z up is another one.
        """
        return self.T_prepared_mesh @ Z_UP_FROM_Y_UP if y_up and self.up == "+z" else self.T_prepared_mesh


@dataclass(frozen=True)
class MeshChoice:
    """What the command line says of a mesh file."""

    unit: str | None
    up: str  # axis of the mesh that points up
    density: float  # kg/m3
    stands: bool  # it is picked off a support, so it must stand


def object_source(
    text: str, folder: Path, choice: MeshChoice, settings: PrepareParameters
) -> Callable[[float], ScoredObject]:
    """Return what gives an object at a scale: a prepared one by name or by its mesh, or one made of a mesh file.

    Args:
        text: the name, or the path of the mesh.
        folder: which a relative path begins at.

    Raises:
        UserError: there is no such object or file.
    """
    path = folder / text
    name = path.parent.name if path.name == MESH_FILE and _is_prepared(path.parent) else text
    if OBJECT_NAME.fullmatch(name) and not path.is_dir():
        prepared = load_prepared_object(name)

        def known(scale: float) -> ScoredObject:
            if abs(scale - 1) > 1e-6:
                raise UserError(
                    f"the file has grasps of the object scaled by {scale:g}; name its mesh file with --object."
                )
            return ScoredObject(prepared, np.eye(4))

        return known
    check_file(path, "--object")
    parameters = MeshParameters.model_validate(
        {"file": str(path), "unit": choice.unit, "up": choice.up, "density": choice.density}
    )
    raw = raw_mesh(parameters, path.stem, read_from=path)
    if raw.guessed_unit:
        print(
            f"warning: the longest extent in {path} is {raw.longest:.4g}, taken as {raw.guessed_unit}; if that is "
            "wrong, run again with --unit.",
            file=sys.stderr,
        )
    return lru_cache(maxsize=64)(lambda scale: _scaled(raw, scale, path, parameters, choice, settings))


def _is_prepared(folder: Path) -> bool:
    return folder.resolve() == paths.prepared_folder(folder.name).resolve() and (folder / "object.json").is_file()


def _scaled(
    raw: RawMesh, scale: float, path: Path, shape: MeshParameters, choice: MeshChoice, settings: PrepareParameters
) -> ScoredObject:
    """Prepare a mesh, and find its frame by the steps of ``prepare.preparation.prepare_object``."""
    raw = replace(raw, vertices=raw.vertices * scale)
    name = path.stem
    prepared = prepare_object(name, shape, settings, raw, must_stand=choice.stands)
    solid = repair.repair(raw.vertices, raw.faces, name)
    R = frame.ROTATIONS[choice.up]
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = -mass.solid_properties(solid.vertices @ R.T, solid.faces)[1]
    return ScoredObject(prepared, T, choice.up)
