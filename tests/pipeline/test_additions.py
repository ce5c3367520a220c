"""What a new check, a new source of grasps and a new stage take, in a copy of the project: no room is forgotten."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# By file: a text that stands there once, and the lines that come before it; all of a new file comes before nothing.
NEW_CHECK = {
    "pipeline/validate/checks.py": (
        "holds_in_gravities, is_reached,",
        "stands_low, ",
        "\n\n# In the order in which they are made.",
        '''

def stands_low(inspection: Inspection) -> Verdict:
    """Refuse what is higher than 1 mm."""
    height = float(inspection.prepared.extents[2])
    return {"height": height}, ValidationReason.TOO_HIGH if height > 0.001 else ""
''',
    ),
    "pipeline/records/validation_reasons.py": (
        "    SETTLING =",
        '    TOO_HIGH = "too_high", "the object is higher than a coin"\n',
    ),
    "pipeline/records/tables.py": (
        '        _column("settling_drift"',
        '        _column("height", pa.float64(), "m, of the object"),\n',
    ),
}
CHECKED = """
from pipeline.records.parameters.physics import PhysicsParameters
from pipeline.records.parameters.validate import ValidateParameters
from pipeline.report.meanings import VALIDATION, meaning_of
from pipeline.view.facts import grasp_facts
from pipeline.hand.support import PLANE
from tests.validate.test_validation import HAND, block_grasp, rows
from pipeline.validate.table import validate_table
from pipeline.records.tables import VALIDATED, read_table, write_table
from pathlib import Path

prepared, candidate = block_grasp()
candidates = rows(prepared, candidate, ["force_closure", ""])
found = validate_table(candidates, prepared, PhysicsParameters(), ValidateParameters(), 1, "test", PLANE, HAND)
write_table(Path("validated.parquet"), found, VALIDATED)
refused, tested = read_table(Path("validated.parquet"), VALIDATED, "test").to_dict("records")
assert refused["rejected_by"] == "force_closure" and refused["height"] != refused["height"]
assert tested["rejected_by"] == "too_high" and tested["height"] == prepared.extents[2]
assert tested["gravity_drift"] is None  # not reached
assert "higher than a coin" in meaning_of("too_high", VALIDATION)
assert "higher than a coin" in grasp_facts(tested) and f"{1e3 * tested['height']:.2f} mm" in grasp_facts(tested)
"""

NEW_SOURCE = {
    "pipeline/records/sources.py": (
        "        Source(\n            name=paths.RECONSTRUCTED",
        """        Source(
            name="guessed",
            title="guesses",
            origin="guessed",
            stage="guess",
            table=lambda first: Path("data/guess") / f"{first}.parquet",
            abbreviation="GG",
        ),
""",
    ),
    "dvc.yaml": (
        "      learned:\n        styles: styles\n        pairs: pairs\n        grasps:",
        """      guessed:
        styles: styles
        pairs: pairs
        grasps: data/guess
        frames: data/items/prepare.json
        truth: data/items/prepare.json
""",
    ),
}
KNOWN = """
from pathlib import Path

import numpy as np

from pipeline.evaluate.inputs import grasps_of as trial_grasps
from pipeline.evaluate.inputs import sections
from pipeline.hand.model import load_hand
from pipeline.records.flat import PAIR_GRASPS
from pipeline.records.parameters import read_parameters
from pipeline.records.series import series_of
from pipeline.evaluate.rerun import TrialName, trial_name
from pipeline.report.counting import firsts_of, grasps_of
from pipeline.report.wording import SOURCE_TITLES
from pipeline.share import GRASP_COLUMNS, load_grasps
from pipeline.view.rows import tidy_name, view_of
from pipeline.view.tables import MERGED_VIEW, known_tables
from tests.pipeline.declared import declared_stages
from tests.pairs import write_pairs
from tests.share.made_up import merged
from tools.published_tables import STANDARD

grasps = merged("cube", "soup_can", np.random.default_rng(1))
grasps["sweep_penetrations"] = 0
grasps["approach_length1"] = 0.1
for column in ("open_q0", "open_q1"):
    grasps[column] = grasps["q"]
for column in ("approach_direction0", "approach_direction1"):
    grasps[column] = [[0.0, 0.0, 1.0]] * len(grasps)
write_pairs(Path("data/guess/cube.parquet"), grasps, PAIR_GRASPS)

