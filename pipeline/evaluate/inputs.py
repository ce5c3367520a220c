"""What the trials of a source depend on: its tables of grasps, the objects, the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pipeline.records import paths

if TYPE_CHECKING:
    from pipeline.evaluate.trial import TrialInput

# Where the grasps of a source are, and the stage that makes them.
GRASPS = {
    "synthesized": (paths.merged_file, "merge"),
    "learned": (paths.sampled_file, "sample"),
    paths.RECONSTRUCTED: (paths.reconstructed_file, "sample-reconstructed"),
}


def sections(source: str, object_name: str) -> list[str]:
    """Parameter sections that ``evaluate-<source>@<object>`` declares in ``dvc.yaml``."""
    pairs = f"reconstructed.{object_name}" if source == paths.RECONSTRUCTED else "styles"
    return ["seed", pairs, "physics", "evaluate"]


def second_objects(source: str, first: str, parameters: dict[str, Any]) -> list[str]:
    """Return the names of the objects that are picked after ``first``.

    Raises:
        UserError: ``styles.pinch`` does not name the first object.
    """
    if source == paths.RECONSTRUCTED:
        return list(parameters[f"reconstructed.{first}"].side)
    return list(parameters["styles"].after(first))


def inputs_of_pairs(source: str, first: str, seconds: Sequence[str], parameters: dict[str, Any]) -> list[TrialInput]:
    """Return the inputs of all trials of ``first`` with each of ``seconds``.

    Args:
        parameters: the ``sections(source, first)``.

    Raises:
        UserError: a table of grasps or an object is missing or damaged.
    """
    from pipeline.evaluate.grasps import accepted_grasps
    from pipeline.evaluate.reconstructed import in_true_frames, true_from_reconstructed
    from pipeline.evaluate.scene import without_grid
    from pipeline.evaluate.trial import trial_inputs
    from pipeline.records.objects import load_prepared_object
    from pipeline.records.tables import MERGED, read_table

    file_of, made_by = GRASPS[source]
    grasps = {
        second: accepted_grasps(read_table(file_of(first, second), MERGED, f"{made_by}@{first}")) for second in seconds
    }
    objects = {name: without_grid(load_prepared_object(name)) for name in dict.fromkeys([first, *seconds])}
    if source == paths.RECONSTRUCTED:
        capture = parameters[f"reconstructed.{first}"].capture
        T = {name: true_from_reconstructed(capture, prepared) for name, prepared in objects.items()}
        grasps = {
            second: [in_true_frames(grasp, T[first], T[second]) for grasp in own] for second, own in grasps.items()
        }
    return [
        trial
        for second in seconds
        for trial in trial_inputs(
            source,
            (objects[first], objects[second]),
            grasps[second],
            parameters["evaluate"],
            parameters["physics"],
            parameters["seed"],
        )
    ]
