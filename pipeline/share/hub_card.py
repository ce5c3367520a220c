"""README.md of a published folder and of its model: a header that hubs read, and a page for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pyarrow as pa
import yaml

from pipeline.records.ordinals import ORDINALS
from pipeline.share.columns import GRASP_COLUMNS
from pipeline.share.publication import TABLE, TRAIN, Split

SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
LARGEST = "n>1M"
# Figures of the summary that are about the model's grasps.
LEARNED = tuple(f"evaluate.learned.{name}" for name in ("trials", "success_rate_mean", "success_rate_min_pair"))
TAGS = ["robotics", "grasping", "dexterous-manipulation", "allegro-hand", "multi-object"]
FRAMES = (
    "Lengths are metres, angles radians, quaternions w, x, y, z. The hand frame is the Allegro's `base_link` (palm "
    "normal +x, fingers +z, index finger on the side of +y); an object's frame is that of its mesh in `objects/`: "
    "origin at the centre of mass, z up."
)


def header(content: Mapping[str, Any]) -> str:
    """Return the YAML between two lines of dashes."""
    return f"---\n{yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=100)}---\n"


def size_category(rows: int) -> str:
    """Return the category in which hubs put a data set of so many rows."""
    return next((name for most, name in SIZES if rows < most), LARGEST)


def _dataset_header(title: str, licence: str, splits: Sequence[Split]) -> str:
    """Return the header of the data set's card."""
    sources = list(dict.fromkeys(split.source for split in splits))
    features = [{"name": column.name, **_feature(column.type)} for column in TABLE]
    return header(
        {
            "license": licence.lower(),
            "pretty_name": title,
            "size_categories": [size_category(sum(split.rows for split in splits))],
            "task_categories": ["robotics"],
            "tags": TAGS,
            "configs": [
                {
                    "config_name": source,
                    "data_files": [{"split": own.name, "path": own.path} for own in splits if own.source == source],
                    "default": index == 0,
                }
                for index, source in enumerate(sources)
            ],
            "dataset_info": [
                {
                    "config_name": source,
                    "features": features,
                    "splits": [
                        {"name": own.name, "num_bytes": own.size, "num_examples": own.rows}
                        for own in splits
                        if own.source == source
                    ],
                }
                for source in sources
            ],
        }
    )


def dataset_card(
    title: str, licence: str, splits: Sequence[Split], objects: Sequence[Mapping[str, str]], trials: int, model: bool
) -> str:
    """Return README.md of the data set.

    Args:
        objects: per object its `name`, `source` and `licence`.
        trials: recorded ones.
        model: whether a checkpoint lies beside.
    """
    rows = sum(split.rows for split in splits)
    parts = [
        f"# {title}",
        f"{rows} grasps in which one Allegro hand (right) holds two objects: the first with thumb, index and middle "
        "finger, the second with ring finger and palm. Every grasp passed all checks, physics with both objects in the "
        "hand among them; `dataset.md` says how they came about.",
        _table(("source", "split", "grasps"), [(own.source, own.name, f"{own.rows}") for own in splits]),
        "`test` holds grasps that the model has not learned from: one of their two halves was held out.",
        "## Read it",
        f'```python\nimport pandas as pd\n\ngrasps = pd.read_parquet("{splits[0].path}")\n```',
        'With the project\'s own package, `seqgrasp.load_grasps("FOLDER")` reads all splits at once.',
        "## Columns",
        FRAMES,
        _table(("column", "meaning"), [(f"`{name}`", meaning) for name, meaning in GRASP_COLUMNS.items()]),
        "## Objects",
        _table(("object", "source", "licence"), [(own["name"], own["source"], own["licence"]) for own in objects]),
    ]
    if trials:
        parts += [
            "## Trials",
            f"`trials/` holds {trials} simulated trials with a Panda arm as a LeRobot v3 data set: measured joints, "
            "drive targets, object poses, phases (subtasks), task text and, where it was asked for, a film.",
        ]
    if model:
        parts += [
            "## Model",
            "`model/` holds the generative model that was trained on `train`, with a card of its own.",
        ]
    parts += ["## Checksums", "`sha256sum -c SHA256SUMS` checks every file."]
    return _dataset_header(title, licence, splits) + "\n" + "\n\n".join(parts) + "\n"


def _feature(kind: pa.DataType) -> dict[str, Any]:
    if pa.types.is_fixed_size_list(kind):
        return {"sequence": _name(kind.value_type), "length": kind.list_size}
    if pa.types.is_list(kind):
        return {"sequence": _name(kind.value_type)}
    return {"dtype": _name(kind)}


def _name(kind: pa.DataType) -> str:
    return {"double": "float64", "float": "float32", "string": "string", "bool": "bool"}.get(str(kind), str(kind))


def _table(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [headers, ["---"] * len(headers), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def model_card(title: str, config: Mapping[str, Any], summary: Mapping[str, Any]) -> str:
    """Return README.md of the checkpoint.

    Args:
        config: content of ``model.json``.
        summary: content of ``reports/summary.json``, of which what concerns the model is shown.
    """
    figures = {name: value for name, value in summary.items() if name.startswith("train.")}
    figures |= {name: summary[name] for name in LEARNED if name in summary}
    top = header(
        {"license": "mit", "tags": [*TAGS, "diffusion"], "pipeline_tag": "robotics", "library_name": "seqgrasp"}
    )
    pairs = ", ".join(f"{first} then {second}" for first, second in config["pairs"])
    parts = [
        f"# {title}: the model",
        "Draws grasps of two objects in one Allegro hand from the two objects' point clouds: 16 joints and the poses "
        "of both objects in the hand. A diffusion model that predicts the clean grasp; the clouds are encoded by a "
        f"PointNet++. Trained on the split `{TRAIN}` of {len(config['pairs'])} pairs: {pairs}.",
        "`model.safetensors` holds the averaged weights, `model.json` architecture and normalisation, `history.csv` "
        "the losses. Nothing in these files can run code.",
        "## Use\n\nPut the files into `models/train/` of a clone; `python -m pipeline.sample` and "
        "`seqgrasp.sample_grasps` draw from it.",
        "## Figures\n\nFrom simulation, on the objects that it was trained on; see the metrics page of the project.",
        _table(("figure", "value"), [(f"`{name}`", f"{value:.6g}") for name, value in sorted(figures.items())]),
        "## Limits\n\nOne hand; the fingers of each grasp are fixed (thumb, index and middle for the "
        f"{ORDINALS[0]} object, ring and palm for the {ORDINALS[1]}). Samples are proposals: have them checked before "
        "a robot moves.",
    ]
    return top + "\n" + "\n\n".join(parts) + "\n"
