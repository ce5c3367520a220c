"""The one shape in a file, whatever it is packed in: a zip of one mesh, or a ``.gltf`` with its numbers beside it."""

from __future__ import annotations

import io
import re
import stat
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from pipeline.records.gltf import names_beside, packed

KINDS = ("obj", "stl", "ply", "off", "glb", "gltf", "dae", "3mf")  # of shapes; a zip holds one of them
MOST_BYTES = 2**30  # of what is unpacked
_UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}


@dataclass(frozen=True)
class Content:
    """One shape as bytes of a known kind, never ``gltf``, which becomes ``glb``."""

    content: bytes
    kind: str
    name: str  # in the zip, or of the file


def shape_in(source: Path) -> Content:
    """Return the shape in a file.

    Raises:
        OSError: it cannot be read.
        ValueError: it is of no known kind, or a zip without exactly one mesh, or a file beside it is missing.
    """
    kind, content = source.suffix.lower().lstrip("."), source.read_bytes()
    try:
        if kind == "zip":
            return _in_zip(content)
        return _packed(content, kind, source.name, lambda name: _file_beside(source, name))
    except Exception as error:  # the readers raise whatever the damage happens to trigger
        raise ValueError(" ".join(str(error).split())[:160] or type(error).__name__) from error


def files_beside(source: Path) -> list[Path]:
    """Return the files beside a mesh file that hold a part of it; none if that cannot be told."""
    if source.suffix.lower() != ".gltf":
        return []
    try:
        return [source.with_name(name) for name in names_beside(source.read_bytes())]
    except Exception:  # whatever damage triggers; reading the file says what is wrong with it
        return []


def _packed(content: bytes, kind: str, name: str, beside: Callable[[str], bytes]) -> Content:
    if kind not in KINDS:
        raise ValueError(f"the format {kind!r} is not read")
    return Content(packed(content, beside), "glb", name) if kind == "gltf" else Content(content, kind, name)


def _file_beside(source: Path, name: str) -> bytes:
    path = source.with_name(name)
    try:
        state = path.lstat()
    except OSError as error:
        raise ValueError(f"the file {name[:80]} that holds its numbers is not beside it") from error
    if not stat.S_ISREG(state.st_mode) or state.st_size > MOST_BYTES:
        raise ValueError(f"{name[:80]} beside it is no file that can be read")
    return path.read_bytes()


def _in_zip(content: bytes) -> Content:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            found = [item for item in archive.infolist() if _is_shape(item.filename)]
            if len(found) != 1:
                names = ", ".join(item.filename for item in found[:4]) or "none"
                raise ValueError(f"the zip holds {len(found)} meshes ({names}): unpack it and name one")
            folder = PurePosixPath(found[0].filename).parent
            kind = PurePosixPath(found[0].filename).suffix.lower().lstrip(".")
            name = PurePosixPath(found[0].filename).name
            return _packed(_member(archive, found[0].filename), kind, name, lambda own: _beside(archive, folder, own))
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise ValueError(f"the zip cannot be unpacked ({error})") from error


def _is_shape(name: str) -> bool:
    path = PurePosixPath(name)
    hidden = any(part.startswith((".", "__MACOSX")) for part in path.parts)
    return not hidden and path.suffix.lower().lstrip(".") in KINDS


def _beside(archive: zipfile.ZipFile, folder: PurePosixPath, name: str) -> bytes:
    try:
        return _member(archive, str(folder / name))
    except KeyError as error:
        raise ValueError(f"the file {name[:80]} that holds its numbers is not in the zip") from error


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    if archive.getinfo(name).file_size > MOST_BYTES:
        raise ValueError(f"{name} unpacks to more than {MOST_BYTES >> 20} MB")
    with archive.open(name) as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ValueError(f"{name} unpacks to more than {MOST_BYTES >> 20} MB")
    return content


def check_unpacked(content: bytes, kind: str) -> None:
    """Refuse a 3mf or dae that unpacks to any size, or has entities that stand for any text.

    Raises:
        ValueError: it does.
    """
    if kind == "3mf":
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(item.file_size for item in archive.infolist()) > MOST_BYTES:
                raise ValueError(f"it unpacks to more than {MOST_BYTES >> 20} MB")
            texts = [
                _member(archive, name) for name in archive.namelist() if name.endswith((".model", ".rels", ".xml"))
            ]
    else:
        texts = [content]
    for text in texts:
        plain = text.replace(b"\0", b"")  # UTF-16 has one in every letter
        if b"<!DOCTYPE" in plain or b"<!ENTITY" in plain:
            raise ValueError("it defines entities, which are not read")


def up_axis(shape: Content) -> str:
    """Return the axis that points up according to the file or the standard of its format."""
    if shape.kind == "glb":
        return "+y"
    if shape.kind == "dae":
        named = re.search(rb"<up_axis>\s*([XYZ])_UP", shape.content)
        return f"+{named[1].decode().lower()}" if named else "+y"
    return "+z"


def unit_in(shape: Content) -> float | None:
    """Return the length of the file's unit in m, if it names one."""
    if shape.kind == "dae":
        named = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([0-9.eE+-]+)", shape.content)
        length = float(named[1]) if named else 0.0
        return length if length > 0 else None
    if shape.kind == "3mf":
        with zipfile.ZipFile(io.BytesIO(shape.content)) as archive:
            for name in archive.namelist():
                if name.endswith(".model"):
                    named = re.search(rb"<model\b[^>]*\bunit\s*=\s*[\"'](\w+)", _member(archive, name))
                    return _UNITS.get(named[1].decode()) if named else 1e-3
    return None
