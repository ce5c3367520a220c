"""Where every file of the pipeline lies, relative to the repository root (the working folder of a stage)."""

from __future__ import annotations

from pathlib import Path

PARAMETERS_FILE = Path("params.yaml")
RAW_FOLDER = Path("data/raw")  # what the user brings: meshes and photos
MODEL_FOLDER = Path("models/train")
TRAINING_STATE = Path("models/unfinished.pt")
REPORT_PAGE = Path("reports/index.html")
FIGURES_FOLDER = Path("reports/figures")
DATASET_CARD = Path("reports/dataset.md")
SUMMARY_FILE = Path("reports/summary.json")
PAIRS_TABLE = Path("reports/pairs.parquet")
CODE_FILE = Path("code.yaml")
UNFINISHED_FOLDER = Path("data/.unfinished")
LOGS_FOLDER = UNFINISHED_FOLDER / "logs"
TRACKING_FILE = Path("reports/tracking.json")
DURATIONS_FILE = Path("reports/durations.json")
TRACKING_DATABASE = Path("mlflow.db")
TRACKING_ARTIFACTS = Path("mlartifacts")

# Names of sources of grasps, see `records.sources`.
SYNTHESIZED = "synthesized"
LEARNED = "learned"
RECONSTRUCTED = "reconstructed"


def assets_folder(source: str) -> Path:
    """Folder of the meshes of one source that were taken out of a package."""
    return Path("data/assets") / source


def prepared_folder(object_name: str) -> Path:
    """Folder of one prepared object."""
    return Path("data/prepare") / object_name


# What became of every object that comes from a package; absent if there are none.
CATALOGUE_FILE = prepared_folder("catalogue.csv")


def candidates_file(style: str, object_name: str) -> Path:
    """Table of synthesized grasp candidates of one object in one style."""
    return Path("data/synthesize") / style / f"{object_name}.parquet"


def validated_file(style: str, object_name: str) -> Path:
    """Table of the same candidates with the verdicts of physics."""
    return Path("data/validate") / style / f"{object_name}.parquet"


def merged_file(first: str) -> Path:
    """Table of the two-object grasps of all pairs that begin with ``first``, which is pinched."""
    return Path("data/merge") / f"{first}.parquet"


def sampled_file(source: str, first: str) -> Path:
    """Table of the model's two-object grasps of all pairs that begin with ``first``, like :func:`merged_file`.

    ``source`` says what the model saw of the objects: ``learned`` (their surface), or ``reconstructed`` (what photos
    show of them; the frames are those of the reconstruction).
    """
    return Path("data/sample") / source / f"{first}.parquet"


def sample_quality_file(source: str) -> Path:
    """Statistics of the model's samples for every pair, by first and second object."""
    return Path("data/sample") / source / "quality.json"


def trials_file(source: str, first: str) -> Path:
    """Table of robot trials of all pairs that begin with ``first``; ``source`` is where the grasps came from."""
    return Path("data/evaluate") / source / f"{first}.parquet"


def series_file(series: str) -> Path:
    """Table of robot trials of a series, see ``records.series``: all pairs under one condition."""
    return Path("data/evaluate/conditions") / f"{series}.parquet"


def capture_folder(name: str) -> Path:
    """Folder of the photos of a rendered capture."""
    return Path("data/capture") / name


def reconstruction_folder(name: str) -> Path:
    """Folder of what was reconstructed from one capture."""
    return Path("data/reconstruct") / name


def items_file(stage: str) -> Path:
    """Fingerprints of the items that a stage's output holds, by key."""
    return Path("data/items") / f"{stage.replace('@', '-')}.json"


def failures_file(stage: str) -> Path:
    """Items that a stage could not compute when its command last ran, with reasons; absent if there were none."""
    return items_file(stage).with_suffix(".failures.csv")
