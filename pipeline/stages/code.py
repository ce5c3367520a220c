"""Whether ``code.yaml`` describes the code that is about to run."""

from __future__ import annotations

from pathlib import Path

import yaml

from pipeline.provenance.lines import code_line
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.texts import parse_yaml


def own_fingerprint(line: str) -> str:
    """Return the fingerprint of the code of a command, made anew from the files of ``pipeline/``.

    Args:
        line: the one of ``code.yaml`` that the command's stage names in ``dvc.yaml``.

    Raises:
        UserError: ``code.yaml`` is missing, or says otherwise: results would be recorded as those of other code.
    """
    current = code_line(Path(), line)
    try:
        recorded = parse_yaml(paths.CODE_FILE.read_text())
    except (OSError, ValueError, yaml.YAMLError):
        recorded = None
    if not isinstance(recorded, dict) or recorded.get(line) != current:
        raise UserError(f"{paths.CODE_FILE} is older than pipeline/: run `dvc repro --force code` and then this again.")
    return current