parameters, hand = read_parameters(), load_hand("allegro")
settings = {"picks": parameters.picks, "evaluate": parameters.evaluate}
assert len(trial_grasps("guessed", ("cube", "soup_can"), settings, hand)) == 4
assert series_of("guessed-mu_0_5-sapien").source == "guessed"
assert trial_name("guessed/cube/soup_can/3") == TrialName("guessed", ("cube", "soup_can"), 3)
assert "`guessed` (guessed)" in GRASP_COLUMNS["source"]
shared = load_grasps(source="guessed", first="cube", second="soup_can")
assert shared["source"].tolist() == ["guessed"] * 4
tables = {table.name: table for table in known_tables(parameters, hand)}
assert tables["guess/cube"].stage == "guess" and tables["evaluate/guessed/cube"].stage == "evaluate@guessed"
assert view_of("guess/cube/soup_can/3") == MERGED_VIEW
assert tidy_name("guessed/cube/soup_can/3") == "evaluate/guessed/cube/soup_can/3"
assert ("guessed", "cube") in {(item.source, item.first) for item in firsts_of({"cube": ["soup_can"]}, {})}
assert grasps_of("guessed", "cube")[0] == Path("data/guess/cube.parquet")
assert SOURCE_TITLES["guessed"] == "guesses" and STANDARD["guessed"] == "GG"
(stage,) = (stage for stage in declared_stages(Path()) if stage.name == "evaluate@guessed")
assert set(stage.parameters) == set(sections("guessed")) and "data/guess" in stage.dependencies
"""

NEW_STAGE = {
    "pipeline/weigh/__init__.py": ("", '"""Stage weigh: what the objects weigh."""\n'),
    "pipeline/weigh/__main__.py": (
        "",
        '''"""Write the mass of every object: ``data/weigh/masses.json``."""

import sys
from pathlib import Path

from pipeline.records.objects import load_prepared_object
from pipeline.records.parameters import load_parameters
from pipeline.records.writing import write_json
from pipeline.stages.running import run_stage


def sections() -> list[str]:
    """Return the sections of ``params.yaml`` that the stage depends on."""
    return ["objects"]


def weigh() -> None:
    """Weigh all objects."""
    names = load_parameters(sections())["objects"]
    write_json(Path("data/weigh/masses.json"), {name: load_prepared_object(name).mass for name in names})


if __name__ == "__main__":
    sys.exit(run_stage("weigh", weigh))
''',
    ),
    "dvc.yaml": (
        "  synthesize:\n",
        """  weigh:
    desc: What the objects weigh
    cmd: python -m pipeline.weigh
    deps: [data/items/prepare.json]
    params:
      - code.yaml:
          - weigh
          - settings.objects
    outs: [data/weigh]

""",
    ),
}
WEIGHED = """
import json
import subprocess
import sys
from pathlib import Path

from pipeline.provenance.lines import code_lines
from pipeline.records.parameters import read_parameters
from tests.pipeline.declared import declared_stages

(stage,) = (stage for stage in declared_stages(Path()) if stage.name == "weigh")
assert stage.parameters == ("objects",) and stage.outputs == ("data/weigh",)
before = code_lines(Path())
own = Path("pipeline/weigh/__main__.py")
own.write_text(own.read_text().replace('.mass for', '.mass * 1000 for'))
after = code_lines(Path())
assert {name for name in before if before[name] != after[name]} == {"weigh"}
refused = subprocess.run([sys.executable, "-m", "pipeline.weigh"], capture_output=True, text=True)
assert refused.returncode == 2 and len(refused.stderr.splitlines()) == 1  # nothing is prepared here
assert not Path("data/weigh").exists()
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("additions", "script", "most"), [(NEW_CHECK, CHECKED, 3), (NEW_SOURCE, KNOWN, 2), (NEW_STAGE, WEIGHED, 4)]
)
def test_an_addition_takes_few_places(tmp_path: Path, additions, script: str, most: int) -> None:
    assert len(additions) <= most
    shutil.copytree(ROOT / "pipeline", tmp_path / "pipeline", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "dvc.yaml", tmp_path)
    for name in ("hands", "tests", "tools", "params.yaml", "constraints.txt"):
        (tmp_path / name).symlink_to(ROOT / name)
    for name, (*texts,) in additions.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        content = (tmp_path / name).read_text() if (tmp_path / name).exists() else ""
        for place, lines in zip(texts[::2], texts[1::2], strict=True):
            assert content.count(place) == 1, (name, place)
            content = content.replace(place, lines + place)
        (tmp_path / name).write_text(content)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
