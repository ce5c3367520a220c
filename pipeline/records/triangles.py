"""Binary STL whose header and body disagree, as some programs write it."""

from __future__ import annotations

import struct

_HEAD, _TRIANGLE = 84, 50  # bytes


def sound_stl(content: bytes) -> bytes:
    """Return an STL file whose header counts the triangles that it holds, and that ends with the last of them.

    Raises:
        ValueError: it is cut off, or holds no triangle.
    """
    if _is_text(content):
        return content
    if len(content) < _HEAD:
        raise ValueError("it ends within its header")
    (announced,) = struct.unpack_from("<I", content, _HEAD - 4)
    held, rest = divmod(len(content) - _HEAD, _TRIANGLE)
    if announced > held:
        raise ValueError(f"it is cut off: it announces {announced} triangles and holds {held}")
    if announced == 0 and rest == 0:
        announced = held
    if announced == 0:
        raise ValueError("it holds no triangle")
    return content[: _HEAD - 4] + struct.pack("<I", announced) + content[_HEAD : _HEAD + announced * _TRIANGLE]


def _is_text(content: bytes) -> bool:
    """Return whether it is written as text: headers of binary files may begin with the same word."""
    begin = content[:1000].lower()
    return begin.lstrip().startswith(b"solid") and (b"facet" in begin or b"endsolid" in begin) and b"\0" not in begin
