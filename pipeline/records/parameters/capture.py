"""`renderings`: captures that are rendered instead of photographed, and `captures`: folders to reconstruct."""

from __future__ import annotations

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section


class PlacedObject(Section):
    """Where an object of the catalogue stands in a rendered capture."""

    position: tuple[float, float] = Field(description="Of the object frame's origin on the foam, m.")
    yaw_degrees: float = Field(0.0, description="Turn about z.")


class RenderingParameters(Section):
    """A rendered capture: the scene, the camera's path, and how bad the camera is."""

    objects: dict[str, PlacedObject] = Field(min_length=1, description="Objects on the foam, by name.")
    views: int = Field(24, ge=2, le=500, description="Photos, on three circles around the scene.")
    width: int = Field(960, ge=64, le=8000, description="Pixels.")
    height: int = Field(720, ge=64, le=8000, description="Pixels.")
    focal: float = Field(0.99, gt=0.2, le=5, description="Focal length / width.")
    distance: float = Field(0.62, gt=0.2, le=5, description="Camera to the middle of the scene, m.")
    tags: int = Field(6, ge=0, le=6, description="AprilTags on the foam.")
    tag_size: float = Field(0.06, gt=0.005, le=0.2, description="Edge of a tag's black square, m.")
    texture: float = Field(1.0, ge=0, le=1, description="Contrast of the objects' texture; 0 is one colour.")
    gloss: float = Field(0.0, ge=0, le=1, description="Strength of highlights on the objects.")
    distortion: tuple[float, float, float, float] = Field(
        (0.0, 0.0, 0.0, 0.0), description="Lens: k1, k2, p1, p2 of the OpenCV model."
    )
    blur: float = Field(0.0, ge=0, le=10, description="Standard deviation of the defocus, pixels.")
    motion_blur: float = Field(0.0, ge=0, le=30, description="Largest length of the camera shake, pixels.")
    noise: float = Field(0.008, ge=0, le=0.3, description="Standard deviation of the sensor noise / white.")
    exposure: float = Field(0.0, ge=0, le=1, description="Standard deviation of the log of the exposure.")
    jpeg_quality: int = Field(95, ge=10, le=100, description="Of the JPEG files.")

    @model_validator(mode="after")
    def _distortion_small(self) -> RenderingParameters:
        if max(abs(value) for value in self.distortion) > 0.5:
            raise ValueError("distortion: values beyond 0.5 fold the picture")
        return self


class ReconstructedParameters(Section):
    """Pairs whose grasps the model draws from what photos show, while the robot tries them on the true objects."""

    capture: str = Field(description="Of a rendering that shows them all: elsewhere the true places are unknown.")
    side: list[str] = Field(min_length=1, description="Objects that are picked second.")


class CaptureParameters(Section):
    """A capture to reconstruct."""

    folder: str = Field(description="Its folder: data/capture/<rendering>, or your own such as data/raw/my_capture.")
