"""`compute`: where independent items run."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section


class ComputeParameters(Section):
    """Where independent items run; never an input of a stage, because results do not depend on it."""

    backend: Literal["processes", "dask"] = Field(
        "processes",
        description="`processes` uses worker processes on this machine. `dask` uses the workers of a Dask cluster, "
        "possibly on other machines (docs/scaling.md), and needs the packages of the extra `cluster`.",
    )
    address: str = Field(
        "",
        pattern=r"^$|^[a-z]+://\S+$",
        description="Address of the Dask scheduler, such as `tcp://node17:8786`. If empty, each stage starts and stops "
        "a cluster of `workers` processes on this machine.",
    )
    workers: int = Field(
        0,
        ge=0,
        le=1024,
        description="Number of worker processes; 0 means one per core. Ignored if `address` names a cluster.",
    )

    @model_validator(mode="after")
    def _address_is_used(self) -> ComputeParameters:
        if self.address and self.backend != "dask":
            raise ValueError(
                "address is used by the backend dask only; set compute.backend to dask, or clear compute.address"
            )
        return self
