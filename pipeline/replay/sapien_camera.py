"""Pictures by SAPIEN's own renderer, where a Vulkan driver is found.

It knows the meshes and nothing of physics: a recording is drawn, so what is seen cannot change a trial. Without a
graphics card SAPIEN 3.0.3 needs a newer Mesa than Debian 12's own.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import sapien
from numpy.typing import NDArray

from pipeline.pictures.appearance import Appearance
from pipeline.pictures.camera import look_at
from pipeline.pictures.render import Body
from pipeline.records.poses import position_quaternion

View = tuple[tuple[float, float, float], tuple[float, float, float], float]  # position, target (m), degrees upright
AMBIENT, KEY = (0.45, 0.45, 0.45), (2.2, 2.2, 2.2)
KEY_DIRECTION = (-0.3, 0.75, -1.0)  # where its light goes: over the viewer's left shoulder


def why_unusable() -> str:
    """Return why SAPIEN cannot draw here; empty when it can."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # which Vulkan library it takes
            sapien.Scene([sapien.render.RenderSystem()])
    except RuntimeError as error:
        return " ".join(str(error).split()) or "no Vulkan driver"
    return ""


class SapienCamera:
    """A scene of meshes without physics, and a camera."""

    def __init__(self, looks: Appearance, width: int, height: int, view: View) -> None:
        """Build the scene; ``width`` and ``height`` in pixels.

        Raises:
            RuntimeError: there is no driver; see :func:`why_unusable`.
        """
        self.scene = sapien.Scene([sapien.render.RenderSystem()])
        self.scene.set_ambient_light(AMBIENT)
        self.scene.add_directional_light(KEY_DIRECTION, KEY, shadow=True, shadow_scale=2.0, shadow_map_size=2048)
        for body in (looks.sponge, looks.table):
            self._add(body).pose = _pose(body.T_world)
        self.moving = [self._add(body) for body in looks.moving]
        position, target, degrees = view
        self.camera = sapien.render.RenderCameraComponent(width, height)
        self.camera.set_fovy(np.radians(degrees))
        self.camera.near, self.camera.far = 0.05, 20.0
        mount = sapien.Entity()
        mount.add_component(self.camera)
        mount.pose = _camera_pose(position, target)
        self.scene.add_entity(mount)

    def _add(self, body: Body) -> Any:

        material = sapien.render.RenderMaterial(base_color=[channel**2.2 for channel in body.colour] + [1.0])
        material.roughness, material.metallic, material.specular = 0.6, 0.0, 0.3
        normals = body.normals
        corners = body.vertices[body.faces].reshape(-1, 3)
        if normals is None:
            a, b, c = body.vertices[body.faces].transpose(1, 0, 2)
            flat = np.cross(b - a, c - a)
            normals = np.repeat((flat / np.linalg.norm(flat, axis=1, keepdims=True))[:, None], 3, axis=1)
        shape = sapien.render.RenderShapeTriangleMesh(
            vertices=corners.astype(np.float32),
            triangles=np.arange(len(corners), dtype=np.uint32).reshape(-1, 3),
            normals=normals.reshape(-1, 3).astype(np.float32),
            uvs=np.zeros((len(corners), 2), np.float32),
            material=material,
        )
        component = sapien.render.RenderBodyComponent()
        component.attach(shape)
        entity = sapien.Entity()
        entity.add_component(component)
        self.scene.add_entity(entity)
        return entity

    def picture(self, poses: Sequence[NDArray[np.float64]]) -> NDArray[np.uint8]:
        """Return a picture (height, width, 3), sRGB, of all that moves at ``poses`` (see appearance.moving_poses)."""
        for entity, T in zip(self.moving, poses, strict=True):
            entity.pose = _pose(T)
        self.scene.update_render()
        self.camera.take_picture()
        linear = np.asarray(self.camera.get_picture("Color"))[..., :3]
        return (np.clip(linear, 0, 1) * 255 + 0.5).astype(np.uint8)


def _pose(T: NDArray[np.float64]) -> object:

    position, quaternion = position_quaternion(T)
    return sapien.Pose(position, quaternion)


def _camera_pose(position: Sequence[float], target: Sequence[float]) -> object:
    """Return the pose of a camera; SAPIEN's looks along x, with y to the left and z up."""
    right, down, forward = look_at(position, target).axes()
    T = np.eye(4)
    T[:3, :3] = np.stack([forward, -right, -down], axis=1)
    T[:3, 3] = position
    return _pose(T)
