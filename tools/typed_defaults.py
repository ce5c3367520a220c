"""The defaults of the typed parameters, for `conf/` to build on: each is written once, beside its meaning and range."""

from __future__ import annotations

from typing import Any

from hydra.core.config_store import ConfigStore
from pydantic import BaseModel, TypeAdapter
from pydantic.fields import FieldInfo

from pipeline.records.parameters import Parameters
from pipeline.records.parameters.capture import RenderingParameters

GROUP = "typed"
MISSING = "???"  # Hydra's mark of a value that another file must give


def plain_default(field: FieldInfo) -> Any:
    """Return the default of a field as YAML would hold it, ``MISSING`` without one."""
    if field.is_required():
        return MISSING
    default = field.get_default(call_default_factory=True)
    return TypeAdapter[Any](Any).dump_python(default, mode="json", by_alias=True)


def defaults_of(model: type[BaseModel]) -> dict[str, Any]:
    """Return the defaults of a section and of the sections in it, in the order of their fields."""
    found: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel) and field.is_required():
            found[field.alias or name] = defaults_of(kind)
        else:
            found[field.alias or name] = plain_default(field)
    return found


def register() -> None:
    """Make the defaults known to Hydra: of all parameters, and of a rendering, of which there may be any number."""
    store = ConfigStore.instance()
    store.store(group=GROUP, name="parameters", node=defaults_of(Parameters), package="_global_")
    store.store(group=GROUP, name="rendering", node=defaults_of(RenderingParameters))
