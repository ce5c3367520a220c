"""One line on every check and every reason of failure, in the words of a reader who has not seen the code."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.records.merge_reasons import MergeReason
from pipeline.records.reasons import Reason
from pipeline.records.synthesis_reasons import SynthesisReason
from pipeline.records.trial_reasons import TrialReason
from pipeline.records.validation_reasons import ValidationReason


def meanings_of(reasons: type[Reason]) -> dict[str, str]:
    """Return the meaning of every reason by its value, in the order of the checks."""
    return {reason.value: reason.meaning for reason in reasons}


SYNTHESIS = meanings_of(SynthesisReason)
VALIDATION = meanings_of(ValidationReason)
MERGE = meanings_of(MergeReason)
TRIALS = meanings_of(TrialReason)


def meaning_of(reason: str, meanings: Mapping[str, str]) -> str:
    """Return the line on a reason, '' if there is none; what stands after a colon may be a detail, as a direction."""
    return meanings.get(reason) or meanings.get(reason.partition(":")[0], "")
