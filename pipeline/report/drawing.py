"""Pictures and geometry for the page: merged grasps in the hand frame, trials in the world of the evaluation."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.compute.fan_out import fan_out
from pipeline.pictures.camera import framing
from pipeline.pictures.decimation import decimated
from pipeline.pictures.render import Body, render
from pipeline.pictures.robot import hand_bodies
from pipeline.pictures.table_scene import moment_picture
from pipeline.records.objects import PreparedObject, load_prepared_object
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.report import ReportParameters
from pipeline.records.poses import pose_matrix
from pipeline.report.chosen_trials import choose_trials, chosen_moments
from pipeline.report.figure_files import contact_sheet
from pipeline.report.page import SOURCE_TITLES, PairView, Strip
from pipeline.report.scene import (
    MOST_FACES,
    MOST_LINK_FACES,
    OBJECT_COLOURS,
    fractions,
    grasp_record,
    grasp_row,
    hexadecimal,
    object_pose,
    shape_record,
    shown_grasps,
)
from pipeline.report.tables import Tables
from pipeline.report.trial_rows import replay_command

GRASP_AZIMUTH, GRASP_ELEVATION = 29.0, 13.0  # degrees; as the first view in ``viewer.js``
POSTER_SIZE = (400, 400)  # pixels
# Of pictures in the page, which all ride in one file: twice the width at which a strip shows them. The files under
# reports/figures keep the size that params.yaml asks for.
PAGE_WIDTH = 320  # pixels
WEBP_QUALITY = 60
HAND_LIGHTENING = 0.3  # the interactive view has no fill light: dark links would be black


@dataclass(frozen=True)
class PairTask:
    """What is to be drawn of one pair."""

    names: tuple[str, str]
    objects: tuple[PreparedObject, PreparedObject]
    merged: pd.DataFrame
    trials: dict[str, pd.DataFrame]  # per source, all pairs that begin with the first object
    settings: ReportParameters
    evaluate: EvaluateParameters


def draw_views(
    tables: Tables,
    objects: Mapping[str, PreparedObject],
    settings: ReportParameters,
    evaluate: EvaluateParameters,
    workers: int,
) -> tuple[list[PairView], dict[str, dict[str, list[int]]]]:
    """Return what is shown of every pair, and the shapes that its interactive grasps place.

    Args:
        objects: every object of the tables.
        workers: processes to draw with; see ``compute.fan_out``.
    """
    tasks = [
        PairTask(
            names=(first, second),
            objects=(objects[first], objects[second]),
            merged=merged,
            trials={source: own for (source, name), own in tables.trials.items() if name == first},
            settings=settings,
            evaluate=evaluate,
        )
        for (first, second), merged in tables.merged.items()
    ]
    views = fan_out(draw_view, tasks, workers, "pictures of pairs")
    used = {name for view in views if view.grasps for name in (view.first, view.second)}
    shapes = {f"object/{name}": shape_record(decimated(_mesh(objects[name]), MOST_FACES)) for name in sorted(used)}
    return views, (shapes | _link_shapes() if used else {})


def draw_view(task: PairTask) -> PairView:
    """Return what is shown of one pair: some merged grasps, and a successful and a failed trial of every source."""
    chosen = {source: choose_trials(*task.names, trials) for source, trials in task.trials.items()}
    shown = [row for choice in chosen.values() for row in (choice.success, choice.failure) if row is not None]
    used = [int(row["merged_id"]) for row in shown if row["source"] == "synthesized"]
    grasps = shown_grasps(task.merged, used).to_dict("records")
    return PairView(
        first=task.names[0],
        second=task.names[1],
        grasps=[grasp_record(grasp, _placed_links(np.asarray(grasp["q"]))) for grasp in grasps],
        rows=[grasp_row(grasp) for grasp in grasps],
        poster=grasp_poster(grasps[0], task.objects) if grasps else None,
        strips=[trial_strip(row, task.objects, task.settings, task.evaluate) for row in shown],
    )


def load_objects(tables: Tables) -> dict[str, PreparedObject]:
    """Load every object that the tables name.

    Raises:
        UserError: a prepared object is missing or damaged.
    """
    return {name: load_prepared_object(name) for name in sorted({name for pair in tables.merged for name in pair})}


def _mesh(prepared: PreparedObject) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    return prepared.vertices, prepared.faces


@lru_cache(maxsize=1)
def _link_shapes() -> dict[str, dict[str, list[int]]]:
    links = hand_bodies(np.eye(4), np.zeros(16))
    return {
        f"hand/{index:02d}": shape_record(decimated((body.vertices, body.faces), MOST_LINK_FACES))
        for index, body in enumerate(links)
    }


def _placed_links(q: NDArray[np.float64]) -> list[tuple[str, NDArray[np.float64], str]]:
    """Return shape, pose in the hand frame and colour of every part of the hand at ``q`` (16,)."""
    lighter = [1 - (1 - HAND_LIGHTENING) * (1 - np.asarray(body.colour)) for body in hand_bodies(np.eye(4), q)]
    return [
        (f"hand/{index:02d}", body.T_world, hexadecimal(colour))
        for index, (body, colour) in enumerate(zip(hand_bodies(np.eye(4), q), lighter, strict=True))
    ]


def _object_bodies(pair: Sequence[PreparedObject], poses: Sequence[NDArray[np.float64]]) -> list[Body]:
    return [
        Body(prepared.vertices, prepared.faces, fractions(colour), T)
        for prepared, colour, T in zip(pair, OBJECT_COLOURS, poses, strict=True)
    ]


def grasp_poster(grasp: Mapping[str, Any], pair: Sequence[PreparedObject]) -> bytes:
    """Return a WebP of a merged grasp (a row of a merged table), seen as in the interactive view."""
    bodies = hand_bodies(np.eye(4), np.asarray(grasp["q"]))
    bodies += _object_bodies(pair, [object_pose(grasp, index) for index in (0, 1)])
    points = np.concatenate([body.world_vertices() for body in bodies])
    width, height = POSTER_SIZE
    camera = framing(points, GRASP_AZIMUTH, GRASP_ELEVATION, aspect=width / height)
    return as_webp(render(bodies, camera, width, height))


def trial_strip(
    trial: Mapping[str, Any],
    pair: Sequence[PreparedObject],
    settings: ReportParameters,
    evaluate: EvaluateParameters,
) -> Strip:
    """Return pictures of one trial (a row of a trials table) from its remembered moments."""
    phases = [str(phase) for phase in trial["snapshot_phases"]]
    moments = chosen_moments(phases, settings.pictures_per_trial)
    pictures = []
    for moment in moments:
        world = np.asarray([trial["snapshot_pose0"][moment], trial["snapshot_pose1"][moment]], dtype=np.float64)
        robot_q = np.asarray(trial["snapshot_robot_q"][moment], dtype=np.float64)
        bodies = _object_bodies(pair, list(pose_matrix(world[:, :3], world[:, 3:])))
        size = settings.picture_width, settings.picture_height
        pictures.append(moment_picture(robot_q, bodies, evaluate.sponge_height, *size))
    success = bool(trial["success"])
    outcome = "success" if success else f"failed: {trial['reason']}"
    return Strip(
        title=f"Trial {trial['trial']}, {SOURCE_TITLES[trial['source']]}, {outcome}",
        source=str(trial["source"]),
        trial=int(trial["trial"]),
        shape=(settings.picture_width, settings.picture_height),
        replay=replay_command(trial["source"], trial["object0"], trial["object1"], trial["trial"]),
        captions=(captions := [phases[moment] for moment in moments]),
        pictures=[as_webp(picture) for picture in pictures],
        sheet=contact_sheet(pictures, captions),
        failed=not success,
    )


def as_webp(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture (h, w, 3) as WebP, at most ``PAGE_WIDTH`` wide."""
    from PIL import Image

    image = Image.fromarray(picture)
    if image.width > PAGE_WIDTH:
        height = round(image.height * PAGE_WIDTH / image.width)
        image = image.resize((PAGE_WIDTH, height), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    image.save(buffer, format="WEBP", quality=WEBP_QUALITY, method=4)
    return buffer.getvalue()
