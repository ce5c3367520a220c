"""`./dev audit`: licences of all installed packages, and known vulnerabilities of the pinned ones.

pip-licenses reads the licences from the packages' metadata, and pip-audit asks the OSV database for vulnerabilities;
`tools/licences.toml` says which licences are permitted, and lists the exceptions of both kinds with their reasons. A
vulnerability fails the audit only when a fixed version exists. Without a network that part is skipped, which is said.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from license_expression import ExpressionError, Licensing

from pipeline.stages.running import command

CONSTRAINTS = Path("constraints.txt")
POLICY = Path("tools/licences.toml")
SECONDS = 40  # that pip-audit may take


def permitted(licences: str, names: Collection[str]) -> bool:
    """Return whether all ``licences``, separated by ``; ``, are permitted.

    Args:
        licences: names, or SPDX expressions: of alternatives (OR), one must be permitted.
        names: the permitted licences.
    """
    return all(licence in names or _holds(licence, names) for licence in licences.split("; "))


def _holds(expression: str, names: Collection[str]) -> bool:
    algebra = Licensing()
    try:
        parsed = algebra.parse(expression)
    except ExpressionError:
        return False
    if parsed is None:
        return False
    verdicts = {symbol: algebra.TRUE if str(symbol) in names else algebra.FALSE for symbol in parsed.symbols}
    return bool(parsed.subs(verdicts).simplify() == algebra.TRUE)


def installed_licences() -> dict[str, str]:
    """Return the licences of every installed package by its name, except this project; ``UNKNOWN`` for none named."""
    asked = ["--from", "mixed", "--format", "json", "--with-system", "--ignore-packages", "sequential-grasping"]
    done = subprocess.run([sys.executable, "-m", "piplicenses", *asked], capture_output=True, text=True, check=True)
    return {package["Name"]: package["License"] for package in json.loads(done.stdout)}


def refused_licences(found: Mapping[str, str], policy: Mapping[str, Any]) -> list[str]:
    """Return a sentence for every package (name -> licences) that is neither permitted nor an exception."""
    return [
        f"{name} has the licence {text[:80]!r}: read its licence file, then add it to {POLICY} with a reason, or do "
        "without the package."
        for name, text in sorted(found.items())
        if name not in policy["exceptions"] and not permitted(text, policy["permitted"])
    ]


def reported_vulnerabilities() -> dict[str, Any] | None:
    """Ask pip-audit about the pinned versions; None when the service does not answer."""
    asked = ["--requirement", str(CONSTRAINTS), "--no-deps", "--disable-pip", "--vulnerability-service", "osv"]
    form = ["--format", "json", "--progress-spinner", "off", "--timeout", "5"]
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pip_audit", *asked, *form],
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=SECONDS,
        )
        content = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, ValueError):
        return None
    return content if isinstance(content, dict) and "dependencies" in content else None


def vulnerable(report: Mapping[str, Any], policy: Mapping[str, Any]) -> list[str]:
    """Return a sentence for every vulnerability in pip-audit's report that has a fix and is no exception."""
    return [
        f"{package['name']} {package['version']} has {item['id']}, fixed in {', '.join(item['fix_versions'])}: raise "
        f"the version in constraints.txt, or add {item['id']} to {POLICY} with a reason."
        for package in report["dependencies"]
        for item in package.get("vulns", [])
        if item["fix_versions"] and not {item["id"], *item.get("aliases", [])} & policy["vulnerabilities"].keys()
    ]


@command("audit")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; exit code 1: something is neither permitted nor an exception."""
    parser = argparse.ArgumentParser(prog="./dev audit", description=__doc__)
    parser.add_argument("--list", action="store_true", help="also print the licence of every package")
    chosen = parser.parse_args(arguments)
    policy, found = tomllib.loads(POLICY.read_text()), installed_licences()
    if chosen.list:
        for name, text in sorted(found.items()):
            print(f"{name}: {policy['exceptions'].get(name, text)}")
    sentences = refused_licences(found, policy)
    exceptions = sorted(policy["exceptions"].keys() & found.keys())
    print(f"licences: {len(found)} packages, {len(exceptions)} of them exceptions ({', '.join(exceptions)})")
    report = reported_vulnerabilities()
    if report is None:
        print("vulnerabilities: not checked, because the OSV database does not answer")
    else:
        sentences += vulnerable(report, policy)
        counts = Counter(bool(package.get("vulns")) for package in report["dependencies"])
        print(f"vulnerabilities: {sum(counts.values())} packages, {counts[True]} with known ones")
    for sentence in sentences:
        print(f"audit: {sentence}", file=sys.stderr)
    return 1 if sentences else 0


if __name__ == "__main__":
    sys.exit(main())
