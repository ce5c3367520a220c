"""Items of a stage: only those are computed that were not made before with the same fingerprint.

An item is what a stage computes independently of others: an object, an object in a style, a pair, a trial, a capture.
Its fingerprint stands for everything that its result depends on: code, parameters, bytes of inputs, seed. Results of an
earlier run are taken from DVC's cache (:mod:`pipeline.stages.earlier`), those of an interrupted run from where it kept
them (:mod:`pipeline.stages.unfinished`). Either way the output has the bytes of a run from nothing.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, TypeVar

from pipeline.compute.executor import Failed
from pipeline.compute.fan_out import Workers
from pipeline.compute.pool import Work, run_all
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.writing import check_writable, whole_folder, write_json
from pipeline.stages.earlier import EarlierRun, earlier_runs
from pipeline.stages.failures import Failures
from pipeline.stages.outputs import Output
from pipeline.stages.unfinished import Unfinished, remove_finished

Fingerprint = TypeVar("Fingerprint")

RECOMPUTE = "RECOMPUTE"  # environment variable: when it is 1, every item is computed

Keep = Callable[[str, Any], None]  # takes the key and the result of an item that is finished
# From the keys of the items to compute to the work that computes them, each with its name.
Begin = Callable[[Sequence[str], Keep], Sequence[tuple[str, Callable[[], Work]]]]


def one_by_one(work: Callable[[str, Keep], Work]) -> Begin:
    """Return how items begin that are computed each by itself, by their keys and in their order."""
    return lambda keys, keep: [(key, partial(work, key, keep)) for key in keys]


@dataclass(frozen=True)
class Stage:
    """A stage that computes items."""

    name: str  # as in dvc.yaml, such as validate@pinch
    nouns: str  # what its items are, such as objects
    output: Output


def all_wanted() -> bool:
    """Return whether every item is to be computed, whatever was made before."""
    return os.environ.get(RECOMPUTE) == "1"


def fingerprints_of(
    keys: Iterable[str], fingerprint: Callable[[str], Fingerprint]
) -> tuple[dict[str, Fingerprint], dict[str, str]]:
    """Return the fingerprints of items, or what they are made of, by key.

    And why those have none whose inputs are missing or damaged.
    """
    found: dict[str, Fingerprint] = {}
    refused: dict[str, str] = {}
    for key in keys:
        try:
            found[key] = fingerprint(key)
        except UserError as error:
            refused[key] = str(error)
    return found, refused


def make_items(
    stage: Stage,
    fingerprints: Mapping[str, str],
    begin: Begin,
    workers: Workers,
    refused: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Bring the output of a stage up to date.

    An item that fails takes no other with it: all others are computed and written, the failures are a table beside the
    index of items, and the stage ends with a sentence. As DVC saves nothing of such a run, the results of the finished
    items are kept for the next one.

    Args:
        fingerprints: of all items of the output, by key, in the order in which the output holds them.
        begin: returns the work for some of them; the work calls ``keep`` for every item as it is finished. It starts in
            this order, so what takes longest comes first.
        workers: where the work runs.
        refused: items that cannot be computed, with the reason of each.

    Raises:
        UserError: an item could not be computed, or the output cannot be written.
    """
    index, unfinished = paths.items_file(stage.name), Unfinished(stage.name)
    check_writable(stage.output.folder)
    check_writable(index)
    remove_finished()
    everything = all_wanted()
    if everything:
        unfinished.clear()
    earlier = {} if everything else _kept(stage, fingerprints, index)
    done = {key for key, fingerprint in fingerprints.items() if key not in earlier and fingerprint in unfinished}
    missing = [key for key in fingerprints if key not in earlier and key not in done]
    print(_plan(stage, len(missing), len(fingerprints), len(earlier), len(done)), flush=True)
    failures = Failures(stage.name, stage.nouns, refused)

    def keep(key: str, result: Any) -> None:
        with failures.of_the_stage():
            unfinished.keep(fingerprints[key], result)

    def result(key: str) -> Any:
        if key not in earlier:
            return unfinished.result(fingerprints[key])
        run, names = earlier[key]
        return stage.output.read(key, names, lambda name: _present(run, name))

    if missing:
        _compute(stage, missing, begin, keep, workers, failures, lambda key: fingerprints[key] in unfinished)
    lost = {key for key in missing if fingerprints[key] not in unfinished} if failures else set()
    made = {key: fingerprint for key, fingerprint in fingerprints.items() if key not in lost}
    if made or not failures:
        # Nothing is computed inside: an error in there is explained as one of writing.
        with whole_folder(stage.output.folder) as folder:
            stage.output.write(folder, list(made), result)
        write_json(index, made)
    failures.write()
    if failures:
        raise failures.sentence(len(lost) + len(refused), len(fingerprints) + len(refused))
    unfinished.finish(index)


