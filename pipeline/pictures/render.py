"""Ray-cast pictures of coloured bodies: smooth shading, a key light with a soft shadow, ambient light, a pale floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from pipeline.pictures.camera import Camera
from pipeline.shapes.rays import ray_scene

CREASE = np.cos(np.radians(40.0))  # neighbouring faces that meet at a sharper angle keep an edge
SKY = np.array([0.93, 0.95, 0.98], np.float32)  # linear light, as all colours inside this module
FLOOR = np.array([0.72, 0.73, 0.75], np.float32)
AMBIENT = 0.42
KEY = 0.78
GLOSS = 0.08  # of bodies
LIGHT_SPREAD = 0.07  # radius of the light, as a slope: the softness of shadows
LIGHT_TILE = 4  # pixels; every pixel of a tile looks at other points of the light
SUBSAMPLES = ((0.375, 0.125), (0.875, 0.375), (0.125, 0.625), (0.625, 0.875))  # rotated 2 x 2 grid
NO_HIT = 0xFFFFFFFF


@dataclass(frozen=True)
class Body:
    """A coloured mesh placed in the world."""

    vertices: NDArray[np.float64]  # (V, 3) in its own frame, m
    faces: NDArray[np.int64]  # (F, 3)
    colour: tuple[float, float, float]  # sRGB, 0 to 1
    T_world: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))  # (4, 4)
    normals: NDArray[np.float64] | None = None  # (F, 3, 3) per face corner, own frame; made here when absent

    def placed(self, T_world: NDArray[np.float64]) -> Body:
        """Return the same body at another pose."""
        return Body(self.vertices, self.faces, self.colour, T_world, self.normals)

    def world_vertices(self) -> NDArray[np.float64]:
        """Return the vertices (V, 3) in the world frame."""
        return self.vertices @ self.T_world[:3, :3].T + self.T_world[:3, 3]


def corner_normals(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return unit normals (F, 3, 3) per face corner, averaged over the faces around it that do not form an edge."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    area_normal = np.cross(b - a, c - a)
    unit = area_normal / np.maximum(np.linalg.norm(area_normal, axis=1, keepdims=True), 1e-30)
    place = np.unique(np.round(vertices, 7), axis=0, return_inverse=True)[1].reshape(-1)[faces].ravel()
    corner = np.arange(len(place))
    touches = coo_matrix((np.ones(len(place)), (corner, place))).tocsr()
    pairs = (touches @ touches.T).tocoo()  # corners that lie at the same place
    smooth = (unit[pairs.row // 3] * unit[pairs.col // 3]).sum(axis=1) > CREASE
    row, col = pairs.row[smooth], pairs.col[smooth] // 3
    total = np.stack([np.bincount(row, area_normal[col, axis], len(place)) for axis in range(3)], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    total = np.where(length > 0, total / np.maximum(length, 1e-30), unit[corner // 3])
    return total.reshape(-1, 3, 3)


@dataclass(frozen=True)
class _Scene:
    """What rays need to know of all bodies together."""

    rays: Any  # Open3D's RaycastingScene
    first_face: NDArray[np.int64]  # (bodies,) index of each body's first face in ``normals``
    normals: NDArray[np.float32]  # (all faces, 3, 3), world frame
    colours: NDArray[np.float32]  # (bodies, 3), linear


def _scene(bodies: Sequence[Body]) -> _Scene:
    normals, first = [np.zeros((0, 3, 3), np.float32)], []
    count = 0
    for body in bodies:
        own = body.normals if body.normals is not None else corner_normals(body.vertices, body.faces)
        normals.append((own @ body.T_world[:3, :3].T).astype(np.float32))
        first.append(count)
        count += len(body.faces)
    colours = np.array([body.colour for body in bodies], np.float32).reshape(-1, 3) ** 2.2
    rays = ray_scene(*((body.world_vertices(), body.faces) for body in bodies))
    return _Scene(rays, np.array(first, np.int64), np.concatenate(normals), colours)


def _lit(
    scene: _Scene, points: NDArray[np.float32], normals: NDArray[np.float32], light: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return 1 where the key light, direction (n, 3), reaches a point (n, 3); 0 in shadow or on a side turned away."""
    facing = (normals * light).sum(axis=1) > 0
    lit = facing.astype(np.float32)
    start = points[facing] + 3e-4 * normals[facing]
    query = np.concatenate([start, light[facing]], axis=1)
    if len(query):
        lit[facing] = ~scene.rays.test_occlusions(query, nthreads=1).numpy()
    return lit


def _shaded(
    scene: _Scene,
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    colours: NDArray[np.float32],
    view: NDArray[np.float32],
    light: NDArray[np.float32],
    gloss: float,
) -> NDArray[np.float32]:
    """Return linear colours (n, 3): hemisphere ambient, Lambert's key light, a small Blinn highlight."""
    lit = _lit(scene, points, normals, light)
    diffuse = AMBIENT * (0.72 + 0.28 * normals[:, 2]) + KEY * lit * np.maximum((normals * light).sum(axis=1), 0)
    half = light - view
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    highlight = gloss * lit * np.maximum((normals * half).sum(axis=1), 0) ** 40
    return colours * diffuse[:, None] + highlight[:, None]


