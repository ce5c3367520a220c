"""Lenses: where a camera sees a direction, how that changes with the lens, and what a photo's EXIF data say of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pycolmap
from numpy.typing import NDArray

from pipeline.records.captures import LENS_PARAMETERS, Intrinsics

# What of a lens is estimated, from the plainest model to the richest. Pixels are square in all of them, and the
# principal point is in the middle: photos of a resting sheet cannot tell these from where the camera stood.
MODELS = {"SIMPLE_RADIAL": 2, "RADIAL": 3, "OPENCV": 5}  # so many of focal length, k1, k2, p1, p2
FILM_DIAGONAL = 43.27  # mm: focal lengths "equivalent to 35 mm film" refer to its diagonal


@dataclass(frozen=True)
class Lens:
    """A pinhole with the distortion of OpenCV's and COLMAP's models; pixel centres at .5."""

    width: int
    height: int
    values: NDArray[np.float64]  # (5,) focal length (pixels), k1, k2, p1, p2
    aspect: float = 1.0  # focal length along y over that along x
    centre: tuple[float, float] | None = None  # principal point, pixels; None: the middle
    free: int = MODELS["SIMPLE_RADIAL"]  # so many of the values are estimated

    @property
    def focal(self) -> float:
        """Focal length, pixels."""
        return float(self.values[0])

    @property
    def principal(self) -> NDArray[np.float64]:
        """Principal point (2,), pixels."""
        return np.array(self.centre or (self.width / 2, self.height / 2))

    @staticmethod
    def guessed(width: int, height: int, focal: float) -> Lens:
        """Return a lens without distortion."""
        return Lens(width, height, np.array([focal, 0.0, 0.0, 0.0, 0.0]))

    @staticmethod
    def calibrated(camera: Intrinsics) -> Lens:
        """Return the lens of ``intrinsics.yaml``, of which nothing is estimated."""
        count, _ = LENS_PARAMETERS[camera.model]
        lengths, rest = camera.parameters[:count], camera.parameters[count + 2 :]
        x, y = camera.parameters[count : count + 2]
        values = np.array([lengths[0], *rest, *np.zeros(4 - len(rest))])
        return Lens(camera.width, camera.height, values, lengths[-1] / lengths[0], (x, y), 0)

    def with_values(self, values: NDArray[np.float64]) -> Lens:
        """Return the lens with other values (5,)."""
        return replace(self, values=np.asarray(values, np.float64))

    def project(
        self, local: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return where points (n, 3) of the camera frame, z ahead, are seen.

        Returns:
            Pixels (n, 2), their derivatives by the points (n, 2, 3), and by the lens's values (n, 2, 5).
        """
        focal, k1, k2, p1, p2 = self.values
        depth = np.where(np.abs(local[:, 2]) > 1e-9, local[:, 2], 1e-9)
        u, v = local[:, 0] / depth, local[:, 1] / depth
        r2 = u * u + v * v
        radial, slope = 1 + k1 * r2 + k2 * r2 * r2, 2 * (k1 + 2 * k2 * r2)
        x = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u)
        y = v * radial + 2 * p2 * u * v + p1 * (r2 + 2 * v * v)
        scale = np.array([focal, focal * self.aspect])
        by_ray = np.empty((len(u), 2, 2))
        by_ray[:, 0, 0] = radial + u * u * slope + 2 * p1 * v + 6 * p2 * u
        by_ray[:, 0, 1] = by_ray[:, 1, 0] = u * v * slope + 2 * p1 * u + 2 * p2 * v
        by_ray[:, 1, 1] = radial + v * v * slope + 2 * p2 * u + 6 * p1 * v
        by_ray *= scale[:, None]
        ray_by_point = np.zeros((len(u), 2, 3))
        ray_by_point[:, 0, 0] = ray_by_point[:, 1, 1] = 1 / depth
        ray_by_point[:, 0, 2], ray_by_point[:, 1, 2] = -u / depth, -v / depth
        by_lens = np.stack(
            [
                np.stack([x / focal, u * r2, u * r2 * r2, 2 * u * v, r2 + 2 * u * u], axis=-1),
                np.stack([y / focal, v * r2, v * r2 * r2, r2 + 2 * v * v, 2 * u * v], axis=-1),
            ],
            axis=1,
        )
        pixels = np.stack([x, y], axis=-1) * scale + self.principal
        return pixels, by_ray @ ray_by_point, by_lens * scale[:, None]

    def camera(self) -> Any:
        """Return the same lens as COLMAP's camera."""
        _, k1, k2, p1, p2 = self.values
        parameters = [self.focal, self.focal * self.aspect, *self.principal, k1, k2, p1, p2]
        return pycolmap.Camera(model="OPENCV", width=self.width, height=self.height, params=parameters)

    def rays(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return undistorted coordinates (n, 2) at depth 1 of ``pixels`` (n, 2)."""
        return np.asarray(self.camera().cam_from_img(np.ascontiguousarray(pixels, np.float64))).reshape(-1, 2)

    def matrix(self) -> NDArray[np.float64]:
        """Return K (3, 3) of the pinhole."""
        x, y = self.principal
        return np.array([[self.focal, 0, x], [0, self.focal * self.aspect, y], [0, 0, 1.0]])


def focal_of_film(equivalent: float, width: int, height: int) -> float:
    """Return the focal length in pixels that a focal length "equivalent to 35 mm film" (mm) means."""
    return equivalent / FILM_DIAGONAL * float(np.hypot(width, height))
