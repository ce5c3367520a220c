"""The picture of a choice: what the library reads of its rows, drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.pictures.decimation import Mesh
from pipeline.records import paths
from pipeline.records.poses import inverse_pose, transform_points
from pipeline.view import scenes
from pipeline.view.choice import Choice
from pipeline.view.drawing import Drawing
from pipeline.view.library import Library
from pipeline.view.tables import MERGED_VIEW, OBJECTS, RECONSTRUCTIONS, TRIALS_VIEW, sponge_height


@dataclass(frozen=True)
class Style:
    """How grasps are drawn."""

    colours: NDArray[np.float64] | None  # (n, 3) of the hands, None: their own
    joints: str  # the posture, a column
    layers: scenes.Layers


def picture(
    library: Library, choice: Choice, lines: Sequence[pd.Series], full: Sequence[Mapping[str, Any]], style: Style
) -> Drawing:
    """Draw rows of a view.

    Args:
        lines: of the index.
        full: the rows behind them.

    Raises:
        UserError: a file that a row needs is missing or damaged.
    """
    if choice.view == OBJECTS:
        return scenes.objects_in_parts([library.prepared(line["first"]) for line in lines])
    if choice.view == RECONSTRUCTIONS:
        return scenes.reconstructions([_photographed(library, line["source"], line["first"]) for line in lines])
    if choice.view == TRIALS_VIEW:
        first, second = (library.prepared(lines[0][column]) for column in ("first", "second"))
        height = sponge_height(library.parameters, lines[0]["source"])
        return scenes.trial_moment(full[0], (first, second), library.hand, height, choice.moment)
    if choice.view == MERGED_VIEW:
        return _merged(library, choice, lines, full, style)
    objects = {name: library.prepared(name) for name in {line["first"] for line in lines}}
    return scenes.grasps_on_objects(
        full, objects, style.colours, library.hand, choice.arrangement, style.joints, style.layers
    )


def _merged(
    library: Library, choice: Choice, lines: Sequence[pd.Series], full: Sequence[Mapping[str, Any]], style: Style
) -> Drawing:
    """Grasps of reconstructed objects are drawn on the surfaces in whose frames they are given."""
    meshes: dict[str, Mesh] = {}
    renamed = []
    for line, row in zip(lines, full, strict=True):
        own = dict(row)
        for slot, column in enumerate(("first", "second")):
            name = line[column]
            if line["source"] == paths.RECONSTRUCTED:
                capture = library.parameters.reconstructed[line["first"]].capture
                item = library.reconstructed(capture, name)
                name = f"{name} of {capture}"
                meshes[name] = (item.vertices, item.faces)
            else:
                prepared = library.prepared(name)
                meshes[name] = (prepared.vertices, prepared.faces)
            own[f"object{slot}"] = name
        renamed.append(own)
    return scenes.merged_grasps(
        renamed, meshes, style.colours, library.hand, choice.arrangement, style.joints, style.layers
    )


def _photographed(library: Library, capture: str, name: str) -> Any:
    item, truth = library.reconstructed(capture, name), library.truth(capture, name)
    if truth is None:
        return item, None, None
    there = transform_points(inverse_pose(item.T_scene_object), truth[0])
    return item, truth, scenes.distance_to_mesh(item.points, (there, truth[1]))
