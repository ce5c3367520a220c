"""Pictures of a scene by ray casting: textured solids on foam on a table, one soft light, an ideal sensor."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from pipeline.capture.layout import FOAM, TABLE
from pipeline.capture.texture import Print, foam_colours
from pipeline.pictures.render import SUBSAMPLES
from pipeline.shapes.rays import ray_scene

LIGHT = np.array([0.35, -0.25, 1.0], np.float32)
LIGHT_SPREAD = 0.08
AMBIENT, KEY = 0.45, 0.75
PALETTE = np.array([[0.8, 0.3, 0.15], [0.2, 0.45, 0.75], [0.75, 0.65, 0.2], [0.3, 0.65, 0.35]], np.float32)


@dataclass(frozen=True)
class Solid:
    """One object in the scene."""

    vertices: NDArray[np.float64]  # (V, 3), object frame
    faces: NDArray[np.int64]  # (F, 3)
    T_scene: NDArray[np.float64]  # (4, 4)

    def placed(self) -> NDArray[np.float64]:
        """Return the vertices (V, 3) in the scene frame."""
        return self.vertices @ self.T_scene[:3, :3].T + self.T_scene[:3, 3]


@dataclass(frozen=True)
class Lens:
    """Where a pixel looks: a pinhole with the distortion of OpenCV's model."""

    width: int
    height: int
    focal: float  # pixels
    distortion: tuple[float, float, float, float]

    def directions(self, offset: tuple[float, float]) -> NDArray[np.float32]:
        """Return rays (height * width, 3) in the camera frame, z = 1, through ``offset`` (0 to 1) of each pixel."""
        x = (np.arange(self.width) + offset[0] - self.width / 2) / self.focal
        y = (np.arange(self.height) + offset[1] - self.height / 2) / self.focal
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 1, 2)
        if any(self.distortion):
            criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-9)
            grid = cv2.undistortPoints(grid, np.eye(3), np.array(self.distortion), criteria=criteria)
        flat = grid.reshape(-1, 2)
        return np.concatenate([flat, np.ones((len(flat), 1))], axis=1).astype(np.float32)


class Stage:
    """A scene ready for rays. Geometry 0 is the table, 1 the foam, objects follow."""

    def __init__(self, solids: list[Solid], foam: NDArray[np.float32], block: Print, texture: float, gloss: float):
        self.solids, self.foam, self.block, self.texture, self.gloss = solids, foam, block, texture, gloss
        table = trimesh.creation.box((*TABLE, 0.03)).apply_translation([0, 0, -FOAM[2] - 0.015])
        foam_box = trimesh.creation.box(FOAM).apply_translation([0, 0, -FOAM[2] / 2])
        self.rays = ray_scene(
            (table.vertices, table.faces),
            (foam_box.vertices, foam_box.faces),
            *((solid.placed(), solid.faces) for solid in solids),
        )

    def _colours(self, body: NDArray[np.uint32], points: NDArray[np.float32]) -> NDArray[np.float32]:
        colours = np.full(points.shape, 0.25, np.float32)
        own = body == 0
        colours[own] = self.block.colours(points[own] / 4, PALETTE[3] * 0.6, np.zeros(3, np.float32), 1.0)
        own = body == 1
        colours[own] = foam_colours(self.foam, points[own, 0], points[own, 1])[:, None]
        for index, solid in enumerate(self.solids):
            own = body == index + 2
            T = np.linalg.inv(solid.T_scene)
            local = (points[own] @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
            offset = np.array([0.017, 0.029, 0.041], np.float32) * (index + 1)
            colours[own] = self.block.colours(local, PALETTE[index % len(PALETTE)], offset, self.texture)
        return colours

    def picture(self, lens: Lens, T_camera_scene: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return a picture (height, width, 3), linear light, four rays a pixel."""
        R, t = T_camera_scene[:3, :3], T_camera_scene[:3, 3]
        origin = (-R.T @ t).astype(np.float32)
        total = np.zeros((lens.height * lens.width, 3), np.float32)
        side = np.cross(LIGHT, [0, 1.0, 0]).astype(np.float32)
        for index, offset in enumerate(SUBSAMPLES):
            rays = lens.directions(offset) @ R.astype(np.float32)
            query = np.concatenate([np.broadcast_to(origin, rays.shape), rays], axis=1)
            hits = self.rays.cast_rays(query, nthreads=1)
            distance = hits["t_hit"].numpy()
            seen = np.flatnonzero(np.isfinite(distance))
            body, normal = hits["geometry_ids"].numpy()[seen], hits["primitive_normals"].numpy()[seen]
            normal *= -np.sign((normal * rays[seen]).sum(axis=1, keepdims=True))
            points = origin + rays[seen] * distance[seen, None]
            angle = 2 * np.pi * index / len(SUBSAMPLES)
            light = LIGHT + LIGHT_SPREAD * (np.cos(angle) * side + np.sin(angle) * np.array([0, 1, 0], np.float32))
            light = (light / np.linalg.norm(light)).astype(np.float32)
            toward = np.broadcast_to(light, points.shape)
            shadow = self.rays.test_occlusions(np.concatenate([points + 3e-4 * normal, toward], axis=1), nthreads=1)
            lit = np.where(shadow.numpy(), 0.0, np.maximum(normal @ light, 0)).astype(np.float32)
            shade = self._colours(body, points) * (AMBIENT * (0.8 + 0.2 * normal[:, 2]) + KEY * lit)[:, None]
            if self.gloss:
                half = light - rays[seen] / np.linalg.norm(rays[seen], axis=1, keepdims=True)
                half /= np.linalg.norm(half, axis=1, keepdims=True)
                spot = self.gloss * (lit > 0) * np.maximum((normal * half).sum(axis=1), 0) ** 40
                shade += np.where(body >= 2, spot, 0)[:, None]
            picture = np.full(rays.shape, 0.75, np.float32)
            picture[seen] = shade
            total += picture
        return np.asarray(total / len(SUBSAMPLES), np.float32).reshape(lens.height, lens.width, 3)
