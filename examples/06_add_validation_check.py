"""A check of your own on top of physics: no joint closer to its limit than a real hand's controller likes.

    python examples/06_add_validation_check.py

docs/architecture.md says where the same check goes to become part of the stage `validate`.
"""

import numpy as np
import pandas as pd
import trimesh

import seqgrasp

LEAST_MARGIN = 0.02  # rad

parameters = seqgrasp.read_parameters()
hand = seqgrasp.load_hand("allegro")


def joint_margin(row: pd.Series) -> tuple[dict[str, float], str]:
    """Return the columns that the check adds to a grasp, and why it rejects the grasp, '' where it does not."""
    q = np.asarray(row["q"])
    own = [joint for finger in row["fingers"].split("+") for joint in hand.finger_joints[finger]]
    margin = float(np.minimum(q - hand.lower, hand.upper - q)[own].min())
    return {"joint_margin": margin}, "joint_margin" if margin < LEAST_MARGIN else ""


block = trimesh.creation.box((0.042, 0.042, 0.042))
prepared = seqgrasp.prepare_mesh("block", block.vertices, block.faces, parameters)
candidates = seqgrasp.synthesize(prepared, "pinch", parameters, hand=hand, chains=12)
grasps = seqgrasp.validate(candidates, prepared, parameters, hand=hand)

grasps["joint_margin"] = float("nan")
for index, row in grasps[grasps["rejected_by"] == ""].iterrows():
    columns, reason = joint_margin(row)
    for name, value in [*columns.items(), ("rejected_by", reason)]:
        grasps.loc[index, name] = value

print(grasps["rejected_by"].replace("", "valid").value_counts().to_string())
print(grasps[["grasp_id", "fingers", "joint_margin", "rejected_by"]].dropna().round(3).to_string(index=False))
