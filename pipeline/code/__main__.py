"""`python -m pipeline.code`: write `code.yaml`, one fingerprint of the code of every command in `dvc.yaml`.

With --check, write nothing, and refuse what such a fingerprint would not see.
"""

from __future__ import annotations

import argparse
import ast
import sys
from pathlib import Path
from typing import Any

from pipeline.code.unseen import unseen
from pipeline.provenance.closure import ROOT_PACKAGE
from pipeline.provenance.lines import code_lines
from pipeline.records import paths
from pipeline.records.errors import UserError
from pipeline.records.writing import whole_file
from pipeline.stages.running import command, run_stage

# The builder of the documentation, which no stage runs.
READS_DOCSTRINGS = Path("tools/website/reference.py")


def write_lines() -> None:
    """Write the fingerprints.

    Raises:
        UserError: see :func:`pipeline.provenance.lines.code_lines`.
    """
    lines = code_lines(Path())
    with whole_file(paths.CODE_FILE) as temporary:
        temporary.write_text(_text(lines))


def _text(lines: dict[str, Any], indent: str = "") -> str:
    """Return YAML whose values are quoted: digits alone, or with an e among them, would be a number to some readers."""
    return "".join(
        f"{indent}{name}:\n{_text(value, indent + '  ')}" if isinstance(value, dict) else f'{indent}{name}: "{value}"\n'
        for name, value in lines.items()
    )


def check() -> None:
    """Look for what the fingerprints would not see.

    Raises:
        UserError: there is some.
    """
    for file in sorted(Path(ROOT_PACKAGE).rglob("*.py")):
        for line, name in unseen(ast.parse(file.read_text())):
            if (file, name) == (READS_DOCSTRINGS, "__doc__"):
                continue
            raise UserError(
                f"{file}, line {line}: {name} is not seen by the fingerprints of code.yaml; write a plain import, or "
                "the text itself."
            )


@command("code")
def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.code", description=__doc__)
    parser.add_argument("--check", action="store_true", help="refuse dynamic imports in pipeline/; write nothing")
    if not parser.parse_args().check:
        return run_stage("code", write_lines)
    check()
    return 0


if __name__ == "__main__":
    sys.exit(main())
