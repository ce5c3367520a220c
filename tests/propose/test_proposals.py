"""Grasps of two files without a model, and the order of grasps from several methods."""

import json

import numpy as np
import pandas as pd
import pytest
import trimesh
import yaml

from pipeline.propose import __main__ as propose
from pipeline.propose.proposals import ranked
from pipeline.records.tables import MERGED, read_table


def rows(*values: tuple[str, float | None, float | None, float]) -> pd.DataFrame:
    columns = ["rejected_by", "lowest_friction", "robustness", "object_clearance"]
    return pd.DataFrame([dict(zip(columns, own, strict=True)) | {"hand_clearance": 1.0} for own in values])


def test_grasps_of_all_methods_are_in_one_order():
    tables = {
        "model": rows(("", 0.5, 0.9, 0.01), ("contacts", 0.1, 1.0, 0.01), ("", None, None, 0.01)),
        "synthesis": rows(("", 0.3, 0.5, 0.01), ("", 0.5, 1.0, 0.01), ("", 0.1, 1.0, 0.0001)),
    }
    best = ranked(tables, least_room=0.002, count=4)
    assert best["method"].tolist() == ["synthesis", "synthesis", "model", "model"]
    assert best["lowest_friction"].fillna(0).tolist() == [0.3, 0.5, 0.5, 0.0]
    assert best["merged_id"].tolist() == [0, 1, 2, 3]


@pytest.mark.slow
def test_two_meshes_get_grasps_without_a_model(repository, empty_folder):
    """Tiny settings; the can is far from its file's origin."""
    values = yaml.safe_load((repository / "params.yaml").read_text())
    values["synthesize"]["energy"] |= {"object_points": 500, "hand_points": 400}
    values["validate"] |= {"gravity_directions": ["-z", "+x"], "gravity_seconds": 1.0}
    values["robustness"] |= {"ladder": [], "conditions": 0}
    (empty_folder / "params.yaml").write_text(yaml.safe_dump(values))
    trimesh.creation.box((0.042, 0.042, 0.042)).export("cube.stl")
    can = trimesh.creation.cylinder(radius=0.0285, height=0.105, sections=64)
    can.apply_translation([0.0, 5.0, 0.0])
    can.export("can.stl")
    arguments = ["--object0", "cube.stl", "--object1", "can.stl", "-n", "2", "--chains", "32"]
    assert propose.main([*arguments, "--method", "synthesize"]) == 0
    found = read_table(empty_folder / "grasps/grasps.parquet", MERGED, "")
    assert 1 <= len(found) <= 2 and set(found["rejected_by"]) == {""}
    for _, row in found.iterrows():
        assert list(row["objects"]) == ["cube", "can"]
        near, far = (np.linalg.norm(row["positions_hand_object"][number]) for number in (0, 1))
        assert near < 0.3 and 4.5 < far < 5.5
    assert {row["method"] for row in json.loads((empty_folder / "grasps/grasps.json").read_text())} == {"synthesis"}
