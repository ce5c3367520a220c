"""Results of items that an interrupted stage had finished: kept in a folder that git and DVC ignore.

They are kept until ``dvc.lock`` names the output that the finished stage made of them.
"""

from __future__ import annotations

import hashlib
import pickle
import shutil
from pathlib import Path
from typing import Any

from pipeline.records import paths
from pipeline.records.writing import whole_file
from pipeline.stages.earlier import locked_outputs

_DIGEST = hashlib.sha256().digest_size
_FINISHED = "finished"


class Unfinished:
    """Results of one stage's items, by fingerprint."""

    def __init__(self, stage: str) -> None:
        self.folder = paths.UNFINISHED_FOLDER / stage

    def __contains__(self, fingerprint: str) -> bool:
        """Return whether the result of this fingerprint is there and whole."""
        return self._content(fingerprint) is not None

    def keep(self, fingerprint: str, result: Any) -> None:
        """Keep the result of an item, whole or not at all."""
        content = pickle.dumps(result, protocol=pickle.HIGHEST_PROTOCOL)
        with whole_file(self._file(fingerprint)) as temporary:
            temporary.write_bytes(hashlib.sha256(content).digest() + content)

    def result(self, fingerprint: str) -> Any:
        """Return a result that is there."""
        content = self._content(fingerprint)
        assert content is not None
        return pickle.loads(content)

    def finish(self, index: Path) -> None:
        """Note which output holds all of it; see :func:`remove_finished`."""
        with whole_file(self.folder / _FINISHED) as temporary:
            temporary.write_text(f"{index.as_posix()} {hashlib.md5(index.read_bytes()).hexdigest()}")

    def clear(self) -> None:
        """Remove everything."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _file(self, fingerprint: str) -> Path:
        return self.folder / f"{fingerprint}.pickle"

    def _content(self, fingerprint: str) -> bytes | None:
        try:
            content = self._file(fingerprint).read_bytes()
        except OSError:
            return None
        return content[_DIGEST:] if hashlib.sha256(content[_DIGEST:]).digest() == content[:_DIGEST] else None


def remove_finished() -> None:
    """Remove the results of stages whose outputs DVC has saved."""
    for note in paths.UNFINISHED_FOLDER.glob(f"*/{_FINISHED}"):
        path, _, md5 = note.read_text().rpartition(" ")
        if locked_outputs(note.parent.name).get(path) == md5:
            shutil.rmtree(note.parent, ignore_errors=True)
