"""Whether two processes would compute the same bytes: with the same code and packages, on like processors."""

from __future__ import annotations

import hashlib
import sys
from functools import lru_cache
from importlib import metadata
from pathlib import Path

import numpy as np

import pipeline

# Packages that enter results.
PACKAGES = (
    "coacd",
    "coal",
    "manifold3d",
    "mani-skill",
    "mujoco-core",
    "numpy",
    "open3d",
    "opencv-python",
    "pin",
    "pycolmap",
    "sapien",
    "scipy",
    "toppra",
    "torch",
    "trimesh",
    "warp-lang",
)


def source_digest(folder: Path) -> str:
    """Return a fingerprint of all files of a source tree, whatever git says of them."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            content = path.read_bytes()
            digest.update(f"{path.relative_to(folder).as_posix()}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "missing"


def _processor() -> str:
    """Return which instructions the libraries of arrays use here.

    They round differently: with ``OPENBLAS_CORETYPE=Nehalem``, or with AVX2 kept from numpy, the bytes of validation
    are others.
    """
    import threadpoolctl

    found = np.show_config(mode="dicts")["SIMD Extensions"]["found"]  # type: ignore[index]
    loaded = [each for each in threadpoolctl.threadpool_info() if each["internal_api"] == "openblas"]
    # Other packages bring a BLAS of their own, which one process may have loaded and the other not yet.
    own = [each for each in loaded if "numpy.libs" in Path(each["filepath"]).parts] or loaded
    return "+".join([*sorted({each["architecture"] for each in own}), *found])


@lru_cache(maxsize=1)
def circumstances() -> dict[str, str]:
    """Return what this process computes with, as it was when this was first asked here."""
    return {
        "the code of pipeline/": source_digest(Path(pipeline.__file__).parent),
        "the processor, as numpy uses it,": _processor(),
        "python": ".".join(map(str, sys.version_info[:2])),
        **{package: _version(package) for package in PACKAGES},
    }


def difference(expected: dict[str, str]) -> str:
    """Return what of ``expected`` is otherwise in this process, '' when nothing is."""
    own = circumstances()
    found = [name for name, value in expected.items() if own.get(name) != value]
    if not found:
        return ""
    first = found[0]
    if first.startswith("the code"):
        return f"{first} is another one"
    return f"{first} is {own.get(first, 'missing')} there and {expected[first]} here"
