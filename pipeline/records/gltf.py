"""glTF reduced to its shapes: a GLB of nothing but nodes, triangles and the bytes that they use.

Materials, pictures, skins, animations and morph targets are left out before any reader sees them; what changes the
shape and is not understood is refused by its name.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_DRACO = "KHR_draco_mesh_compression"
# Extensions that a file may require although they are not read: they do not change the shape.
_HARMLESS = (
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "KHR_xmp",
    "KHR_animation_",
    "MSFT_texture_",
)
_NODE = ("children", "matrix", "translation", "rotation", "scale", "mesh", "name")


def split(content: bytes) -> tuple[dict[str, Any], bytes]:
    """Return the header and the binary part of a GLB.

    Raises:
        ValueError: it is no GLB.
    """
    if content[:4] != b"glTF" or len(content) < 20:
        raise ValueError("it does not begin as a GLB does")
    length, kind = struct.unpack_from("<II", content, 12)
    if kind != _JSON:
        raise ValueError("its header is missing")
    header = json.loads(content[20 : 20 + length])
    begin = 20 + length
    if len(content) < begin + 8 or struct.unpack_from("<II", content, begin)[1] != _BINARY:
        return header, b""
    return header, content[begin + 8 : begin + 8 + struct.unpack_from("<I", content, begin)[0]]


def joined(header: dict[str, Any], binary: bytes) -> bytes:
    """Return a GLB."""
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<II", len(text), _JSON) + text + struct.pack("<II", len(binary), _BINARY) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def names_beside(content: bytes) -> list[str]:
    """Return the names of the files beside a ``.gltf`` that hold its numbers.

    Raises:
        ValueError: it names a file that is not beside it, or is no glTF.
    """
    names = []
    for buffer in json.loads(content).get("buffers", []):
        uri = buffer.get("uri", "")
        if uri.startswith("data:"):
            continue
        name = unquote(uri)
        if not name or Path(name).name != name:
            raise ValueError(f"its numbers are in {name[:80]!r}, which is not a file beside it")
        names.append(name)
    return names


def packed(content: bytes, beside: Callable[[str], bytes]) -> bytes:
    """Return a ``.gltf`` with its buffers as one GLB.

    Args:
        beside: returns the content of a file beside it.

    Raises:
        ValueError: a buffer is missing.
    """
    header = json.loads(content)
    names_beside(content)
    binary, begins = b"", []
    for buffer in header.get("buffers", []):
        uri = buffer.get("uri", "")
        begins.append(len(binary))
        part = base64.b64decode(uri.partition(",")[2]) if uri.startswith("data:") else beside(unquote(uri))
        binary += part + b"\0" * (-len(part) % 4)
    for view in header.get("bufferViews", []):
        view["byteOffset"] = view.get("byteOffset", 0) + begins[view["buffer"]]
        view["buffer"] = 0
    return joined(header | {"buffers": [{"byteLength": len(binary)}]}, binary)


def shapes_alone(content: bytes) -> bytes:
    """Return a GLB with nothing in it but its triangles and where they are.

    Raises:
        ValueError: what it needs is not read, or missing.
    """
    header, binary = split(content)
    for extension in header.get("extensionsRequired", []):
        if extension not in (_DRACO, "KHR_mesh_quantization") and not extension.startswith(_HARMLESS):
            raise ValueError(f"it requires the extension {extension}, which is not read: export it without")
    if any("uri" in buffer for buffer in header.get("buffers", [])):
        raise ValueError("its numbers are in another file: export it as one .glb, or as .gltf with the file beside it")
    kept = _Kept(header, binary)
    meshes = [
        {"primitives": [kept.primitive(each) for each in mesh.get("primitives", [])]}
        for mesh in header.get("meshes", [])
    ]
    nodes = []
    for node in header.get("nodes", []):
        if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            raise ValueError("it repeats shapes by EXT_mesh_gpu_instancing, which is not read: export it without")
        nodes.append({key: node[key] for key in _NODE if key in node})
    children = [child for node in nodes for child in node.get("children", [])]
    if len(set(children)) < len(children):
        raise ValueError("its nodes are not a tree")
    scenes = [{"nodes": scene.get("nodes", [])} for scene in header.get("scenes", [])]
    lean = {"asset": {"version": "2.0"}, "meshes": meshes, "nodes": nodes, "scenes": scenes}
    if "scene" in header:
        lean["scene"] = header["scene"]
    return joined(
        lean | {"accessors": kept.accessors, "bufferViews": kept.views, "buffers": [{"byteLength": len(kept.binary)}]},
        kept.binary,
    )


class _Kept:
    """The accessors of what is kept, and the bytes that they use."""

    def __init__(self, header: dict[str, Any], binary: bytes) -> None:
        self._header, self.binary = header, binary
        self.views: list[dict[str, Any]] = [dict(view) for view in header.get("bufferViews", [])]
        self.accessors: list[dict[str, Any]] = []
        self._places: dict[int, int] = {}

    def primitive(self, primitive: dict[str, Any]) -> dict[str, Any]:
        """Return a primitive with its positions and indices alone."""
        result: dict[str, Any] = {"attributes": {}}
        if "mode" in primitive:
            result["mode"] = primitive["mode"]
        draco = primitive.get("extensions", {}).get(_DRACO)
        if draco is not None:
            result["attributes"]["POSITION"], result["indices"] = self._decoded(draco)
            return result
        if "POSITION" in primitive.get("attributes", {}):
            result["attributes"]["POSITION"] = self._accessor(primitive["attributes"]["POSITION"])
        if "indices" in primitive:
            result["indices"] = self._accessor(primitive["indices"])
        return result

    def _accessor(self, number: int) -> int:
        if number not in self._places:
            accessor = dict(self._header["accessors"][number])
            if "sparse" in accessor:
                raise ValueError("it holds sparse arrays, which are not read: export it without")
            if "bufferView" not in accessor:
                raise ValueError("it counts values that it does not hold")
            if accessor.get("normalized"):
                raise ValueError("its positions are quantised (KHR_mesh_quantization): export it without")
            self._places[number] = self._added(accessor)
        return self._places[number]

    def _added(self, accessor: dict[str, Any]) -> int:
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def _decoded(self, draco: dict[str, Any]) -> tuple[int, int]:
        """Decode compressed triangles and return the accessors of their points and indices."""
        import DracoPy

        view = self._header["bufferViews"][draco["bufferView"]]
        begin = view.get("byteOffset", 0)
        try:
            mesh = DracoPy.decode(self.binary[begin : begin + view["byteLength"]])
            points, faces = np.asarray(mesh.points, "<f4"), np.asarray(mesh.faces, "<u4")
        except Exception as error:  # whatever its native library makes of damaged bytes
            raise ValueError("it is compressed with Draco and cannot be unpacked: export it without") from error
        return self._stored(points, 5126, "VEC3"), self._stored(faces.reshape(-1), 5125, "SCALAR")

    def _stored(self, array: np.ndarray, component: int, kind: str) -> int:
        content = array.tobytes()
        self.views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content)})
        self.binary += content
        accessor = {"bufferView": len(self.views) - 1, "componentType": component, "count": len(array), "type": kind}
        if kind == "VEC3" and len(array):
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        return self._added(accessor)
