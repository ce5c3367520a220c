"""Grasps of a finished run, written as others write theirs, get the verdicts of its own tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.hand.model import load_hand
from pipeline.records.poses import pose_matrix
from pipeline.records.synthesis_reasons import SynthesisReason
from pipeline.records.validation_reasons import ValidationReason
from tests.score import foreign_files
from tests.score.foreign_files import Own

pytestmark = pytest.mark.slow
NOT_TESTED = {*(reason.value for reason in SynthesisReason), ValidationReason.NOT_TESTED.value}
STYLES = {"pinch": "cube", "side": "slender_cylinder"}


def judged(root: Path, style: str) -> pd.DataFrame:
    """Rows of a validated table that physics has judged."""
    table = pd.read_parquet(root / f"data/validate/{style}/{STYLES[style]}.parquet")
    return table[~table["rejected_by"].isin(NOT_TESTED)].reset_index(drop=True)


def own(table: pd.DataFrame) -> list[Own]:
    return [
        Own(
            [pose_matrix(row.position_object_hand, row.quaternion_object_hand)],
            np.array(row.q),
            np.array(row.squeeze_q),
            [row.fingers],
            [list(row.contact_candidates)],
        )
        for row in table.itertuples()
    ]


def scores(root: Path, target: Path, *objects: str) -> pd.DataFrame:
    from tests.pipeline.conftest import WorkingCopy

    options = [word for name in objects for word in ("--object", name)]
    done = WorkingCopy(root).command(
        *("python", "-m", "pipeline.score", str(target), *options),
        *("--engine", "sapien", "--output", str(target.with_suffix(".scores"))),
    )
    assert done.returncode == 0, done.stderr
    return pd.read_csv(target.with_suffix(".scores") / "scores.csv", keep_default_na=False)


@pytest.mark.parametrize("style", STYLES)
def test_single_grasps_get_the_verdict_of_our_table(finished, tmp_path, style):
    table, hand = judged(finished.root, style), load_hand("allegro")
    assert len(table)
    foreign_files.dexgraspnet(tmp_path / "g.npy", own(table), hand, contacts=True)
    foreign_files.own_json(tmp_path / "g.json", own(table), hand)
    foreign_files.bodex(tmp_path / "b.npy", own(table), hand)
    for file in ("g.npy", "g.json", "b.npy"):
        found = scores(finished.root, tmp_path / file, STYLES[style])
        assert [not reason for reason in found["sapien_rejected_by"]] == [not reason for reason in table["rejected_by"]]


def test_pairs_get_the_verdict_of_our_table(finished, tmp_path):
    """The released schema, as `pipeline.share.export` writes it: accepted grasps hold."""
    done = finished.command("python", "-m", "pipeline.share.export", str(tmp_path / "pairs.h5"))
    assert done.returncode == 0, done.stderr
    for file in sorted(tmp_path.glob("*.h5")):
        found = scores(finished.root, file, *STYLES.values())
        assert found["sapien_rejected_by"].tolist() == [""] * len(found)
