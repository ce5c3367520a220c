"""The meshes that the stage assets took out of packages, ``data/assets/<source>/``.

Layout::

    <object>.<kind>   a mesh file as it was in the package
    licences/         the terms of use
    source.json       package, digest of its wheel, and which object is which file
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pipeline.records.errors import UserError
from pipeline.records.parameters.objects import RESTING, AssetMesh, AssetParameters, FileShape
from pipeline.records.paths import assets_folder
from pipeline.records.reading import read_json

SOURCE_FILE = "source.json"


def asset_meshes(sources: Mapping[str, AssetParameters]) -> dict[str, AssetMesh]:
    """Return the objects of all sources by name; a mesh in its second resting pose is ``<name>_pose2``.

    Raises:
        UserError: a source was not extracted, or its record is damaged.
    """
    found: dict[str, AssetMesh] = {}
    mend = "run `dvc repro assets`"
    for source, parameters in sources.items():
        folder = assets_folder(source)
        objects = read_json(folder / SOURCE_FILE, mend).get("objects")
        if not isinstance(objects, dict):
            raise UserError(f"{folder / SOURCE_FILE} is damaged (it names no objects); delete it and {mend}.")
        shape = {name: getattr(parameters, name) for name in FileShape.model_fields}
        poses = parameters.poses if parameters.up == RESTING else 1
        for name, own in objects.items():
            for pose in range(1, poses + 1):
                found[name if pose == 1 else f"{name}_pose{pose}"] = AssetMesh(
                    **shape,
                    pose=pose,
                    file=str(folder / Path(own["file"]).name),
                    source=source,
                    package=parameters.package,
                    path=own["path"],
                    licence=parameters.licence,
                    styles=parameters.styles,
                )
    return found
