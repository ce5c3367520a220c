"""Atomic writing: files and folders appear whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pipeline.records.errors import UserError

SMALLEST_FREE = 1 << 16  # bytes; with less a disk counts as full


def is_full(folder: Path) -> bool:
    """Return whether the disk that holds ``folder`` is full."""
    try:
        return shutil.disk_usage(folder).free < SMALLEST_FREE
    except OSError:
        return False


def _explain(error: Exception, target: Path) -> Exception:
    """Return what to raise for an error in writing ``target``; libraries report a full disk in ways of their own."""
    number = getattr(error, "errno", None)
    nameless = number is None and not isinstance(error, UserError)
    if nameless and ("No space left" in str(error) or is_full(target.parent)):
        number = errno.ENOSPC
    if number in (errno.EACCES, errno.EROFS, errno.EPERM):
        return UserError(f"cannot write {target}: the folder is read-only; make it writable (chmod u+w) and run again.")
    if number in (errno.ENOSPC, errno.EDQUOT):
        return UserError(f"cannot write {target}: the disk is full; free some space and run again.")
    if isinstance(error, OSError):
        return UserError(f"cannot write {target}: {error.strerror or error}.")
    return error


def check_writable(target: Path) -> None:
    """Check before long work that ``target`` can be written, by creating and removing a file beside it.

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
def _explaining(target: Path) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        explained = _explain(error, target)
        if explained is error:
            raise
        raise explained from error


@contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``target`` that is renamed to it if the block succeeds.

    Raises:
        UserError: the folder cannot be written to.
    """
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        with _explaining(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            os.replace(temporary, target)
    finally:
        if temporary.exists():
            temporary.unlink()


@contextmanager
def whole_folder(target: Path) -> Iterator[Path]:
    """Yield a temporary folder beside ``target`` that replaces it if the block succeeds.

    Raises:
        UserError: the folder cannot be written to.
    """
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        with _explaining(target):
            shutil.rmtree(temporary, ignore_errors=True)  # of a killed process that had the same number
            temporary.mkdir(parents=True)
            yield temporary
            replace_folder(temporary, target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def replace_folder(new: Path, target: Path) -> None:
    """Rename a folder to ``target``, replacing what is there; of two processes at once, one leaves its result whole."""
    old = target.with_name(f".{target.name}.old.{os.getpid()}.tmp")
    while True:
        try:
            os.replace(new, target)  # an empty folder is replaced at once
            return
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        with suppress(FileNotFoundError):  # another process was quicker
            os.replace(target, old)
            shutil.rmtree(old)


def json_text(content: Any) -> str:
    """Return ``content`` as sorted, indented JSON."""
    return json.dumps(content, indent=2, sort_keys=True) + "\n"


def write_json(target: Path, content: Any) -> None:
    """Write ``content`` as sorted, indented JSON."""
    with whole_file(target) as temporary:
        temporary.write_text(json_text(content))
