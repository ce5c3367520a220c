"""What the page says about checks, reasons and parameters."""

import inspect
import re
from html import unescape

import pytest

from pipeline.records.parameters import read_parameters
from pipeline.report.meanings import GRAVITY, SYNTHESIS, VALIDATION, explained
from pipeline.report.settings import described, section_rows
from pipeline.synthesize import candidates
from pipeline.synthesize.scoring import first_failures
from pipeline.validate import table
from pipeline.validate.grasp_test import check_candidate
from tools.scales import flatten

NO_CHECKS = {"rejected_by", "early_rejection"}


def quoted(function) -> set[str]:
    """Names in double backticks of a docstring: where a stage lists its checks."""
    names = set(re.findall(r"``([^`]+)``", inspect.getdoc(function) or ""))
    return {re.sub(r"<.*>", "", name) for name in names - NO_CHECKS}


@pytest.mark.parametrize(
    ("function", "meanings"),
    [(check_candidate, VALIDATION)],
)
def test_every_check_that_a_stage_lists_is_explained_and_no_other(function, meanings):
    assert quoted(function) == set(meanings) - {table.NOT_TESTED}
    assert table.NOT_TESTED in VALIDATION


def test_every_check_of_the_synthesis_is_explained():
    checks = set(re.findall(r'^        "(\w+)": ~\(terms', inspect.getsource(first_failures), re.MULTILINE))
    assert "force_closure" in checks
    assert '"duplicate"' in inspect.getsource(candidates)
    assert checks | {"duplicate"} == set(SYNTHESIS)


def test_gravity_directions_share_one_line_and_order_is_that_of_the_checks():
    html = explained(["table:drop", "gravity:-x", "gravity:+y", "unheard of"], VALIDATION)
    assert re.findall("<dt>(.*?)</dt>", html) == ["gravity:+y, gravity:-x", "table:drop"]
    assert unescape(re.findall("<dd>(.*?)</dd>", html)[0]) == VALIDATION[GRAVITY]
    assert explained([], VALIDATION) == ""


def test_settings_are_all_stated_values_with_their_meaning(repository, monkeypatch):
    import yaml

    monkeypatch.chdir(repository)
    parameters, content = read_parameters(), yaml.safe_load((repository / "params.yaml").read_text())
    rows = [*described("synthesize", parameters.synthesize), *described("objects", parameters.objects)]
    wanted = flatten({name: content[name] for name in ("synthesize", "objects")})
    assert {name for name, _, _ in rows} == set(wanted)
    assert [name for name, _, meaning in rows if not meaning] == []
    values = {name: value for name, value, _ in rows}
    assert values["synthesize.pinch.mount_clearance"] == "null" and values["objects.plum.ycb"] == "018_plum"
    assert [(name, value) for name, value, _ in section_rows("meshes", {})] == [("meshes", "none")]
    (seed,) = section_rows("seed", 1)
    assert seed[:2] == ("seed", "1") and seed[2].startswith("Run seed")
