"""`compute`: where independent items run."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from pipeline.records.parameters.section import Section


class ComputeParameters(Section):
    """Where independent items run; never an input of a stage, as results do not depend on it."""

    backend: Literal["processes", "dask"] = Field(
        "processes",
        description="`processes`: of this machine. `dask`: workers of a Dask cluster, which may be on other machines "
        "(docs/scaling.md); needs the packages of the extra `cluster`.",
    )
    address: str = Field(
        "",
        pattern=r"^$|^[a-z]+://\S+$",
        description="Of the Dask scheduler, such as `tcp://node17:8786`. Empty: a cluster of `workers` processes on "
        "this machine, started and ended by each stage.",
    )
    workers: int = Field(
        0,
        ge=0,
        le=1024,
        description="Processes; 0 means one per core. With an `address`, those of its cluster take their place.",
    )

    @model_validator(mode="after")
    def _address_is_used(self) -> ComputeParameters:
        if self.address and self.backend != "dask":
            raise ValueError("an address is used by the backend dask alone; set compute.backend, or clear the address")
        return self
