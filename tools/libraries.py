"""System libraries that the packages load: try each, and install what is missing (as root) or say what to install.

Only the standard library is used, so that this runs before anything is installed. Which package needs what was found
by reading the wheels' dynamic sections and by importing them with each library hidden.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass

from pipeline.stages.running import command

MISSING = 3  # exit code


@dataclass(frozen=True)
class Library:
    """A shared library, its Debian package, and the stages whose imports load it."""

    file: str
    package: str
    stages: tuple[str, ...]


PHYSICS = ("validate", "merge", "evaluate")
PICTURES = ("prepare", "report")
PHOTOS = ("capture", "reconstruct")

LIBRARIES = (
    Library("libX11.so.6", "libx11-6", (*PHYSICS, *PICTURES, *PHOTOS)),  # sapien, open3d
    Library("libGL.so.1", "libgl1", (*PHYSICS, *PICTURES, *PHOTOS)),  # opencv (also inside mani_skill), open3d
    Library("libgthread-2.0.so.0", "libglib2.0-0", (*PHYSICS, *PHOTOS)),  # opencv (also inside mani_skill)
    Library("libEGL.so.1", "libegl1", (*PICTURES, *PHOTOS)),  # open3d
    Library("libusb-1.0.so.0", "libusb-1.0-0", (*PICTURES, *PHOTOS)),  # open3d
    Library("libgomp.so.1", "libgomp1", ("evaluate",)),  # pinocchio
)


def missing_libraries() -> list[Library]:
    """Return the libraries that the dynamic loader cannot load."""

    def loads(file: str) -> bool:
        try:
            ctypes.CDLL(file)
        except OSError:
            return False
        return True

    return [library for library in LIBRARIES if not loads(library.file)]


def advice(missing: list[Library]) -> str:
    """Return one line: what to install, and which stages cannot run without it."""
    stages = sorted({stage for library in missing for stage in library.stages})
    packages = " ".join(library.package for library in missing)
    return f"run `sudo apt-get install {packages}`: without it the stages {', '.join(stages)} cannot run."


def install(missing: list[Library]) -> None:
    """Install the Debian packages of ``missing`` with apt-get; its output goes to stderr.

    Raises:
        subprocess.CalledProcessError: apt-get failed.
    """
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    command = ["apt-get", "install", "-y", "-qq", "--no-install-recommends", *(library.package for library in missing)]
    for step in (["apt-get", "update", "-qq"], command):
        subprocess.run(step, check=True, stdin=subprocess.DEVNULL, stdout=sys.stderr, env=environment)


@command("libraries")
def main(arguments: list[str] | None = None) -> int:
    """Check, install if possible, and return 0 or :data:`MISSING`."""
    parser = argparse.ArgumentParser(prog="python -m tools.libraries", description=__doc__)
    parser.add_argument("--no-install", action="store_true", help="only report what is missing, even as root")
    chosen = parser.parse_args(arguments)
    missing = missing_libraries()
    if missing and not chosen.no_install and os.geteuid() == 0 and shutil.which("apt-get"):
        print(f"installing {' '.join(library.package for library in missing)}", file=sys.stderr)
        try:
            install(missing)
        except (subprocess.CalledProcessError, OSError) as error:
            print(f"apt-get failed: {error}", file=sys.stderr)
        # The loader remembers failures of this process only, so ask a new one.
        again = [sys.executable, "-m", "tools.libraries", "--no-install"]
        return subprocess.run(again, check=False).returncode
    if missing:
        print(advice(missing), file=sys.stderr)
        return MISSING
    return 0


if __name__ == "__main__":
    sys.exit(main())
