"""What the page says about reasons and parameters."""

from pipeline.records.parameters import read_parameters
from pipeline.records.validation_reasons import ValidationReason
from pipeline.report.meanings import VALIDATION, meaning_of
from pipeline.report.settings import described, section_rows
from tools.scales import flatten


def test_a_detail_after_a_colon_has_the_meaning_of_its_reason():
    assert (
        meaning_of("gravity:-x", VALIDATION) == meaning_of("gravity:+y", VALIDATION) == ValidationReason.GRAVITY.meaning
    )
    assert meaning_of("table:drop", VALIDATION) == ValidationReason.TABLE_DROP.meaning
    assert meaning_of("unheard of", VALIDATION) == ""


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