def _sample(
    scene: _Scene,
    origin: NDArray[np.float32],
    rays: NDArray[np.float32],
    light: NDArray[np.float32],
    floor: float | None,
) -> NDArray[np.float32]:
    """Return linear colours (n, 3) along ``rays`` (n, 3) from ``origin`` (3,), lit from directions ``light`` (n, 3)."""
    query = np.concatenate([np.broadcast_to(origin, rays.shape), rays], axis=1)
    hits = scene.rays.cast_rays(query, nthreads=1)
    distance, body = hits["t_hit"].numpy(), hits["geometry_ids"].numpy()
    picture = np.broadcast_to(SKY, rays.shape).copy()
    if floor is not None:
        with np.errstate(divide="ignore", invalid="ignore"):
            to_floor = (floor - origin[2]) / rays[:, 2]
        on_floor = np.flatnonzero((to_floor > 0) & (to_floor < distance) & (origin[2] > floor))
        points = origin + rays[on_floor] * to_floor[on_floor, None]
        up = np.broadcast_to(np.array([0, 0, 1], np.float32), points.shape)
        colours = np.broadcast_to(FLOOR, points.shape)
        shade = _shaded(scene, points, up, colours, rays[on_floor], light[on_floor], 0.0)
        # Fades into the background where it is seen at a glancing angle.
        haze = np.clip(1 - np.abs(rays[on_floor, 2]) / 0.25, 0, 1)[:, None] ** 2
        picture[on_floor] = shade * (1 - haze) + SKY * haze
        distance = distance.copy()
        distance[on_floor] = np.inf
    seen = np.flatnonzero(np.isfinite(distance) & (body != NO_HIT))
    face = scene.first_face[body[seen]] + hits["primitive_ids"].numpy()[seen]
    uv = hits["primitive_uvs"].numpy()[seen]
    weights = np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1)
    normals = np.einsum("nk,nki->ni", weights, scene.normals[face])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    normals *= np.where((normals * rays[seen]).sum(axis=1, keepdims=True) > 0.2, -1, 1)
    points = origin + rays[seen] * distance[seen, None]
    picture[seen] = _shaded(scene, points, normals, scene.colours[body[seen]], rays[seen], light[seen], GLOSS)
    return picture


def key_light(camera: Camera) -> NDArray[np.float64]:
    """Return the direction (3,) towards the key light, over the viewer's left shoulder; its length is not 1."""
    right, _, forward = camera.axes()
    flat = np.array([forward[0], forward[1], 0.0])
    flat /= max(float(np.linalg.norm(flat)), 1e-9)
    return -0.45 * flat - 0.55 * right + np.array([0.0, 0.0, 1.0])


def _light_directions(camera: Camera, width: int, height: int, subsample: int) -> NDArray[np.float32]:
    """Return unit directions (height * width, 3) towards points of the round key light.

    The points of a tile of pixels and its subsamples lie on a sunflower spiral, so that together they cover the light.
    """
    key = key_light(camera)
    side = np.cross(key, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    over = np.cross(side, key / np.linalg.norm(key))
    tile = np.arange(LIGHT_TILE**2).reshape(LIGHT_TILE, LIGHT_TILE)
    # 7 is coprime to the tile's 16 pixels: neighbours get points far apart on the spiral.
    numbers = (tile * 7) % LIGHT_TILE**2 * len(SUBSAMPLES) + subsample
    tiled = np.tile(numbers, (height // LIGHT_TILE + 1, width // LIGHT_TILE + 1))
    number = tiled[:height, :width].reshape(-1)
    radius = LIGHT_SPREAD * np.sqrt((number + 0.5) / (LIGHT_TILE**2 * len(SUBSAMPLES)))
    angle = number * np.pi * (3 - np.sqrt(5))
    light = key + (radius * np.cos(angle))[:, None] * side + (radius * np.sin(angle))[:, None] * over
    return (light / np.linalg.norm(light, axis=1, keepdims=True)).astype(np.float32)


def render(
    bodies: Sequence[Body], camera: Camera, width: int = 640, height: int = 480, floor: float | None = None
) -> NDArray[np.uint8]:
    """Return a picture (height, width, 3), sRGB.

    The key light comes over the viewer's left shoulder. Four subsamples a pixel.

    Args:
        floor: height z of a horizontal plane under the bodies, m; None for none.
    """
    scene = _scene(bodies)
    total = np.zeros((height * width, 3), np.float32)
    origin = camera.position.astype(np.float32)
    for index, offset in enumerate(SUBSAMPLES):
        light = _light_directions(camera, width, height, index)
        total += np.clip(_sample(scene, origin, camera.directions(width, height, offset), light, floor), 0, 1)
    picture = (total / len(SUBSAMPLES)) ** (1 / 2.2)
    return (picture.reshape(height, width, 3) * 255 + 0.5).astype(np.uint8)
