"""What one depth camera sees of an object on a table: rendered, with noise and edges of a real sensor, and cleaned.

The camera is an Intel RealSense D435: 848 x 480 pixels, 69 degrees wide, 50 mm between its two eyes (data sheet). It
stands 0.8 m from where it looks, and 30 to 60 degrees over the table. Table frame: z up, the table at z = 0, the object
over the origin, turned by a random angle about the vertical, and the camera over the positive x axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.poses import inverse_pose, transform_points

WIDTH, HEIGHT = 848, 480
FOCAL = WIDTH / 2 / np.tan(np.radians(69 / 2))  # pixels
BASELINE = 0.050  # m
SUBPIXEL = 0.08  # pixels, error of disparity on textured surfaces (Intel, tuning guide of the D400 series)
DISTANCE, AIM = 0.8, 0.05  # m, of the camera from where it looks, and the height of that place over the table
ELEVATIONS = (30.0, 60.0)  # degrees over the table
GRAZING = np.cos(np.radians(80))  # surfaces seen at a flatter angle than 80 degrees give no depth
EDGE = 0.01  # m between neighbouring pixels: an edge, where pixels may fly, and beyond which nothing is averaged
FLYING = 0.5  # share of the pixels at an edge whose depth lies anywhere between both sides
TABLE = 0.006  # m; what is lower is taken for the table
REACH = 2  # pixels around each that are averaged
SUPPORT = 9  # of the 25 pixels there; with fewer on the same surface a pixel is taken for a flying one
LEAST_POINTS = 64


@dataclass(frozen=True)
class View:
    """What one camera sees of an object."""

    points: NDArray[np.float64]  # (n, 3) table frame, m, without table, noise averaged
    depth: NDArray[np.float64]  # (HEIGHT, WIDTH) m, as measured; NaN where nothing is
    T_table_camera: NDArray[np.float64]  # (4, 4); the camera looks along its z, its y points down
    T_table_object: NDArray[np.float64]  # (4, 4), the truth, which whoever uses the view does not know


def depth_noise(depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard deviation of measured depths, m: depth^2 subpixel / (focal length x baseline)."""
    return depth**2 * SUBPIXEL / (FOCAL * BASELINE)


def camera_pose(elevation: float) -> NDArray[np.float64]:
    """Return ``T_table_camera`` (4, 4) of a camera so many rad over the table."""
    backward = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    right = np.array([0.0, 1.0, 0.0])
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2] = right, np.cross(-backward, right), -backward
    T[:3, 3] = DISTANCE * backward + [0, 0, AIM]
    return T


