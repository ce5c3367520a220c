"""Where every file of the pipeline lies, relative to the repository root (the working folder of a stage)."""

from __future__ import annotations

from pathlib import Path

PARAMETERS_FILE = Path("params.yaml")
MODEL_FOLDER = Path("models/train")
TRAINING_STATE = Path("models/unfinished.pt")
REPORT_PAGE = Path("reports/index.html")
FIGURES_FOLDER = Path("reports/figures")
DATASET_CARD = Path("reports/dataset.md")
SUMMARY_FILE = Path("reports/summary.json")
TRACKING_FILE = Path("reports/tracking.json")
DURATIONS_FILE = Path("reports/durations.json")
TRACKING_DATABASE = Path("mlflow.db")
TRACKING_ARTIFACTS = Path("mlartifacts")

# Where the grasps of trials come from.
SOURCES = ("synthesized", "learned")  # of all pairs
RECONSTRUCTED = "reconstructed"  # of the pairs under `reconstructed` in params.yaml


def prepared_folder(object_name: str) -> Path:
    """Folder of one prepared object."""
    return Path("data/prepare") / object_name


def candidates_file(style: str, object_name: str) -> Path:
    """Table of synthesized grasp candidates of one object in one style."""
    return Path("data/synthesize") / style / f"{object_name}.parquet"


def validated_file(style: str, object_name: str) -> Path:
    """Table of the same candidates with the verdicts of physics."""
    return Path("data/validate") / style / f"{object_name}.parquet"


def merged_folder(first: str) -> Path:
    """Folder of the two-object grasps of all pairs that begin with ``first``."""
    return Path("data/merge") / first


def merged_file(first: str, second: str) -> Path:
    """Table of two-object grasps of one pair: ``first`` is pinched, ``second`` is held by ring and palm."""
    return merged_folder(first) / f"{second}.parquet"


def sampled_folder(first: str) -> Path:
    """Folder of the learned two-object grasps of all pairs that begin with ``first``."""
    return Path("data/train") / first


def sampled_file(first: str, second: str) -> Path:
    """Table of learned two-object grasps of one pair, like :func:`merged_file`."""
    return sampled_folder(first) / f"{second}.parquet"


def reconstructed_folder(first: str) -> Path:
    """Folder of the learned grasps, conditioned on reconstructed objects, of all pairs that begin with ``first``."""
    return Path("data/train_reconstructed") / first


def reconstructed_file(first: str, second: str) -> Path:
    """Table of one such pair; the frames of its objects are those of the reconstruction."""
    return reconstructed_folder(first) / f"{second}.parquet"


def trials_file(source: str, first: str) -> Path:
    """Table of robot trials of all pairs that begin with ``first``; ``source`` is where the grasps came from."""
    return Path("data/evaluate") / source / f"{first}.parquet"


def harder_file(setting: str) -> Path:
    """Table of robot trials in a setting that is harder than the standard one."""
    return Path("data/evaluate/harder") / f"{setting}.parquet"


def capture_folder(name: str) -> Path:
    """Folder of the photos of a rendered capture."""
    return Path("data/capture") / name


def reconstruction_folder(name: str) -> Path:
    """Folder of what was reconstructed from one capture."""
    return Path("data/reconstruct") / name
