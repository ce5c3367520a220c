"""`report` and `track`: the page, the summary and the MLflow record."""

from __future__ import annotations

from pydantic import Field

from pipeline.records.parameters.section import Section


class ReportParameters(Section):
    """Pictures of the report."""

    picture_width: int = Field(
        400, ge=64, le=1920, description="[pixels] Width of the report's pictures of trials and grasps."
    )
    picture_height: int = Field(
        300, ge=64, le=1080, description="[pixels] Height of the report's pictures of trials and grasps."
    )
    pictures_per_trial: int = Field(
        12, ge=2, le=40, description="Maximum number of pictures of a trial, spread evenly over its phases."
    )


class TrackParameters(Section):
    """The MLflow record."""

    experiment: str = Field(
        "sequential-grasping", min_length=1, description="Name of the MLflow experiment that runs are recorded under."
    )
