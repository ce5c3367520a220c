"""The audit of licences and vulnerabilities."""

from __future__ import annotations

import tomllib

import pytest

from tools import audit


@pytest.fixture(scope="module")
def policy(repository) -> dict:
    return tomllib.loads((repository / audit.POLICY).read_text())


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("MIT", True),
        ("BSD-3-Clause AND 0BSD AND MIT AND Zlib AND CC0-1.0", True),
        ("Apache-2.0 WITH LLVM-exception", True),
        ("Apache-2.0 OR GPL-2.0-or-later", True),
        ("MPL-2.0 AND (Apache-2.0 OR MIT)", True),
        ("Apache Software License; BSD License", True),
        ("MPL-2.0 AND (AGPL-3.0 OR GPL-3.0)", False),
        ("MIT AND GPL-3.0-only", False),
        ("MIT License; GNU General Public License v3 (GPLv3)", False),
        ("LGPL-2.1", False),
        ("CC-BY-NC-4.0", False),
        ("Proprietary", False),
        ("UNKNOWN", False),
        ("", False),
    ],
)
def test_every_part_and_one_alternative_must_be_permitted(policy, text, expected):
    assert audit.permitted(text, policy["permitted"]) is expected


def test_what_is_not_on_the_list_is_named(policy):
    (sentence,) = audit.refused_licences({"good": "MIT", "bad": "AGPL-3.0", "skops": "UNKNOWN"}, policy)
    assert sentence.startswith("bad has the licence 'AGPL-3.0'")


def test_all_that_is_installed_here_is_permitted(policy):
    found = audit.installed_licences()
    assert {"pytest", "pip-licenses", "numpy"} <= found.keys()
    assert audit.refused_licences(found, policy) == []


def vulnerability(name: str, fixed: list[str], *aliases: str) -> dict:
    item = {"id": name, "fix_versions": fixed, "aliases": list(aliases)}
    return {"dependencies": [{"name": "a", "version": "1", "vulns": [item]}, {"name": "b", "skip_reason": "none"}]}


def test_a_vulnerability_counts_when_there_is_a_fix_and_no_reason():
    (sentence,) = audit.vulnerable(vulnerability("PYSEC-1", ["2"], "CVE-1"), {"vulnerabilities": {}})
    assert "a 1 has PYSEC-1, fixed in 2" in sentence
    assert audit.vulnerable(vulnerability("PYSEC-1", []), {"vulnerabilities": {}}) == []
    excused = {"vulnerabilities": {"CVE-1": "not used"}}
    assert audit.vulnerable(vulnerability("PYSEC-1", ["2"], "CVE-1"), excused) == []


def test_no_answer_is_said_and_does_not_fail(repository, monkeypatch, capsys):
    monkeypatch.chdir(repository)
    monkeypatch.setattr(audit, "installed_licences", lambda: {"good": "MIT"})
    monkeypatch.setattr(audit, "reported_vulnerabilities", lambda: None)
    assert audit.main([]) == 0
    assert "not checked" in capsys.readouterr().out
    monkeypatch.setattr(audit, "reported_vulnerabilities", lambda: vulnerability("PYSEC-1", ["2"]))
    assert audit.main([]) == 1
    assert "PYSEC-1" in capsys.readouterr().err
