"""The defaults of the typed parameters, for `conf/` to build on: each is written once, beside its range and meaning."""

from __future__ import annotations

from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING
from pydantic import BaseModel

from pipeline.records.parameters import Parameters
from pipeline.records.parameters.capture import RenderingParameters

GROUP = "typed"


def defaults_of(model: type[BaseModel]) -> dict[str, Any]:
    """Return the defaults of a section and of those in it as plain data, in the order of the fields.

    A parameter without a default keeps its place by Hydra's mark of a value that is still missing.
    """
    found = {}
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            default = defaults_of(kind)
        else:
            default = MISSING if field.is_required() else field.get_default(call_default_factory=True)
        found[field.alias or name] = default
    return found


def register() -> None:
    """Make the defaults known to Hydra: of all parameters, and of a rendering, of which there may be any number."""
    store = ConfigStore.instance()
    store.store(group=GROUP, name="parameters", node=defaults_of(Parameters), package="_global_")
    store.store(group=GROUP, name="rendering", node=defaults_of(RenderingParameters))
