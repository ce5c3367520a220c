"""Pictures for the report: photos, and beside each what was found, as the same camera sees it."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from pipeline.reconstruct.cameras import PosedPhoto
from pipeline.reconstruct.dense import DenseObject
from pipeline.reconstruct.photos import read_colours, shrunk
from pipeline.reconstruct.surface import SEEN
from pipeline.reconstruct.views import View, undistorted_colours
from pipeline.reconstruct.visibility import Bodies
from pipeline.records.captures import Capture

PICTURES = 3
WIDTH = 400  # pixels
JPEG_QUALITY = 70
FADED = 0.7  # of the way from the grey photo to white, behind the surfaces
LIGHT = np.array([0.36, -0.48, 0.8])  # unit, scene frame
COLOURS = np.array([[230, 126, 34], [52, 132, 196], [39, 154, 110], [158, 86, 176], [200, 70, 80], [150, 140, 40]])
ASSUMED_COLOUR = np.array([200.0, 200.0, 200.0])


def surfaces_over(photo: NDArray[np.uint8], view: View, found: Sequence[DenseObject], width: int) -> NDArray[np.uint8]:
    """Return a picture (h, ``width``, 3): the surfaces, a colour for each, over the faded photo.

    What was assumed (farther than ``SEEN`` from everything measured) is grey.

    Args:
        photo: (h', w', 3) what the undistorted view shows.
    """
    scale = width / photo.shape[1]
    small = cv2.resize(photo, (width, round(scale * photo.shape[0])), interpolation=cv2.INTER_AREA)
    grey = small.astype(np.float64).mean(axis=-1, keepdims=True)
    picture = np.broadcast_to(grey + FADED * (255 - grey), small.shape).reshape(-1, 3).copy()
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(len(small)) + 0.5)
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1) / scale
    rays = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ np.linalg.inv(view.K).T
    rays = rays @ view.T_camera_scene[:3, :3]
    distance, number, normals = Bodies([item.surface for item in found]).hits(view.centre, rays)
    for index, item in enumerate(found):
        own = np.flatnonzero(number == index)
        points = view.centre + rays[own] * distance[own, None]
        assumed = cKDTree(item.points.positions).query(points)[0] > SEEN
        colour = np.where(assumed[:, None], ASSUMED_COLOUR, COLOURS[index % len(COLOURS)])
        picture[own] = colour * (0.55 + 0.45 * np.maximum(normals[own] @ LIGHT, 0))[:, None]
    return picture.round().astype(np.uint8).reshape(small.shape)


def _jpeg(pixels: NDArray[np.uint8], width: int) -> bytes:
    picture, target = Image.fromarray(pixels), io.BytesIO()
    height = round(picture.height * width / picture.width)
    picture.resize((width, height), Image.Resampling.LANCZOS).save(target, format="JPEG", quality=JPEG_QUALITY)
    return target.getvalue()


def pictures_of(
    capture: Capture, posed: Sequence[PosedPhoto], views: Sequence[View], found: Mapping[str, DenseObject]
) -> dict[str, tuple[bytes, bytes]]:
    """Return, for a few photos spread over the capture, the photo and its surfaces as JPEG.

    Args:
        views: of the photos in ``posed``, in the same order.
    """
    files = {path.stem: path for path in capture.images}
    pictures = {}
    for index in sorted({round(len(views) * k / PICTURES) for k in range(PICTURES)}):
        colours = read_colours(files[views[index].name])
        if posed[index].photo.times > 1:
            colours = np.asarray(shrunk(colours, posed[index].photo.times).round(), np.uint8)
        photo = undistorted_colours(posed[index], colours)
        surfaces = surfaces_over(photo, views[index], list(found.values()), WIDTH)
        pictures[views[index].name] = (_jpeg(photo, WIDTH), _jpeg(surfaces, WIDTH))
    return pictures
