"""`./dev audit`: licences of all installed packages, and known vulnerabilities of the pinned ones.

Licences are read from the packages' own metadata. Each must be on the list below, or be an exception with a reason.

Vulnerabilities are asked of the OSV database by pip-audit. One for which a fixed version exists fails, unless it is an
exception with a reason. Without that service (no network) nothing can be said, which is said, and does not fail.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Mapping
from email.message import Message
from pathlib import Path
from typing import Any

CONSTRAINTS = Path("constraints.txt")
SECONDS = 40  # that pip-audit may take

# Beginnings of names of licences that let anybody use, change and pass on; MPL-2.0 asks for changes of its own files.
PERMITTED = re.compile(
    r"(mit|bsd|0bsd|[23]-clause bsd|new bsd|apache|isc|psf|python software foundation|python-2\.0|zlib|bsl-1\.0|boost|"
    r"cc0|zpl|zope|mpl[- ]2|mozilla public license 2|hpnd|historical permission|unlicense|public domain|the unlicense)"
)
# Packages whose metadata do not say, or say something else; looked up by hand in the licence file that each installs.
EXCEPTIONS = {
    "asyncssh": "EPL-2.0 OR GPL-2.0-or-later: used unchanged under EPL-2.0, by dvc-ssh alone",
    "cmeel-qhull": "Qhull's own licence, permissive",
    "grandalf": "GPL-2.0 OR EPL-1.0: used unchanged under EPL-1.0, by `dvc dag` alone",
    "huey": "MIT in its licence file",
    "mani-skill": "Apache-2.0 in its licence file; assets as in NOTICE",
    "pygit2": "GPL-2.0 with linking exception: allows unlimited linking, used unchanged by DVC",
    "skops": "MIT in its licence file",
}
# Identifiers of vulnerabilities that do not concern this project, each with the reason.
VULNERABILITIES: dict[str, str] = {}


def plain_name(name: str) -> str:
    """Return a package's name as the registry compares it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def licence(metadata: Message) -> str:
    """Return what a package's metadata say: the expression, or the classifiers, or the first line of the text."""
    if expression := metadata.get("License-Expression"):
        return str(expression)
    kinds = [str(line).split("::")[-1].strip() for line in metadata.get_all("Classifier") or [] if "License ::" in line]
    known = [kind for kind in kinds if kind != "OSI Approved"]
    text = [line.strip() for line in str(metadata.get("License") or "").splitlines() if line.strip()]
    return " AND ".join(known) or (text[0][:80] if text else "")


def permitted(expression: str) -> bool:
    """Return whether every part is on the list, of alternatives at least one."""
    text = re.sub(r"\bWITH LLVM-exception\b|^License :: ", "", expression.strip(), flags=re.IGNORECASE)
    while (inner := re.search(r"\(([^()]*\b(?:OR|AND)\b[^()]*)\)", text)) is not None:
        text = text.replace(inner[0], "MIT" if permitted(inner[1]) else "refused")
    return any(
        all(PERMITTED.match(part.strip().lower()) for part in re.split(r"\bAND\b|;", alternative))
        for alternative in re.split(r"\bOR\b", text)
    )


def refused_licences(found: Mapping[str, str]) -> list[str]:
    """Return a sentence for every package (name -> licence) that is neither permitted nor an exception."""
    return [
        f"{name} has the licence {text or '(none named)'!r}: read its licence file, then list it in "
        "tools/audit.py with a reason, or do without it."
        for name, text in sorted(found.items())
        if not permitted(text) and name not in EXCEPTIONS
    ]


def installed_licences() -> dict[str, str]:
    """Return name -> licence of everything installed, but this project."""
    distributions: Iterable[Any] = importlib.metadata.distributions()
    found = {plain_name(item.metadata["Name"]): licence(item.metadata) for item in distributions}
    return {name: text for name, text in found.items() if name != "sequential-grasping"}


def vulnerable(report: Mapping[str, Any]) -> list[str]:
    """Return a sentence for every vulnerability in pip-audit's report that has a fix and is no exception."""
    return [
        f"{package['name']} {package['version']} has {item['id']}, fixed in {', '.join(item['fix_versions'])}: raise "
        "it in constraints.txt, or list it in tools/audit.py with a reason."
        for package in report["dependencies"]
        for item in package.get("vulns", [])
        if item["fix_versions"] and not {item["id"], *item.get("aliases", [])} & VULNERABILITIES.keys()
    ]


def reported_vulnerabilities() -> dict[str, Any] | None:
    """Ask pip-audit about the pinned versions; None where no service answers."""
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


def main(arguments: list[str] | None = None) -> int:
    """Command line of this module."""
    parser = argparse.ArgumentParser(prog="./dev audit", description=__doc__)
    parser.add_argument("--list", action="store_true", help="print the licence of every package too")
    chosen = parser.parse_args(arguments)
    found = installed_licences()
    if chosen.list:
        for name, text in sorted(found.items()):
            print(f"{name}: {EXCEPTIONS.get(name, text)}")
    sentences = refused_licences(found)
    exceptions = sorted(EXCEPTIONS.keys() & found.keys())
    print(f"licences: {len(found)} packages, {len(exceptions)} of them exceptions ({', '.join(exceptions)})")
    report = reported_vulnerabilities()
    if report is None:
        print("vulnerabilities: not checked, as pip-audit gets no answer of the OSV database from here")
    else:
        sentences += vulnerable(report)
        counts = Counter(bool(package.get("vulns")) for package in report["dependencies"])
        print(f"vulnerabilities: {sum(counts.values())} packages, {counts[True]} with known ones")
    for sentence in sentences:
        print(f"audit: {sentence}", file=sys.stderr)
    return 1 if sentences else 0


if __name__ == "__main__":
    sys.exit(main())
