"""Remove what killed stages and a killed DVC left behind.

A stage that is killed while writing leaves a temporary file or folder of no value. DVC writes two of its own files in
place: a kill can truncate them, and DVC then refuses to run. Its list of running processes is removed in that case.
Its record `dvc.lock` is moved to `dvc.lock.damaged.tmp`: DVC also knows all runs from its cache, and restores their
results instead of recomputing them.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import sys
from pathlib import Path

import yaml

from pipeline.records.texts import parse_json, parse_yaml
from pipeline.stages.running import command

LOCK_FILE = Path("dvc.lock")
BUSY_FILE = Path(".dvc/tmp/rwlock")
TEMPORARY = re.compile(r"\..+\.(\d+)\.tmp")  # see records.writing


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def abandoned_files() -> list[Path]:
    """Return temporary files and folders of stages that were killed while writing, sorted."""
    return sorted(
        entry
        for folder, below in ((Path("."), ""), (Path("data"), "**/"), (Path("models"), "**/"), (Path("reports"), "**/"))
        for entry in folder.glob(f"{below}.*.tmp")
        if (match := TEMPORARY.fullmatch(entry.name)) and not _alive(int(match[1]))
    )


def truncated_files() -> list[Path]:
    """Return those of DVC's own files that a kill truncated; none while another DVC holds its lock."""
    found = []
    try:
        if not isinstance(parse_json(BUSY_FILE.read_text()), dict):
            found.append(BUSY_FILE)
    except FileNotFoundError:
        pass
    except (OSError, ValueError):
        found.append(BUSY_FILE)
    try:
        content = parse_yaml(LOCK_FILE.read_text())
        if not isinstance(content, dict) or "schema" not in content:
            found.append(LOCK_FILE)
    except FileNotFoundError:
        pass
    except (OSError, ValueError, yaml.YAMLError):
        found.append(LOCK_FILE)
    return found if found and not _dvc_runs() else []


def _dvc_runs() -> bool:
    """Return whether a DVC of this repository holds its lock, or is busy with a stage."""
    try:
        busy = BUSY_FILE.read_text()
    except OSError:
        busy = ""
    return any(_alive(int(number)) for number in re.findall(r'"pid": (\d+)', busy))


def mend() -> list[Path]:
    """Set aside what :func:`truncated_files` finds, and return it."""
    found = truncated_files()
    for path in found:
        if path == LOCK_FILE:
            path.replace(path.with_name(f"{path.name}.damaged.tmp"))
        else:
            path.unlink()
    return found


def prune() -> list[Path]:
    """Remove what :func:`abandoned_files` finds, and return it."""
    removed = abandoned_files()
    for path in removed:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    return removed


@command("prune")
def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    argparse.ArgumentParser(prog="python -m tools.prune", description=__doc__).parse_args(arguments)
    for path in mend():
        print(f"set aside {path}: a killed DVC left it truncated; its content is known from the cache", file=sys.stderr)
    for path in prune():
        print(f"removed {path}: a killed process left it half-written", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
