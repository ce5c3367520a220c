"""Links of README.md and docs/ point to files of the repository; on the site they must point to pages."""

from __future__ import annotations

import html
import posixpath
import re
from pathlib import Path

DOCS = "docs/"
FRONT = "README.md"  # the site's index.md
OUTSIDE = "repository/"  # where the site keeps files that are not in docs/
LARGEST_LISTING = 100_000  # bytes; larger files are offered as they are
# Fenced blocks and spans of code match first, and are kept.
_CODE_OR_LINK = re.compile(r"^(```|~~~).*?^\1|`[^`\n]+`|(?<=\]\()(?P<target>[^)\s]+)(?=\))", re.MULTILINE | re.DOTALL)
_ELSEWHERE = re.compile(r"[a-z]+:|/|#", re.IGNORECASE)


def repository_file(target: str, origin: str) -> str | None:
    """Return the file, from the root, that ``target`` in the file ``origin`` names; None for an address elsewhere."""
    if _ELSEWHERE.match(target):
        return None
    return posixpath.normpath(posixpath.join(posixpath.dirname(origin), target.split("#")[0]))


def targets(markdown: str, origin: str) -> list[str]:
    """Return all files of the repository that a page links to, in the order of the page."""
    found = (repository_file(match["target"], origin) for match in _CODE_OR_LINK.finditer(markdown) if match["target"])
    return [file for file in found if file is not None]


def page_of(file: str, root: Path) -> str:
    """Return the page, or file, of the site that shows a file of the repository."""
    if file == FRONT:
        return "index.md"
    if file.startswith(DOCS):
        return file.removeprefix(DOCS)
    return OUTSIDE + (f"{file}.md" if listing(root / file) is not None else file)


def listing(path: Path) -> str | None:
    """Return a page that lists a folder, or a text file that is not a page itself; None for every other file."""
    if path.is_dir():
        text = "\n".join(sorted(entry.name for entry in path.iterdir() if not entry.name.startswith(".")))
    elif path.suffix in (".md", ".html", ".svg") or path.stat().st_size > LARGEST_LISTING:
        return None
    else:
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            return None
    language = path.suffix.removeprefix(".") if path.suffix in (".yaml", ".json", ".py", ".toml") else "text"
    return f"# {html.escape(path.name)}\n\n~~~~{language}\n{text.rstrip()}\n~~~~\n"


def rewritten(markdown: str, origin: str, page: str, root: Path) -> str:
    """Return the text of the file ``origin`` with links that work where the site shows it as ``page``.

    A broken link is kept as it is: the build reports it.
    """

    def replaced(match: re.Match[str]) -> str:
        target = match["target"]
        file = repository_file(target, origin) if target else None
        if file is None or not (root / file).exists():
            return match[0]
        _, mark, heading = target.partition("#")
        return posixpath.relpath(page_of(file, root), posixpath.dirname(page) or ".") + mark + heading

    return _CODE_OR_LINK.sub(replaced, markdown)
