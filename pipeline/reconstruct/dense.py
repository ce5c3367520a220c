"""The surface of every object of a scene from metric views, by plane sweep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.compute.fan_out import Workers, fan_out
from pipeline.reconstruct.fusion import Points, fuse, thinned
from pipeline.reconstruct.movement import check_at_rest
from pipeline.reconstruct.plane_sweep import (
    SECOND_ANGLE,
    DepthMap,
    Window,
    follow,
    neighbours,
    sweep,
    window_of,
)
from pipeline.reconstruct.silhouettes import Bound, bound_of
from pipeline.reconstruct.surface import Surface, belongs_to, poisson_surface
from pipeline.reconstruct.views import View
from pipeline.reconstruct.visibility import Bodies
from pipeline.records.captures import Scene
from pipeline.records.errors import UserError
from pipeline.records.parameters.reconstruct import SurfaceParameters, SweepParameters

LEAST_VIEWS = 3
OUTSIDE = 0.0015  # m, by which a point may be measured outside of what photos leave for its object
TURNS = 3  # one sweep of planes, then along the surface of the turn before


@dataclass(frozen=True)
class DenseObject:
    """What was measured of one object."""

    points: Points
    surface: Surface
    windows: dict[int, Window]  # per view that shows the object
    maps: tuple[DepthMap, ...] = ()  # what every view measured of it, last


@dataclass(frozen=True)
class _Task:
    """One window of one view; ``views`` holds the view first, then its neighbours."""

    views: tuple[View, ...]
    window: Window
    nearest: float
    farthest: float
    surfaces: tuple[Surface, ...]  # of all objects, as found so far; empty at first
    own: int  # which of them is looked for
    settings: SweepParameters
    shown: tuple[int, ...]  # the numbers of ``views`` among all
    support: float  # z, m


def _depths(task: _Task) -> DepthMap:
    cv2.setNumThreads(1)
    others = range(1, len(task.views))
    if not task.surfaces:
        found = sweep(task.views, 0, others, task.window, task.nearest, task.farthest, task.settings, task.support)
    else:
        view = task.views[0]
        pixels = np.concatenate([task.window.centres(), np.ones((task.window.width * task.window.height, 1))], axis=1)
        rays = pixels @ np.linalg.inv(view.K).T @ view.T_camera_scene[:3, :3]  # z = 1 in the camera: lengths are depths
        bodies, shape = Bodies(task.surfaces), (task.window.height, task.window.width)
        base, normals = bodies.depth(task.own, view.centre, rays, SECOND_ANGLE)
        points = view.centre + rays * base[:, None]
        visible = [bodies.seen_from(task.views[other].centre, points, normals).reshape(shape) for other in others]
        found = follow(
            task.views, 0, others, task.window, base.reshape(shape), np.array(visible), task.settings, task.support
        )
    likeness = tuple((task.shown[other], value) for other, value in found.likeness)
    return DepthMap(task.shown[0], found.window, found.depth, found.score, likeness, found.support)


def _tasks(views: Sequence[View], scene: Scene, name: str, sweeping: SweepParameters, margin: float) -> list[_Task]:
    own, item = list(scene.objects).index(name), scene.objects[name]
    corners = item.corners(scene.support_plane, margin)
    windows = {index: window_of(view, corners, sweeping.window) for index, view in enumerate(views)}
    visible = [index for index, window in windows.items() if window is not None]
    tasks = []
    for index in visible:
        others = neighbours(views, index, corners.mean(axis=0), visible, sweeping)
        window = windows[index]
        if others and window is not None:
            shown = (index, *others)
            seen = tuple(views[number] for number in shown)
            tasks.append(_Task(seen, *window, (), own, sweeping, shown, scene.support_plane))
    if len(tasks) < LEAST_VIEWS:
        raise UserError(
            f"{name}: only {len(tasks)} photos show its box; correct its position in scene.yaml, or take photos of it."
        )
    return tasks


def _own(points: Points, scene: Scene, number: int, settings: SurfaceParameters, bound: Bound | None) -> Points:
    mine = belongs_to(points.positions, scene, settings) == number
    if bound is not None:
        mine &= bound.distance(points.positions) < OUTSIDE
    return replace(points, positions=points.positions[mine], towards=points.towards[mine])


def dense_objects(
    views: Sequence[View],
    scene: Scene,
    sweeping: SweepParameters,
    settings: SurfaceParameters,
    workers: Workers,
) -> dict[str, DenseObject]:
    """Return per object what was measured of it, and its closed surface.

    Raises:
        UserError: an object is not in the photos, has no texture, or was moved between them.
    """
    found: dict[str, DenseObject] = {}
    plainly: dict[str, list[DepthMap]] = {}
    tasks = {name: _tasks(views, scene, name, sweeping, settings.margin) for name in scene.objects}
    bounds = {name: bound_of(views, item, scene.support_plane, settings.margin) for name, item in scene.objects.items()}
    for turn in range(TURNS):
        if turn:
            surfaces = tuple(found[name].surface for name in tasks)
            tasks = {name: [replace(task, surfaces=surfaces) for task in own] for name, own in tasks.items()}
        label = "depths along the surfaces" if turn else "depths by plane sweep"
        maps = iter(fan_out(_depths, [task for own in tasks.values() for task in own], workers, label))
        for number, (name, own) in enumerate(tasks.items()):
            mine = [next(maps) for _ in own]
            if not turn:
                plainly[name] = mine
            fused = fuse(views, mine, sweeping, plainly[name], scene.support_plane)
            points = thinned(_own(fused, scene, number, settings, bounds[name]), sweeping.voxel)
            check_at_rest(name, points.contradictions, mine, [view.name for view in views])
            # A surface to follow need not show the last detail, but must be smooth.
            rougher = settings.model_copy(update={"poisson_depth": settings.poisson_depth - (turn < TURNS - 1)})
            surface = poisson_surface(points, scene.support_plane, sweeping.voxel, rougher, name, bounds[name])
            found[name] = DenseObject(points, surface, {task.shown[0]: task.window for task in own}, tuple(mine))
    return found
