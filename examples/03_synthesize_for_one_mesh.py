"""From a mesh file to validated grasps, without DVC: a bobbin that is turned here stands for your own file.

python examples/03_synthesize_for_one_mesh.py [FILE.stl]      (millimetres, z up)
"""

import sys
from pathlib import Path
from tempfile import mkdtemp

import trimesh

import seqgrasp

if len(sys.argv) > 1:
    file = Path(sys.argv[1])
else:
    file = Path(mkdtemp()) / "bobbin.stl"
    outline = [[0, 0], [18, 0], [18, 6], [11, 12], [11, 30], [18, 36], [18, 42], [0, 42]]  # radius and height, mm
    trimesh.creation.revolve(outline).export(file)

parameters = seqgrasp.read_parameters()
hand = seqgrasp.load_hand("allegro")
vertices, faces = seqgrasp.read_mesh(file, unit="mm")
prepared = seqgrasp.prepare_mesh(file.stem, vertices, faces, parameters)
print(f"{prepared.name}: {1000 * prepared.mass:.1f} g, {len(prepared.parts)} convex parts")

candidates = seqgrasp.synthesize(prepared, "pinch", parameters, hand=hand, chains=12)
grasps = seqgrasp.validate(candidates, prepared, parameters, hand=hand)
grasps["outcome"] = grasps["rejected_by"].replace("", "valid")
print(grasps[["grasp_id", "fingers", "energy", "outcome"]].sort_values("energy").round(3).to_string(index=False))
