"""What can draw a film of a recording."""

from __future__ import annotations

from pipeline.pictures.appearance import Appearance
from pipeline.pictures.film import (
    CAMERA_DEGREES,
    CAMERA_POSITION,
    CAMERA_TARGET,
    Draw,
    Film,
    Renderer,
    raster,
)
from pipeline.records.errors import UserError


def sapien(looks: Appearance, film: Film) -> Draw:
    """Return what draws the pictures of a film with SAPIEN's renderer.

    Raises:
        UserError: there is no driver for it.
    """
    from pipeline.replay.sapien_camera import SapienCamera, why_unusable

    reason = why_unusable()
    if reason:
        raise UserError(f"SAPIEN's renderer cannot be used ({reason}); leave `--renderer` out.")
    view = (CAMERA_POSITION, CAMERA_TARGET, CAMERA_DEGREES)
    return SapienCamera(looks, film.width, film.height, view).picture


RENDERERS: dict[str, Renderer] = {"raster": raster, "sapien": sapien}  # the default first
