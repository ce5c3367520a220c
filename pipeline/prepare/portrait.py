"""The picture of a prepared object: what it looks like, how large and how heavy it is."""

from __future__ import annotations

from pipeline.pictures.camera import framing
from pipeline.pictures.picture import captioned, png_bytes
from pipeline.pictures.render import Body, render
from pipeline.records.objects import PreparedObject

COLOUR = (0.85, 0.45, 0.20)
WIDTH, HEIGHT = 480, 400  # pixels


def portrait(prepared: PreparedObject) -> bytes:
    """Return a PNG of the object on its support plane, captioned with name, extents (mm), mass (g) and parts."""
    body = Body(prepared.vertices, prepared.faces, COLOUR)
    camera = framing(prepared.vertices, aspect=WIDTH / HEIGHT)
    picture = render([body], camera, WIDTH, HEIGHT, floor=prepared.bottom)
    size = " x ".join(f"{1000 * extent:.1f}" for extent in prepared.extents)
    parts = "1 convex part" if len(prepared.parts) == 1 else f"{len(prepared.parts)} convex parts"
    return png_bytes(captioned(picture, f"{prepared.name}: {size} mm, {1000 * prepared.mass:.0f} g, {parts}"))