def _plan(stage: Stage, missing: int, wanted: int, kept: int, done: int) -> str:
    interrupted = f", {done} finished by an interrupted run" if done else ""
    return f"{stage.name}: {missing} of {wanted} {stage.nouns} to compute, {kept} kept{interrupted}"


def _compute(
    stage: Stage,
    keys: Sequence[str],
    begin: Begin,
    keep: Keep,
    workers: Workers,
    failures: Failures,
    is_made: Callable[[str], bool],
) -> None:
    """Compute items; what fails of several at once is tried again one by one."""

    def run(works: Sequence[tuple[str, Callable[[], Work]]]) -> None:
        run_all(works, workers, stage.name, lambda name, nothing: None, failures.note)

    def alone(some: Iterable[str]) -> list[tuple[str, Callable[[], Work]]]:
        found: list[tuple[str, Callable[[], Work]]] = []
        for key in some:
            try:
                found += [(key, work) for _, work in begin([key], keep)]
            except UserError as error:
                failures.note(key, Failed(error, ""))
        return found

    try:
        works = begin(keys, keep)
    except UserError:  # an input of one of them
        works = alone(keys)
    run(works)
    if failures and (together := failures.without_row({key for key in keys if not is_made(key)})):
        run(alone(key for key in keys if key in together))


def _kept(stage: Stage, fingerprints: Mapping[str, str], index: Path) -> dict[str, tuple[EarlierRun, list[str]]]:
    """Return, for every item that was made before, the run that made it and the files that hold its result."""
    found: dict[str, tuple[EarlierRun, list[str]]] = {}
    for run in earlier_runs(stage.name, stage.output.folder, index):
        for key, fingerprint in fingerprints.items():
            if key not in found and run.fingerprints.get(key) == fingerprint:
                names = stage.output.files_of(key, run.files)
                if names and all(run.file(name) for name in names):
                    found[key] = run, names
        if len(found) == len(fingerprints):
            break
    return found


def _present(run: EarlierRun, name: str) -> Path:
    path = run.file(name)
    assert path is not None  # of the files that were found sound
    return path


def make_by_hand(stage: Stage, keys: Sequence[str], begin: Begin, workers: Workers) -> None:
    """Compute some items, whatever was made before, and put them beside what the output holds already.

    The index of items goes, as it no longer says what the output holds: DVC makes both again before the next stage
    that depends on them.
    """
    if not keys:
        return
    results: dict[str, Any] = {}
    check_writable(stage.output.folder / keys[0].split("/")[0])
    failures = Failures(stage.name, stage.nouns)
    run_all(begin(keys, results.__setitem__), workers, stage.name, lambda name, nothing: None, failures.note)
    made = [key for key in keys if key in results]
    if failures and not made:
        raise failures.sentence(len(keys), len(keys))
    paths.items_file(stage.name).unlink(missing_ok=True)
    with TemporaryDirectory(dir=stage.output.folder, prefix=".by_hand.", suffix=f".{os.getpid()}.tmp") as folder:
        stage.output.write(Path(folder), made, results.__getitem__)
        for path in sorted(Path(folder).iterdir()):
            stage.output.place(path, stage.output.folder / path.name)
    print(f"{stage.name}: wrote {', '.join(made)}", file=sys.stderr)
    if failures:
        raise failures.sentence(len(keys) - len(made), len(keys))
