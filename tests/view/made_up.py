"""A made-up box as a prepared object, and a project of small tables."""

import shutil
from pathlib import Path

import numpy as np
import trimesh
import yaml

from pipeline.records.objects import PreparedObject
from tests.objects import prepared


def box(name: str, extents: tuple[float, float, float]) -> PreparedObject:
    """A box whose two halves along x are its convex parts."""
    x, y, z = extents
    halves = [trimesh.creation.box((x / 2, y, z)).apply_translation((side * x / 4, 0, 0)) for side in (-1, 1)]
    parts = tuple((np.asarray(half.vertices), np.asarray(half.faces, np.int64)) for half in halves)
    return prepared(name, trimesh.creation.box(extents), parts=parts, provenance={"licence": "CC0"})


def write_parameters(repository: Path, folder: Path) -> None:
    """A params.yaml with one pair, one capture and one condition."""
    shutil.copy(repository / "params.yaml", folder)
    values = yaml.safe_load((folder / "params.yaml").read_text())
    values["styles"] = {"pinch": ["cube"], "side": ["soup_can"]}
    values["objects"] = {name: values["objects"][name] for name in ("cube", "soup_can")}
    demo = values["renderings"]["demo"]
    demo["objects"] = {name: demo["objects"][name] for name in ("cube", "soup_can")}
    values["reconstructed"] = {"cube": {"capture": "demo", "side": ["soup_can"]}}
    conditions = values["conditions"]
    conditions |= {"pairs": [["cube", "soup_can"]], "settings": {"low": {"evaluate": {"sponge_height": 0.07}}}}
    (folder / "params.yaml").write_text(yaml.safe_dump(values))
