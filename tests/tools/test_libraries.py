"""System libraries: found missing as on a bare machine, installed when root, otherwise named in one line."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tools import libraries


@pytest.fixture
def hide(monkeypatch):
    """Make the loader fail for some libraries, as where they are not installed."""

    def fail_for(*files: str) -> None:
        real = libraries.ctypes.CDLL

        def load(file: str):
            if file in files:
                raise OSError(f"{file}: cannot open shared object file: No such file or directory")
            return real(file)

        monkeypatch.setattr(libraries.ctypes, "CDLL", load)

    return fail_for


def test_this_machine_has_everything(capsys):
    assert libraries.main([]) == 0
    assert capsys.readouterr().err == ""


def test_one_line_names_packages_and_stages_without_root(hide, monkeypatch, capsys):
    hide("libEGL.so.1", "libgomp.so.1")
    monkeypatch.setattr(libraries.os, "geteuid", lambda: 1000)
    assert libraries.main([]) == libraries.MISSING
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "sudo apt-get install libegl1 libgomp1" in said
    assert "evaluate" in said and "validate" not in said


def test_root_installs_what_is_missing_and_looks_again(hide, monkeypatch, capsys):
    hide("libusb-1.0.so.0")
    commands = []
    monkeypatch.setattr(libraries.os, "geteuid", lambda: 0)
    monkeypatch.setattr(libraries.shutil, "which", lambda name: f"/usr/bin/{name}")

    def run(command, **options):
        commands.append(command)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(libraries.subprocess, "run", run)
    assert libraries.main([]) == 0
    assert [command[:2] for command in commands[:2]] == [["apt-get", "update"], ["apt-get", "install"]]
    assert commands[1][-1] == "libusb-1.0-0"
    assert commands[2][0] == sys.executable  # a new process, as the loader remembers


def test_a_failing_apt_get_ends_in_the_advice(hide, monkeypatch, capsys):
    monkeypatch.setattr(libraries, "missing_libraries", lambda: [libraries.LIBRARIES[0]])
    monkeypatch.setattr(libraries.os, "geteuid", lambda: 0)
    monkeypatch.setattr(libraries.shutil, "which", lambda name: f"/usr/bin/{name}")

    def run(command, **options):
        if command[0] == "apt-get":
            raise subprocess.CalledProcessError(100, command)
        assert command[1:3] == ["-m", "tools.libraries"]
        return subprocess.CompletedProcess(command, libraries.main(command[3:]))

    monkeypatch.setattr(libraries.subprocess, "run", run)
    assert libraries.main([]) == libraries.MISSING
    assert capsys.readouterr().err.splitlines()[-1].startswith("run `sudo apt-get install libx11-6`")


def _library_file(name: str) -> Path | None:
    for folder in ("/lib/x86_64-linux-gnu", "/usr/lib/x86_64-linux-gnu", "/usr/lib64", "/usr/lib"):
        if (Path(folder) / name).exists():
            return (Path(folder) / name).resolve()
    return None


@pytest.mark.skipif(os.geteuid() != 0 or not shutil.which("unshare"), reason="hiding a library needs root")
@pytest.mark.parametrize("apt_get", ["absent", "failing"])
def test_a_truly_hidden_library_is_found_missing(repository, tmp_path, apt_get):
    """In a private mount name space an empty file covers the library, and apt-get is of no help."""
    if apt_get == "failing":
        (tmp_path / "apt-get").write_text("#!/bin/sh\nexit 100\n")
        (tmp_path / "apt-get").chmod(0o755)
    library = _library_file("libusb-1.0.so.0")
    if library is None:
        pytest.skip("libusb is elsewhere")
    mount = shutil.which("mount")
    script = f"{mount} --bind /dev/null {library} && exec {sys.executable} -m tools.libraries"
    done = subprocess.run(
        [shutil.which("unshare"), "--mount", "/bin/sh", "-c", script],
        cwd=repository,
        capture_output=True,
        text=True,
        env={"PATH": str(tmp_path)},
    )
    if "permission denied" in done.stderr.lower() or "not permitted" in done.stderr:
        pytest.skip("this machine lets nobody mount")
    assert done.returncode == libraries.MISSING, done.stderr
    said = done.stderr.splitlines()
    assert said[-1] == libraries.advice([_named("libusb-1.0.so.0")])
    assert len(said) == (1 if apt_get == "absent" else 3)  # before it: what is being installed, and that it failed


def _named(file: str) -> libraries.Library:
    return next(library for library in libraries.LIBRARIES if library.file == file)
