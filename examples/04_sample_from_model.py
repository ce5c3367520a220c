"""Draw two-object grasps of two meshes or point clouds from the trained model of a finished run.

python examples/04_sample_from_model.py [FIRST SECOND]      (metres, z up)
"""

import sys

import seqgrasp

first, second = sys.argv[1:] or ("data/prepare/cube/mesh.ply", "data/prepare/slender_cylinder/mesh.ply")
grasps = seqgrasp.sample_grasps(first, second, count=4, output="grasps")
grasps["room between objects, mm"] = 1000 * grasps["object_clearance"].astype(float)
print(grasps[["merged_id", "room between objects, mm"]].round(1).to_string(index=False))
print("grasps/grasps.html shows them in 3D")
