"""What the page says about reasons and parameters."""

import re
from html import unescape

from pipeline.records.parameters import read_parameters
from pipeline.records.validation_reasons import ValidationReason
from pipeline.report.meanings import VALIDATION, explained
from pipeline.report.settings import described, section_rows
from tools.scales import flatten


def test_gravity_directions_share_one_line_and_order_is_that_of_the_checks():
    html = explained(["table:drop", "gravity:-x", "gravity:+y", "unheard of"], VALIDATION)
    assert re.findall("<dt>(.*?)</dt>", html) == ["gravity:+y, gravity:-x", "table:drop"]
    assert unescape(re.findall("<dd>(.*?)</dd>", html)[0]) == ValidationReason.GRAVITY.meaning
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
