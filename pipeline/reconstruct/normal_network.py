"""Normal maps by a network of the user's choice, given as an ONNX file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError

# What a network wants of colours of 0 to 1: they are reduced by the first and divided by the second.
SCALES = {
    "imagenet": ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225)),
    "zero-one": ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    "minus-one-one": ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5)),
}
DIRECTIONS = {  # of the camera frame: x right, y down, z forward
    **{"right": (0, 1), "left": (0, -1), "down": (1, 1), "up": (1, -1)},
    **{"forward": (2, 1), "toward": (2, -1)},
}
SIDE, MULTIPLE = 768, 32  # pixels: longer side where the network takes any size, and what both sides are a multiple of
FACING = 0.8  # of the normals, that must face the camera


@dataclass(frozen=True)
class Convention:
    """How a network wants colours, and what its three numbers mean."""

    scale: str  # a key of SCALES
    axes: tuple[str, str, str]  # where its x, y and z point, keys of DIRECTIONS

    def matrix(self) -> NDArray[np.float32]:
        """Return (3, 3) what turns the network's normals into those of the camera frame: x right, y down, z forward."""
        turn = np.zeros((3, 3), np.float32)
        for column, word in enumerate(self.axes):
            row, sign = DIRECTIONS[word]
            turn[row, column] = sign
        return turn


def convention(scale: str, axes: str) -> Convention:
    """Return the convention that a user wrote, ``axes`` such as ``right,up,toward``.

    Raises:
        UserError: they are not three directions across each other.
    """
    words = axes.replace(",", " ").split()
    known = [DIRECTIONS[word][0] for word in words if word in DIRECTIONS]
    if len(words) != 3 or sorted(known) != [0, 1, 2]:
        raise UserError(
            f"--axes {axes!r} is not where x, y and z point; write one of right and left, of up and down, and of "
            "forward and toward, in the network's order, such as right,up,toward."
        )
    return Convention(scale, (words[0], words[1], words[2]))


@dataclass(frozen=True)
class NormalNetwork:
    """A network that is loaded."""

    path: Path
    session: Any  # onnxruntime.InferenceSession
    name: str  # of its input
    last: bool  # colours are the last axis, not the second
    size: tuple[int, int] | None  # height and width that it takes, pixels; None: any
    convention: Convention


def load_network(path: Path, convention: Convention) -> NormalNetwork:
    """Load a network with one input (1, 3, h, w) or (1, h, w, 3) of 32-bit numbers.

    Raises:
        UserError: onnxruntime is not installed, or the file is no such network.
    """
    if not path.is_file():
        raise UserError(f"there is no network {path}; check the name.")
    try:
        import onnxruntime
    except ImportError as error:
        raise UserError(
            "onnxruntime, which runs networks, is not installed; run pip install -c constraints.txt -e '.[normals]'."
        ) from error
    try:
        session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    except Exception as error:  # it raises a kind of its own for every damage
        said = " ".join(str(error).split())[:120]
        raise UserError(f"{path} is no ONNX network that can be run ({said}); export it again.") from error
    inputs = session.get_inputs()
    shape = list(inputs[0].shape) if inputs else []
    if len(inputs) != 1 or len(shape) != 4 or 3 not in (shape[1], shape[3]) or inputs[0].type != "tensor(float)":
        raise UserError(
            f"{path} takes {[(one.name, one.shape, one.type) for one in inputs]}; a network for normals takes "
            "one photo of shape (1, 3, height, width) or (1, height, width, 3) as 32-bit numbers."
        )
    last = shape[1] != 3
    height, width = shape[1:3] if last else shape[2:]
    size = (height, width) if isinstance(height, int) and isinstance(width, int) else None
    return NormalNetwork(path, session, inputs[0].name, last, size, convention)


def _fitted(colours: NDArray[np.uint8], size: tuple[int, int] | None) -> tuple[NDArray[np.uint8], int, int]:
    """Return a photo (h, w, 3) scaled alike both ways, its edge repeated to fill ``size``, and its own extent."""
    height, width = colours.shape[:2]
    scale = min(size[0] / height, size[1] / width) if size else SIDE / max(height, width)
    rows, columns = max(round(scale * height), 1), max(round(scale * width), 1)
    target = size or tuple(-(-side // MULTIPLE) * MULTIPLE for side in (rows, columns))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(colours, (columns, rows), interpolation=how)
    padded = np.pad(small, ((0, target[0] - rows), (0, target[1] - columns), (0, 0)), mode="edge")
    return np.asarray(padded, np.uint8), rows, columns


def normals_of(network: NormalNetwork, colours: NDArray[np.uint8], name: str) -> NDArray[np.float16]:
    """Return the normals (h, w, 3) of a photo (h, w, 3), unit vectors in the camera frame: x right, y down, z forward.

    Raises:
        UserError: the network fails, gives something else than normals, or normals that point away from the camera.
    """
    padded, rows, columns = _fitted(colours, network.size)
    mean, spread = SCALES[network.convention.scale]
    values = ((padded / 255 - np.array(mean)) / np.array(spread))[None].astype(np.float32)
    try:
        found = network.session.run(None, {network.name: values if network.last else values.transpose(0, 3, 1, 2)})[0]
    except Exception as error:  # see load_network
        said = " ".join(str(error).split())[:120]
        raise UserError(f"{network.path} fails on {name} ({said}); export it for photos of this size.") from error
    found = _channels_last(np.asarray(found), network.path)
    if found.shape[:2] != padded.shape[:2]:  # a network may give fewer pixels than it takes
        found = cv2.resize(found, (padded.shape[1], padded.shape[0]), interpolation=cv2.INTER_LINEAR)
    own = cv2.resize(found[:rows, :columns], colours.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    own = own @ network.convention.matrix().T
    own /= np.maximum(np.linalg.norm(own, axis=2, keepdims=True), 1e-6)
    facing = float((own[..., 2] < 0).mean())
    if facing < FACING:
        raise UserError(
            f"only {facing:.0%} of the normals of {name} face the camera; write in --axes where the network's x, y "
            "and z point."
        )
    return own.astype(np.float16)


def _channels_last(found: NDArray[Any], path: Path) -> NDArray[np.float32]:
    """Return what a network gave as (h, w, 3)."""
    if found.ndim == 4 and found.shape[0] == 1:
        found = found[0]
    if found.ndim == 3 and found.shape[0] == 3 and found.shape[2] != 3:
        found = found.transpose(1, 2, 0)
    if found.ndim != 3 or found.shape[2] != 3 or not np.isfinite(found).all():
        raise UserError(
            f"{path} gives {found.shape}, not three finite numbers per pixel; it is no network for normals."
        )
    return np.ascontiguousarray(found, np.float32)
