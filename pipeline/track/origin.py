"""Where a result comes from: git commit, whether files differ from it, platform and package versions."""

from __future__ import annotations

import os
import platform
import subprocess
from pathlib import Path

from pipeline.stages.versions import installed_versions

# A run rewrites these itself; they do not make its origin any less certain.
WRITTEN_BY_A_RUN = (":(exclude)dvc.lock", ":(exclude)reports")
# Set by `dvc exp run` for its stages: the name of the experiment, and the repository in which it was started.
EXPERIMENT_NAME, EXPERIMENT_ROOT = "DVC_EXP_NAME", "DVC_ROOT"


def _git(root: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def record_root(root: Path) -> Path:
    """Return the repository whose MLflow database is meant; `dvc exp run --temp` and `--queue` work in a copy of it."""
    started_in = Path(os.environ.get(EXPERIMENT_ROOT) or root)
    return started_in if os.environ.get(EXPERIMENT_NAME) and started_in.is_dir() else root


def run_name(key: str) -> str:
    """Return the name by which a person knows the result: that of the DVC experiment, or the beginning of its key."""
    return os.environ.get(EXPERIMENT_NAME) or key[:12]


def origin_tags(root: Path) -> dict[str, str]:
    """Return the tags of a parent run; without git its tags are left out."""
    tags = {"platform": platform.platform(), "cpu_count": str(os.cpu_count() or 0), "mlflow.source.name": "dvc repro"}
    tags |= {f"version.{package}": text for package, text in installed_versions().items()}
    if name := os.environ.get(EXPERIMENT_NAME):
        tags |= {"dvc.experiment": name, "mlflow.source.name": "dvc exp run"}
    commit = _git(root, "rev-parse", "HEAD")
    if commit:
        changes = _git(root, "status", "--porcelain", "--untracked-files=no", "--", ".", *WRITTEN_BY_A_RUN)
        tags |= {
            "git.commit": commit,
            "git.dirty": "unknown" if changes is None else str(bool(changes)).lower(),
            "mlflow.source.git.commit": commit,
        }
    return tags
