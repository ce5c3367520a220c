"""Load the two-object grasps of a finished run, or of anybody's repository, as one pandas table.

python examples/01_load_dataset.py [REPOSITORY]
"""

import sys

import numpy as np

import seqgrasp

repository = sys.argv[1] if len(sys.argv) > 1 else "."
grasps = seqgrasp.load_grasps(repository)
print(f"{len(grasps)} grasps of two objects in one hand\n")
print(grasps.groupby(["object0", "object1", "fingers0"]).size().to_string(), "\n")

q = np.stack(grasps["q"])
print(f"joints {q.shape}: {np.degrees(q.min()):.0f} to {np.degrees(q.max()):.0f} degrees")
print(f"room between the objects: median {1000 * grasps['object_clearance'].median():.1f} mm\n")

for column in ("q", "squeeze_q", "object_clearance"):
    print(f"{column}: {seqgrasp.GRASP_COLUMNS[column]}")
