"""Files and folders that appear whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipeline.records.errors import UserError


def _explain(error: OSError, target: Path) -> UserError:
    if error.errno in (errno.EACCES, errno.EROFS, errno.EPERM):
        return UserError(f"cannot write {target}: the folder is read-only; make it writable (chmod u+w) and run again.")
    if error.errno == errno.ENOSPC:
        return UserError(f"cannot write {target}: the disk is full; free some space and run again.")
    return UserError(f"cannot write {target}: {error.strerror or error}.")


def check_writable(target: Path) -> None:
    """Find out before long work whether ``target`` can be written, by making and removing a file beside it.

    Raises:
        UserError: the folder cannot be written to.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=target.parent):
            pass
    except OSError as error:
        raise _explain(error, target) from error


@contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``target`` that is renamed to it when the block ends well.

    Raises:
        UserError: the folder cannot be written to.
    """
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        raise _explain(error, target) from error
    finally:
        if temporary.exists():
            temporary.unlink()


@contextmanager
def whole_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder beside ``target`` that replaces it when the block ends well.

    Raises:
        UserError: the folder cannot be written to.
    """
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        temporary.mkdir(parents=True)
        yield temporary
        if target.exists():
            shutil.rmtree(target)
        os.replace(temporary, target)
    except OSError as error:
        raise _explain(error, target) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_json(target: Path, content: Any) -> None:
    """Write ``content`` as sorted, indented JSON."""
    with whole_file(target) as temporary:
        temporary.write_text(json.dumps(content, indent=2, sort_keys=True) + "\n")
