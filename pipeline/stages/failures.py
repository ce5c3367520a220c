"""Items of a stage that could not be computed: a table of them with their reasons, and a log of each defect."""

from __future__ import annotations

import csv
import io
import re
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

from pipeline.compute.executor import Failed
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.writing import whole_file


class Failures:
    """What failed in one run of a stage."""

    def __init__(self, stage: str, nouns: str, refused: Mapping[str, str] = MappingProxyType({})) -> None:
        self._stage, self._nouns = stage, nouns
        self._refused = refused
        self._rows = [(key, reason, "") for key, reason in refused.items()]  # item, reason, log
        self._of_the_stage: Exception | None = None

    def __bool__(self) -> bool:
        """Return whether anything failed."""
        return bool(self._rows)

    @contextmanager
    def of_the_stage(self) -> Iterator[None]:
        """Let whatever fails inside end the stage: no item can be kept where one cannot."""
        try:
            yield
        except Exception as error:
            self._of_the_stage = error
            raise

    def note(self, key: str, failed: Failed) -> None:
        """Note that an item failed."""
        if self._of_the_stage is not None:
            raise self._of_the_stage
        if isinstance(failed.error, UserError):
            self._rows.append((key, str(failed.error), ""))
        else:
            log = write_log(f"{self._stage}.{key}", failed.trace)
            self._rows.append((key, f"{defect(failed.error)}; its log is {log}", str(log)))

    def without_row(self, lost: Collection[str]) -> set[str]:
        """Return items without result that failed under another name, that of several, and forget that row."""
        together = set(lost) - {key for key, _, _ in self._rows}
        if together:
            self._rows = [row for row in self._rows if row[0] in lost or row[0] in self._refused]
        return together

    def write(self) -> None:
        """Write the table, or remove that of an earlier run."""
        target = paths.failures_file(self._stage)
        if not self._rows:
            target.unlink(missing_ok=True)
            return
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([("item", "reason", "log"), *sorted(self._rows)])
        with whole_file(target) as temporary:
            temporary.write_text(text.getvalue(), encoding="utf-8")

    def sentence(self, lost: int, wanted: int) -> UserError:
        """Return what ends the stage."""
        key, reason, _ = min(self._rows)
        reasons = {reason for _, reason, _ in self._rows}
        if wanted == 1 or (lost == wanted and len(reasons) == 1):
            return UserError(reason)
        own = reason if reason.startswith(key) else f"{key}: {reason}"
        others = f" (and {len(self._rows) - 1} more)" if len(reasons) > 1 else ""
        rest = "the others are kept" if lost < wanted else "none is left"
        return UserError(
            f"{lost} of {wanted} {self._nouns} failed, {rest}; all reasons are in {paths.failures_file(self._stage)}; "
            f"the first{others}: {own}"
        )


def defect(error: Exception) -> str:
    """Return an unforeseen exception in words."""
    said = " ".join(str(error).split())[:200].rstrip(".")
    return f"a defect of the program ({type(error).__name__}{': ' if said else ''}{said})"


def write_log(name: str, text: str) -> Path:
    """Write what a developer reads, and return where: in the project, or, if that fails, the system's folder."""
    plain = re.sub(r"[^A-Za-z0-9._-]+", "-", name)
    for folder in (paths.LOGS_FOLDER, Path(tempfile.gettempdir())):
        target = folder / f"{plain}.log"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            target.write_text(text, encoding="utf-8")
        except OSError:
            continue
        return target
    return Path("nowhere, as no folder can be written to")
