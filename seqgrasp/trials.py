"""Robot trials of a finished run, once more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.evaluate.execution import Run


@dataclass(frozen=True)
class Rerun:
    """A trial after it was run again."""

    row: dict[str, Any]  # columns of ``TRIALS`` in pipeline/records/tables.py
    differing: list[str]  # columns in which it is not the recorded row, to the last bit


def rerun_trial(name: str, watch: Callable[[Run], None] | None = None, hand: str = "allegro") -> Rerun:
    """Run one recorded trial again, alone, and compare it with its row.

    Args:
        name: ``source/first/second/number``, such as ``synthesized/cube/soup_can/3``.
        watch: called after every control period with the run as it stands; it must only look on.
        hand: name of the hand that is on the arm.

    Raises:
        UserError: there is no such trial, or its inputs have changed since.
    """
    from pipeline.evaluate.rerun import run_again, trial_name
    from pipeline.hand.model import load_hand

    _, row, differing = run_again(trial_name(name), load_hand(hand), watch)
    return Rerun(row, differing)
