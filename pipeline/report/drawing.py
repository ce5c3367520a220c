"""Pictures and geometry for the page: merged grasps in the hand frame, trials in the world of the evaluation."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from PIL import Image

from pipeline.compute.fan_out import fan_out
from pipeline.hand.model import Hand
from pipeline.pictures.camera import framing
from pipeline.pictures.colours import OBJECT_COLOURS, hexadecimal
from pipeline.pictures.decimation import Mesh, decimated
from pipeline.pictures.render import Body, corner_normals, render
from pipeline.pictures.robot import hand_bodies
from pipeline.pictures.table_scene import moment_picture
from pipeline.records.flat import read_flat
from pipeline.records.opening_film import OpeningFilm
from pipeline.records.parameters.evaluate import EvaluateParameters
from pipeline.records.parameters.report import ReportParameters
from pipeline.records.poses import pose_matrix
from pipeline.report.chosen_trials import choose_trials, chosen_moments
from pipeline.report.counting import SYNTHESIZED, grasps_of, trials_of
from pipeline.report.embedding import FoldedTable
from pipeline.report.figure_files import contact_sheet
from pipeline.report.objects import read_mesh
from pipeline.report.pair_views import PairView, Strip
from pipeline.report.scene import (
    GRASPS_PER_PAIR,
    MOST_FACES,
    MOST_LINK_FACES,
    grasp_record,
    grasp_row,
    object_pose,
    shape_record,
    shown_grasps,
)
from pipeline.report.trial_rows import replay_command, trials_table
from pipeline.report.wording import SOURCE_TITLES

GRASP_AZIMUTH, GRASP_ELEVATION = 29.0, 13.0  # degrees; as the first view in ``viewer.js``
# Of pictures in the page, which all ride in one file: twice the width at which a strip shows them. The files under
# reports/figures keep the size that params.yaml asks for.
PAGE_WIDTH = 320  # pixels
WEBP_QUALITY = 60
HAND_LIGHTENING = 0.3  # the interactive view has no fill light: dark links would be black


@dataclass(frozen=True)
class Look:
    """How much is drawn of a pair, and how finely."""

    width: int  # pixels, of pictures of trials
    height: int
    moments: int  # most per trial
    grasps: int = GRASPS_PER_PAIR  # most merged grasps to turn
    poster: int = 400  # pixels, edge of the picture of the first one
    fine: bool = True  # objects in pictures have all their faces; otherwise those of the interactive view


@dataclass(frozen=True)
class Request:
    """What is to be drawn and listed of one pair."""

    first: str
    second: str
    strips: tuple[tuple[str, bool], ...]  # source, and whether a trial that failed is wanted
    listed: tuple[str, ...]  # sources whose trials are listed
    look: Look
    evaluate: EvaluateParameters


@dataclass(frozen=True)
class PairTask:
    """A request with what it needs."""

    request: Request
    hand: Hand
    meshes: tuple[Mesh, Mesh]
    merged: pd.DataFrame  # of all pairs that begin with the first object, likewise the next
    trials: Mapping[str, pd.DataFrame]  # per source


@dataclass(frozen=True)
class Drawn:
    """What is shown of a pair."""

    view: PairView
    shapes: dict[str, dict[str, list[int]]]  # of its objects, see ``scene.shape_record``
    tables: dict[str, FoldedTable]  # trials per source


def full_look(settings: ReportParameters) -> Look:
    """Return how a pair is shown where there are few."""
    return Look(settings.picture_width, settings.picture_height, settings.pictures_per_trial)


def small_look(settings: ReportParameters) -> Look:
    """Return how a pair is shown among many: fewer and smaller pictures, as their cost grows with the pixels."""
    width = min(settings.picture_width, 180)
    height = round(settings.picture_height * width / settings.picture_width)
    return Look(width, height, min(settings.pictures_per_trial, 3), grasps=3, poster=160, fine=False)


def draw_pairs(requests: Sequence[Request], hand: Hand, workers: int) -> list[Drawn]:
    """Return what is shown of every pair.

    Args:
        workers: processes to draw with; see ``compute.fan_out``.

    Raises:
        UserError: a table or a prepared object is missing or damaged.
    """
    return fan_out(partial(read_and_draw, hand), requests, workers, "pictures of pairs")


def read_and_draw(hand: Hand, request: Request) -> Drawn:
    """Read what a request needs and draw it; a run of many pairs does not fit into memory at once."""
    sources = dict.fromkeys([*request.listed, *(source for source, _ in request.strips)])
    merged = read_flat(*grasps_of(SYNTHESIZED, request.first)) if SYNTHESIZED in request.listed else pd.DataFrame()
    trials = {source: read_flat(*trials_of(source, request.first)) for source in sources}
    return draw_pair(PairTask(request, hand, (read_mesh(request.first), read_mesh(request.second)), merged, trials))


def draw_pair(task: PairTask) -> Drawn:
    """Return what is shown of one pair: some merged grasps, the trials that the request names, and lists of trials."""
    request, hand, pair = task.request, task.hand, (task.request.first, task.request.second)
    chosen = {source: choose_trials(*pair, task.trials[source]) for source, _ in request.strips}
    wanted = [chosen[source].failure if failed else chosen[source].success for source, failed in request.strips]
    shown = [row for row in wanted if row is not None]
    used = [int(row["merged_id"]) for row in shown if row["source"] == SYNTHESIZED]
    grasps = []
    if request.look.grasps and len(task.merged):
        own = task.merged[task.merged["object1"] == request.second]
        grasps = shown_grasps(own, used, request.look.grasps).to_dict("records")
    shapes = [decimated(mesh, MOST_FACES) for mesh in task.meshes] if grasps or not request.look.fine else []
    bodies = _bodies(task.meshes if request.look.fine else shapes) if grasps or shown else []
    view = PairView(
        first=request.first,
        second=request.second,
        grasps=[grasp_record(grasp, _placed_links(np.asarray(grasp["q"]), hand)) for grasp in grasps],
        rows=[grasp_row(grasp) for grasp in grasps],
        poster=grasp_poster(grasps[0], bodies, hand, request.look.poster) if grasps else None,
        strips=[trial_strip(row, bodies, hand, request.look, request.evaluate) for row in shown],
    )
    records = {f"object/{name}": shape_record(shape) for name, shape in zip(pair, shapes, strict=False) if grasps}
    return Drawn(view, records, {source: trials_table(source, *pair, task.trials[source]) for source in request.listed})


def opening_view(drawn: Iterable[Drawn], film: OpeningFilm | None) -> PairView | None:
    """Return the pictures of the filmed trial, as all that is shown of its pair; None where nothing was filmed."""
    for one in drawn:
        for strip in one.view.strips:
            shown = (strip.source, (one.view.first, one.view.second), strip.trial)
            if film is not None and shown == (film.source, film.objects, film.trial):
                return PairView(one.view.first, one.view.second, grasps=[], rows=[], poster=None, strips=[strip])
    return None


def all_shapes(drawn: Iterable[Drawn], hand: Hand) -> dict[str, dict[str, list[int]]]:
    """Return the shapes that the interactive grasps of all pairs place, those of the hand among them."""
    shapes = dict(sorted((name, shape) for one in drawn for name, shape in one.shapes.items()))
    return shapes | _link_shapes(hand) if shapes else {}


@lru_cache(maxsize=1)
def _link_shapes(hand: Hand) -> dict[str, dict[str, list[int]]]:
    links = hand_bodies(np.eye(4), np.zeros(hand.joint_count), hand)
    return {
        f"hand/{index:02d}": shape_record(decimated((body.vertices, body.faces), MOST_LINK_FACES))
        for index, body in enumerate(links)
    }


def _placed_links(q: NDArray[np.float64], hand: Hand) -> list[tuple[str, NDArray[np.float64], str]]:
    """Return shape, pose in the hand frame and colour of every part of the hand at ``q`` (J,)."""
    bodies = hand_bodies(np.eye(4), q, hand)
    lighter = [1 - (1 - HAND_LIGHTENING) * (1 - np.asarray(body.colour)) for body in bodies]
    return [
        (f"hand/{index:02d}", body.T_world, hexadecimal(colour))
        for index, (body, colour) in enumerate(zip(bodies, lighter, strict=True))
    ]


def _bodies(meshes: Sequence[Mesh]) -> list[Body]:
    """Return both objects of a pair in their own frames."""
    return [
        Body(*mesh, colour, normals=corner_normals(*mesh)) for mesh, colour in zip(meshes, OBJECT_COLOURS, strict=False)
    ]


def _placed(objects: Sequence[Body], poses: Sequence[NDArray[np.float64]]) -> list[Body]:
    return [body.placed(T) for body, T in zip(objects, poses, strict=True)]


def grasp_poster(grasp: Mapping[str, Any], objects: Sequence[Body], hand: Hand, size: int) -> bytes:
    """Return a square WebP of a merged grasp (a row of a merged table), seen as in the interactive view.

    Args:
        size: pixels of its edge.
    """
    bodies = hand_bodies(np.eye(4), np.asarray(grasp["q"]), hand)
    bodies += _placed(objects, [object_pose(grasp, index) for index in (0, 1)])
    points = np.concatenate([body.world_vertices() for body in bodies])
    camera = framing(points, GRASP_AZIMUTH, GRASP_ELEVATION, aspect=1.0)
    return as_webp(render(bodies, camera, size, size))


def trial_strip(
    trial: Mapping[str, Any],
    objects: Sequence[Body],
    hand: Hand,
    look: Look,
    evaluate: EvaluateParameters,
) -> Strip:
    """Return pictures of one trial (a row of a trials table) from its remembered moments."""
    phases = [str(phase) for phase in trial["snapshot_phases"]]
    moments = chosen_moments(phases, look.moments)
    pictures = []
    for moment in moments:
        world = np.asarray([trial["snapshot_pose0"][moment], trial["snapshot_pose1"][moment]], dtype=np.float64)
        robot_q = np.asarray(trial["snapshot_robot_q"][moment], dtype=np.float64)
        bodies = _placed(objects, list(pose_matrix(world[:, :3], world[:, 3:])))
        pictures.append(moment_picture(robot_q, hand, bodies, evaluate.sponge_height, look.width, look.height))
    success = bool(trial["success"])
    outcome = "success" if success else f"failed: {trial['reason']}"
    return Strip(
        title=f"Trial {trial['trial']}, {SOURCE_TITLES[trial['source']]}, {outcome}",
        source=str(trial["source"]),
        trial=int(trial["trial"]),
        shape=(look.width, look.height),
        replay=replay_command(trial["source"], (trial["object0"], trial["object1"]), trial["trial"]),
        captions=(captions := [phases[moment] for moment in moments]),
        pictures=[as_webp(picture) for picture in pictures],
        sheet=contact_sheet(pictures, captions),
        failed=not success,
    )


def as_webp(picture: NDArray[np.uint8]) -> bytes:
    """Return a picture (h, w, 3) as WebP, at most ``PAGE_WIDTH`` wide."""
    image = Image.fromarray(picture)
    if image.width > PAGE_WIDTH:
        height = round(image.height * PAGE_WIDTH / image.width)
        image = image.resize((PAGE_WIDTH, height), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    image.save(buffer, format="WEBP", quality=WEBP_QUALITY, method=4)
    return buffer.getvalue()
