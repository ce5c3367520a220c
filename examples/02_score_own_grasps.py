"""Score grasps from anywhere by the pipeline's energy and physics: here one grasp, and the same one spoilt in two ways.

python examples/02_score_own_grasps.py
"""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

import seqgrasp

parameters = seqgrasp.read_parameters()
hand = seqgrasp.load_hand("allegro")
block = trimesh.creation.box((0.042, 0.042, 0.042))
prepared = seqgrasp.prepare_mesh("block", block.vertices, block.faces, parameters)

# Thumb and middle finger on two faces of the block; hand frame in the object's frame, m and rad.
grasp = np.eye(4)
grasp[:3, :3] = Rotation.from_matrix(
    [[0.0165, -0.2821, 0.9593], [-0.0575, 0.9575, 0.2825], [-0.9982, -0.0598, -0.0004]]
).as_matrix()
grasp[:3, 3] = [-0.0177, -0.0240, 0.0986]
index, middle, ring = [0.177, 0.476, -0.140, 0.113], [0.163, 0.817, 0.541, 0.452], [0.069, -0.173, -0.148, -0.028]
thumb = [1.394, 0.080, 0.568, 0.589]

turned, shifted = np.eye(4), np.eye(4)
turned[:3, :3] = Rotation.from_euler("z", 45, degrees=True).as_matrix()
shifted[:3, 3] = [0.0, 0.030, 0.0]
poses = np.stack([grasp, turned @ grasp, shifted @ grasp])

candidates = seqgrasp.candidates_of(
    prepared, "pinch", poses, [index + middle + ring + thumb] * 3, parameters, hand=hand
)
candidates["rejected_by"] = ""  # whatever the energy filter says, ask physics
scored = seqgrasp.validate(candidates, prepared, parameters, hand=hand)
scored.insert(0, "grasp", ["as found", "turned by 45 degrees", "shifted by 30 mm"])
scored["outcome"] = [f"fails {check}" if check else "holds" for check in scored["rejected_by"]]
print(scored[["grasp", "fingers", "energy", "energy_distance", "outcome"]].round(4).to_string(index=False))