def directions(rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return rays (n, 3) through the middles of pixels, camera frame, of depth 1."""
    x, y = (columns + 0.5 - WIDTH / 2) / FOCAL, (rows + 0.5 - HEIGHT / 2) / FOCAL
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def pixels(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return rows and columns (n, 2) of the pixels that points (n, 3), camera frame, are seen in."""
    across = points[:, 1::-1] / points[:, 2:] * FOCAL + np.array([HEIGHT, WIDTH]) / 2
    return np.floor(across).astype(np.int64)


def view_of(prepared: PreparedObject, rng: np.random.Generator) -> View:
    """Return what a camera at a random place sees of an object; the same generator gives the same view.

    Raises:
        UserError: the object leaves the picture, or too little of it is seen.
    """
    T_table_camera = camera_pose(np.radians(rng.uniform(*ELEVATIONS)))
    yaw = rng.uniform(0, 2 * np.pi)
    noise, chance = rng.standard_normal((HEIGHT, WIDTH)), rng.random((HEIGHT, WIDTH))
    T_table_object = np.eye(4)
    T_table_object[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T_table_object[2, 3] = -prepared.bottom
    placed = transform_points(T_table_object, prepared.vertices)

    outline = pixels(transform_points(inverse_pose(T_table_camera), placed))
    low, high = outline.min(axis=0) - 2 * REACH, outline.max(axis=0) + 2 * REACH + 1
    if (low < 0).any() or (high > (HEIGHT, WIDTH)).any():
        raise UserError(
            f"{prepared.name} does not fit into one camera's picture from {DISTANCE} m; set train.data.view: whole, or "
            "leave the object out."
        )
    window = (slice(low[0], high[0]), slice(low[1], high[1]))
    ideal, grazing = _ideal_depth(placed, prepared.faces, T_table_camera, window)
    measured = _measured_depth(ideal, noise[window], chance[window])
    measured[grazing] = np.nan
    depth = np.full((HEIGHT, WIDTH), np.nan)
    depth[window] = measured
    points = _cleaned(depth, window, T_table_camera)
    if len(points) < LEAST_POINTS:
        raise UserError(
            f"one camera sees {len(points)} points of {prepared.name}, at least {LEAST_POINTS} are needed; set "
            "train.data.view: whole, or leave the object out."
        )
    return View(points, depth, T_table_camera, T_table_object)


def _rays(window: tuple[slice, slice]) -> NDArray[np.float64]:
    rows, columns = np.meshgrid(np.arange(window[0].start, window[0].stop),
                                np.arange(window[1].start, window[1].stop), indexing="ij")  # fmt: skip
    return directions(rows, columns)


def _ideal_depth(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], T_table_camera: NDArray[np.float64],
    window: tuple[slice, slice],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:  # fmt: skip
    """Return true depths (h, w) of object and table, and where the object is seen at too flat an angle."""
    from pipeline.shapes.rays import ray_scene

    rays = _rays(window) @ T_table_camera[:3, :3].T
    origin = T_table_camera[:3, 3]
    query = np.concatenate([np.broadcast_to(origin, rays.shape), rays], axis=-1).astype(np.float32)
    hits = ray_scene((vertices, faces)).cast_rays(query, nthreads=1)
    depth = hits["t_hit"].numpy().astype(np.float64)
    seen = np.isfinite(depth)
    normals = hits["primitive_normals"].numpy().astype(np.float64)
    cosine = np.abs((normals * rays).sum(axis=-1)) / np.linalg.norm(rays, axis=-1)
    return np.where(seen, depth, -origin[2] / rays[..., 2]), seen & (cosine < GRAZING)


def _measured_depth(
    ideal: NDArray[np.float64], noise: NDArray[np.float64], chance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return depths (h, w) as a sensor measures them, of normal noise and chances of 0 to 1 for every pixel."""
    padded = np.pad(ideal, 1, mode="edge")
    around = np.stack([padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1]]) - ideal
    step = np.take_along_axis(around, np.abs(around).argmax(axis=0)[None], axis=0)[0]
    flies = (np.abs(step) > EDGE) & (chance < FLYING)
    depth = ideal + np.where(flies, chance / FLYING * step, 0.0)
    return np.asarray(depth + noise * depth_noise(depth))


def _cleaned(
    depth: NDArray[np.float64], window: tuple[slice, slice], T_table_camera: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the object's points (n, 3), table frame, each the mean of its neighbours on the same surface."""
    measured = depth[window]
    points = transform_points(T_table_camera, _rays(window) * measured[..., None])
    own = np.isfinite(measured) & (np.nan_to_num(points[..., 2]) > TABLE)
    held = np.pad(np.where(own, measured, np.inf), REACH, constant_values=np.inf)
    spread = np.pad(np.where(own[..., None], points, 0.0), ((REACH, REACH), (REACH, REACH), (0, 0)))
    total, count = np.zeros(points.shape), np.zeros(own.shape)
    height, width = own.shape
    for row in range(2 * REACH + 1):
        for column in range(2 * REACH + 1):
            part = (slice(row, row + height), slice(column, column + width))
            same = own & (np.abs(held[part] - np.where(own, measured, 0.0)) < EDGE)
            total += np.where(same[..., None], spread[part], 0.0)
            count += same
    kept = own & (count >= SUPPORT)
    return total[kept] / count[kept][:, None]
