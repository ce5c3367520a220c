"""`report` and `track`: the page, the summary and the MLflow record."""

from __future__ import annotations

from pydantic import Field

from pipeline.records.parameters.section import Section


class ReportParameters(Section):
    """Appearance of the report."""

    picture_width: int = Field(640, ge=64, le=4096, description="Pixels of trial pictures.")
    picture_height: int = Field(480, ge=64, le=4096, description="Pixels of trial pictures.")


class TrackParameters(Section):
    """The MLflow record."""

    experiment: str = Field("sequential-grasping", min_length=1, description="MLflow experiment name.")


class ComputeParameters(Section):
    """Where independent items run; never an input of a stage, as results do not depend on it."""

    workers: int = Field(0, ge=0, le=1024, description="Processes; 0 means one per core.")
