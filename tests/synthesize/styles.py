"""A style of grasps, for tests that care about some of its parameters only."""

from typing import Any

from pipeline.records.parameters.synthesize import StyleParameters


def some_style(**own: Any) -> StyleParameters:
    """Return ``own`` parameters, with some value for those that have no default."""
    others: dict[str, Any] = {
        "chains": 256,
        "starts": 1,
        "iterations": 1500,
        "table_clearance": 0.0,
        "weight_offset": 300.0,
    }
    return StyleParameters(**{**others, "mount_clearance": None, "keep_out_margin": None, **own})
