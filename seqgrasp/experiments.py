"""Two results side by side."""

from __future__ import annotations

import os
from typing import Any

import pandas as pd

from pipeline.records import paths
from pipeline.records.errors import UserError


def compare_experiments(
    before: str, after: str | None = None, repository: str | os.PathLike[str] = "."
) -> pd.DataFrame:
    """Return the parameters and metrics in which two results differ, one per row.

    Args:
        before: a commit, branch, tag, or the name of an experiment (`dvc exp list`).
        after: likewise; the files as they are when left out.
        repository: a clone, or the address of a git repository.

    Returns:
        Columns ``before`` and ``after``; the index is ``kind`` (``parameter`` or ``metric``) and ``name``.

    Raises:
        UserError: one of the two does not exist, or holds no result.
    """
    old, new = (_figures(os.fspath(repository), rev) for rev in (before, after))
    names = [name for name in {**old, **new} if old.get(name) != new.get(name)]
    index = pd.MultiIndex.from_tuples(names, names=["kind", "name"]) if names else None
    values = {"before": [old.get(name) for name in names], "after": [new.get(name) for name in names]}
    return pd.DataFrame(values, index=index, dtype=object)


def _figures(repository: str, rev: str | None) -> dict[tuple[str, str], Any]:
    from dvc.api import metrics_show, params_show
    from dvc.exceptions import DvcException

    try:
        parameters = params_show(str(paths.PARAMETERS_FILE), repo=repository, rev=rev)
        metrics = metrics_show(str(paths.SUMMARY_FILE), repo=repository, rev=rev)
    except (DvcException, FileNotFoundError) as error:
        raise UserError(
            f"{rev or 'the working folder'} of {repository} holds no result ({' '.join(str(error).split())}); name a "
            "commit that has one, or an experiment that `dvc exp list` shows."
        ) from error
    flat = pd.json_normalize(parameters).iloc[0].to_dict()
    return {("parameter", name): value for name, value in flat.items()} | {
        ("metric", name): value for name, value in metrics.items()
    }
