"""Objects that no file describes: a family of prisms, made in Python, and which of them a hand can pinch.

python examples/07_another_source_of_objects.py
"""

from collections.abc import Iterator

import numpy as np
import trimesh

import seqgrasp

parameters = seqgrasp.read_parameters()
hand = seqgrasp.load_hand("allegro")


def prisms() -> Iterator[tuple[str, trimesh.Trimesh]]:
    """Yield names and meshes, m, of upright prisms with 3 to 6 corners and random sizes."""
    rng = np.random.default_rng(1)
    for corners in range(3, 7):
        angles = 2 * np.pi * np.arange(corners) / corners
        radius, height = rng.uniform(0.02, 0.03), rng.uniform(0.03, 0.06)
        ring = radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
        yield f"prism_{corners}", trimesh.convex.convex_hull(np.concatenate([ring, ring + [0, 0, height]]))


for name, mesh in prisms():
    try:
        prepared = seqgrasp.prepare_mesh(name, mesh.vertices, mesh.faces, parameters)
    except seqgrasp.UserError as error:
        print(f"{name}: {error}")
        continue
    candidates = seqgrasp.synthesize(prepared, "pinch", parameters, hand=hand, chains=6)
    size = " x ".join(f"{1000 * extent:.0f}" for extent in prepared.extents)
    passed = (candidates["rejected_by"] == "").sum()
    print(
        f"{name}: {size} mm, {1000 * prepared.mass:.0f} g, {passed} of {len(candidates)} chains pass the energy filter"
    )
