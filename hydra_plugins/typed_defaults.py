"""Loaded by Hydra wherever it composes `conf/`, also within `dvc exp run -S`."""

from tools.typed_defaults import register

register()
