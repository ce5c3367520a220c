"""What every column of shared grasps means."""

from __future__ import annotations

from pipeline.records.flat import PAIR_GRASPS
from pipeline.records.sources import OF_ALL_PAIRS
from pipeline.records.tables import description

# What every column of `load_grasps` means.
GRASP_COLUMNS = {
    "source": " or ".join(f"`{source.name}` ({source.origin})" for source in OF_ALL_PAIRS.values()),
    **{field.name: description(field) for field in PAIR_GRASPS},
}
_LEARNED_IDS = "; of a learned grasp, the number of the sample"
GRASP_COLUMNS |= {name: GRASP_COLUMNS[name] + _LEARNED_IDS for name in ("grasp0_id", "grasp1_id")}
