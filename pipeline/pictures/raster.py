"""Many pictures of the same bodies at changing poses, as films need them: rasterised, in some 20 ms each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.compute.warp import warp
from pipeline.pictures.camera import Camera
from pipeline.pictures.render import LIGHT_SPREAD, Body, corner_normals, key_light

DEVICE = "cpu"
NOTHING = -1  # owner of a sample that shows no face
FAR_BELOW = -1e3  # m


class Raster:
    """Meshes, a camera and a light that stay; the poses of the meshes change."""

    def __init__(
        self,
        bodies: Sequence[Body],
        camera: Camera,
        width: int,
        height: int,
        floor: float,
        reach: tuple[tuple[float, float, float], float],
    ) -> None:
        """Prepare to draw.

        Args:
            bodies: at least one; their ``T_world`` is not used.
            width: of pictures, pixels.
            height: likewise.
            floor: height z of a horizontal plane, m.
            reach: centre (m, in the world) and radius (m) of a ball; bodies in it cast shadows.
        """
        warp()  # before the kernels are loaded
        from pipeline.pictures import raster_kernel

        self.kernel = raster_kernel
        self.width, self.height = width, height
        self.scene = self._scene(bodies, floor)
        self.view = self._view(camera)
        self.light = self._light(camera, *reach)
        count, samples = len(self.scene.vertices), width * height * raster_kernel.SUBSAMPLES**2
        self.seen, self.lit = (self._filled((count, 3), 0.0, np.float32) for _ in range(2))
        self.nearest, self.owner = self._filled(samples, 0.0, np.float32), self._filled(samples, NOTHING, np.int32)
        edge = raster_kernel.SHADOW_SIZE
        self.highest = self._filled(edge**2, FAR_BELOW, np.float32)
        self.cells, self.light.around = (self._filled(raster_kernel.CELLS**2, 0.0, np.float32) for _ in range(2))
        self.caster = self._filled(edge**2, NOTHING, np.int32)
        self.bare, self.pixels = (self._filled((width * height, 3), 0, np.uint8) for _ in range(2))
        self.spots = self._filled((width * height, 3), 0.0, np.float32)
        inputs = [self.scene, self.view, self.light, self.bare, self.spots.view(warp().vec3)]
        self._launch(raster_kernel.shade_floor, width * height, inputs)

    def picture(self, poses: Sequence[NDArray[np.float64]]) -> NDArray[np.uint8]:
        """Return a picture (height, width, 3), sRGB.

        Args:
            poses: ``T_world`` (4, 4) of each body.
        """
        wp, kernel = warp(), self.kernel
        self.scene.T = wp.array(np.asarray(poses, np.float32), dtype=wp.mat44, device=DEVICE)
        for array, empty in (
            (self.nearest, 0.0),
            (self.owner, NOTHING),
            (self.highest, FAR_BELOW),
            (self.caster, NOTHING),
        ):
            array.fill_(empty)
        scene, view, light, faces = self.scene, self.view, self.light, self.scene.faces
        seen, lit = (array.view(wp.vec3) for array in (self.seen, self.lit))
        edge = kernel.SHADOW_SIZE
        self._launch(kernel.place, len(scene.vertices), [scene, view, light, seen, lit])
        self._launch(kernel.cover, 1, [lit, faces, edge, edge, FAR_BELOW, self.highest, self.caster])
        self._launch(kernel.highest_of_cells, len(self.cells), [self.highest, self.cells])
        self._launch(kernel.highest_around, len(self.cells), [self.cells, light.around])
        self._launch(kernel.cover, 1, [seen, faces, view.width, view.height, 0.0, self.nearest, self.owner])
        spots = self.spots.view(wp.vec3)
        inputs = [scene, view, light, self.highest, seen, self.owner, self.bare, spots, self.pixels]
        self._launch(kernel.shade, self.width * self.height, inputs)
        return self.pixels.numpy().reshape(self.height, self.width, 3).copy()

    def _launch(self, function: Any, count: int, inputs: list[Any]) -> None:
        warp().launch(function, dim=count, inputs=inputs, device=DEVICE)

    def _filled(self, shape: Any, value: float, kind: Any) -> Any:
        return warp().array(np.full(shape, value, kind), device=DEVICE)

    def _scene(self, bodies: Sequence[Body], floor: float) -> Any:
        wp, scene = warp(), self.kernel.Scene()
        vertices = [len(body.vertices) for body in bodies]
        faces = [len(body.faces) for body in bodies]
        first = np.cumsum([0, *vertices[:-1]])
        numbers = np.arange(len(bodies), dtype=np.int32)
        normals = [
            body.normals if body.normals is not None else corner_normals(body.vertices, body.faces) for body in bodies
        ]
        colours = np.array([body.colour for body in bodies], np.float32) ** 2.2

        def array(values: Any, kind: Any, number: Any) -> Any:
            return wp.array(np.ascontiguousarray(values, number), dtype=kind, device=DEVICE)

        scene.vertices = array(np.concatenate([body.vertices for body in bodies]), wp.vec3, np.float32)
        scene.vertex_body = array(np.repeat(numbers, vertices), int, np.int32)
        placed = [body.faces + begin for body, begin in zip(bodies, first, strict=True)]
        scene.faces = array(np.concatenate(placed), wp.vec3i, np.int32)
        scene.face_body = array(np.repeat(numbers, faces), int, np.int32)
        scene.normals = array(np.concatenate(normals), wp.vec3, np.float32)
        scene.colours = array(colours, wp.vec3, np.float32)
        scene.floor = floor
        return scene

    def _view(self, camera: Camera) -> Any:
        wp, view = warp(), self.kernel.View()
        view.width, view.height = (edge * self.kernel.SUBSAMPLES for edge in (self.width, self.height))
        view.position = wp.vec3(*camera.position.tolist())
        view.right, view.down, view.forward = (wp.vec3(*axis) for axis in camera.axes().tolist())
        view.focal = view.height / 2 / float(np.tan(camera.field_of_view / 2))
        return view

    def _light(self, camera: Camera, centre: tuple[float, float, float], radius: float) -> Any:
        wp, light = warp(), self.kernel.Light()
        key = key_light(camera)
        length = float(np.linalg.norm(key))
        towards = key / length
        right = np.cross(towards, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        light.towards, light.right = wp.vec3(*towards.tolist()), wp.vec3(*right.tolist())
        light.up = wp.vec3(*np.cross(right, towards).tolist())
        light.centre = wp.vec3(*centre)
        light.scale = self.kernel.SHADOW_SIZE / 2 / radius
        light.spread = LIGHT_SPREAD / length
        number = np.arange(self.kernel.TAPS)
        angle, reach = number * self.kernel.GOLDEN_ANGLE, np.sqrt((number + 0.5) / len(number))
        spiral = np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1)
        light.taps = wp.array(spiral.astype(np.float32), dtype=wp.vec2, device=DEVICE)
        return light
