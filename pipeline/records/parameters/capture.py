"""`renderings`: captures that are rendered instead of photographed, and `captures`: folders to reconstruct."""

from __future__ import annotations

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section


class PlacedObject(Section):
    """Where an object of the catalogue stands in a rendered capture."""

    position: tuple[float, float] = Field(description="[m] Position (x, y) of the object frame's origin on the foam.")
    yaw_degrees: float = Field(0.0, description="[degrees] Rotation of the object about the vertical.")


class RenderingParameters(Section):
    """A rendered capture: the scene, the camera's path, and the imperfections of the camera."""

    objects: dict[str, PlacedObject] = Field(min_length=1, description="Objects on the foam, by name.")
    views: int = Field(24, ge=2, le=500, description="Number of photos, taken on three circles around the scene.")
    width: int = Field(960, ge=64, le=8000, description="[pixels] Width of the photos.")
    height: int = Field(720, ge=64, le=8000, description="[pixels] Height of the photos.")
    focal: float = Field(0.99, gt=0.2, le=5, description="Focal length divided by the width of the photos.")
    distance: float = Field(0.62, gt=0.2, le=5, description="[m] Distance from the camera to the middle of the scene.")
    tags: int = Field(6, ge=0, le=6, description="Number of AprilTags on the foam.")
    tag_size: float = Field(0.06, gt=0.005, le=0.2, description="[m] Edge length of an AprilTag's black square.")
    texture: float = Field(
        1.0, ge=0, le=1, description="Contrast of the texture on the objects; 0 gives them a uniform colour."
    )
    gloss: float = Field(0.0, ge=0, le=1, description="Strength of the highlights on the objects.")
    distortion: tuple[float, float, float, float] = Field(
        (0.0, 0.0, 0.0, 0.0), description="Lens distortion: k1, k2, p1, p2 of the OpenCV model."
    )
    blur: float = Field(0.0, ge=0, le=10, description="[pixels] Standard deviation of the defocus blur.")
    motion_blur: float = Field(0.0, ge=0, le=30, description="[pixels] Maximum length of the motion blur.")
    noise: float = Field(0.008, ge=0, le=0.3, description="Standard deviation of the sensor noise, relative to white.")
    exposure: float = Field(
        0.0, ge=0, le=1, description="Standard deviation of the logarithm of the exposure, drawn for each photo."
    )
    jpeg_quality: int = Field(95, ge=10, le=100, description="JPEG quality of the photos.")

    @model_validator(mode="after")
    def _distortion_small(self) -> RenderingParameters:
        if max(abs(value) for value in self.distortion) > 0.5:
            raise ValueError("distortion: values beyond +-0.5 would fold the image over itself; use smaller ones")
        return self


class ReconstructedParameters(Section):
    """Pairs for which the model draws grasps from a reconstruction, and the robot tries them on the true objects."""

    capture: str = Field(
        description="Capture to sample from. It must be a rendering that shows all objects of these pairs, since the "
        "true poses of photographed objects are unknown."
    )
    side: list[str] = Field(
        min_length=1, description="Objects that are picked second, after the object that the entry is named after."
    )


class CaptureParameters(Section):
    """A capture to reconstruct."""

    folder: str = Field(
        description="Folder of the capture: data/capture/<name> for a rendering, or a folder of photos below data/raw, "
        "such as data/raw/my_capture."
    )
