"""How texts that were written for the repository appear on the site."""

from pathlib import Path

import pytest
import yaml

from pipeline.records.parameters import Parameters
from tools.website import links, reference
from tools.website.docstrings import one_by_one, without_tags

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def project(tmp_path) -> Path:
    for name, content in {
        "README.md": b"",
        "NOTICE": b"Names <here>\n",
        "docs/a.md": b"",
        "docs/deep/b.md": b"",
        "conf/x.yaml": b"a: 1\n",
        "reports/card.md": b"",
        "reports/page.html": b"<p>",
        "reports/table.parquet": b"PAR1\xff\xfe",
    }.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return tmp_path


@pytest.mark.parametrize(
    ("link", "origin", "page", "expected"),
    [
        ("docs/a.md#top", "README.md", "index.md", "a.md#top"),
        ("docs/deep/b.md", "README.md", "index.md", "deep/b.md"),
        ("../README.md", "docs/a.md", "a.md", "index.md"),
        ("../a.md", "docs/deep/b.md", "deep/b.md", "../a.md"),
        ("../../conf/x.yaml", "docs/deep/b.md", "deep/b.md", "../repository/conf/x.yaml.md"),
        ("NOTICE", "README.md", "index.md", "repository/NOTICE.md"),
        ("conf", "README.md", "index.md", "repository/conf.md"),
        ("../docs/a.md", "reports/card.md", "repository/reports/card.md", "../../a.md"),
        ("reports/page.html", "README.md", "index.md", "repository/reports/page.html"),
        ("reports/table.parquet", "README.md", "index.md", "repository/reports/table.parquet"),
        ("docs/nowhere.md", "README.md", "index.md", "docs/nowhere.md"),  # the build complains
        ("https://dvc.org", "README.md", "index.md", "https://dvc.org"),
        ("#below", "README.md", "index.md", "#below"),
    ],
)
def test_links_lead_to_the_pages_of_the_site(project, link, origin, page, expected):
    assert links.rewritten(f"see [it]({link}).", origin, page, project) == f"see [it]({expected})."


def test_code_is_no_link(project):
    text = "`[a](docs/a.md)`\n\n```\n[a](docs/a.md)\n```\n"
    assert links.rewritten(text, "README.md", "index.md", project) == text
    assert links.targets(text, "README.md") == []


def test_a_text_file_becomes_a_page(project):
    assert links.listing(project / "NOTICE") == "# NOTICE\n\n~~~~text\nNames <here>\n~~~~\n"
    assert "~~~~yaml\na: 1\n" in links.listing(project / "conf/x.yaml")
    assert "x.yaml" in links.listing(project / "conf")


def test_parameters_explained_together_are_explained_one_by_one():
    text = "Args:\n    low, high: (3,), m,\n        of the box\n    third: x, y: z\n"
    assert one_by_one(text) == (
        "Args:\n    low: (3,), m,\n        of the box\n    high: (3,), m,\n        of the box\n    third: x, y: z\n"
    )


def test_names_in_angle_brackets_stay_text():
    assert without_tags("<object> but ``<object>``; 1 < 2") == "&lt;object> but ``<object>``; 1 < 2"
    assert without_tags("Layout::\n\n    a/<b>\n\nand <c>") == "Layout:\n\n    a/<b>\n\nand &lt;c>"


def test_every_parameter_of_the_composed_file_is_in_the_reference():
    text = reference.parameters(Parameters, ROOT)
    sections = dict(part.partition("\n")[::2] for part in text.split("## ")[1:])

    def check(value, path: list[str]) -> None:
        for name, below in value.items():
            if isinstance(below, dict) and ".".join([*path, name]) in sections:
                check(below, [*path, name])
            elif isinstance(below, dict) and ".".join([*path, name, "&lt;name>"]) in sections:
                for one in below.values():
                    check(one, [*path, name, "&lt;name>"])
            else:
                assert f"| `{name}` |" in sections[".".join(path) or "params.yaml"], [*path, name]

    check(yaml.safe_load((ROOT / "params.yaml").read_text()), [])
    assert "| `weight_distance` | number, ≥ 0 | `100.0` |" in text
    assert "| `iterations` | integer, ≥ 1, ≤ 100000 | `600` |" in sections["synthesize.pinch"]


def test_every_room_has_a_page_and_private_modules_have_none(tmp_path):
    for name in ("hand/__init__.py", "hand/__main__.py", "hand/_inner.py", "hand/arm.py", "hand/sub/__init__.py"):
        path = tmp_path / "pipeline" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text('"""First."""\n')
    assert reference.rooms(tmp_path) == {"pipeline.hand": ["pipeline.hand", "pipeline.hand.arm", "pipeline.hand.sub"]}
    assert reference.summary("pipeline.hand", tmp_path) == "First."


def test_all_commands_are_shown():
    text = reference.commands(ROOT)
    assert all(f"## ./dev {name}\n\n~~~~text\nUsage: ./dev {name}" in text for name in ("repro", "docs", "add-object"))
