"""Hooks that mkdocs calls while it builds the site; ``mkdocs.yml`` names this file."""

from __future__ import annotations

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from pipeline.records.parameters import Parameters
from tools.website import links, over_time, reference

ROOT = Path(__file__).resolve().parents[2]
ASSETS = ("iframe-worker.js", "website.css", "favicon.svg")


def made_pages() -> dict[str, str]:
    """Return the text of every page that is generated from the code or from figures, by its name."""
    pages = {
        "history.md": over_time.page(ROOT),
        "reference/index.md": reference.index(ROOT),
        "reference/commands.md": reference.commands(ROOT),
        "reference/parameters.md": reference.parameters(Parameters, ROOT),
    }
    rooms = reference.rooms(ROOT)
    return pages | {f"reference/{room}.md": reference.room_page(room, modules) for room, modules in rooms.items()}


def linked_outside(origins: list[str]) -> dict[str, str]:
    """Return files outside docs/ that pages link to, and those that these link to, by their names on the site."""
    found: dict[str, str] = {}
    waiting = list(origins)
    while waiting:
        origin = waiting.pop()
        for target in links.targets((ROOT / origin).read_text(), origin):
            page = links.page_of(target, ROOT) if (ROOT / target).exists() else ""
            if page.startswith(links.OUTSIDE) and page not in found:
                found[page] = target
                waiting += [target] if target.endswith(".md") else []
    return found


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the front page, the reference, the site's own assets, and what pages link to outside docs/."""
    origins = [links.FRONT, *(links.DOCS + file.src_uri for file in files.documentation_pages() if written(file))]
    files.append(File.generated(config, "index.md", content=(ROOT / links.FRONT).read_text()))
    for name, text in made_pages().items():
        files.append(File.generated(config, name, content=text))
    files.append(File.generated(config, over_time.PLOT, content=over_time.plot(ROOT)))
    for name in ASSETS:
        files.append(File.generated(config, f"assets/{name}", abs_src_path=str(Path(__file__).with_name(name))))
    for page, target in linked_outside(origins).items():
        listing = links.listing(ROOT / target)
        if listing is None:
            files.append(File.generated(config, page, abs_src_path=str(ROOT / target)))
        else:
            files.append(File.generated(config, page, content=listing))
    return files


def written(file: File) -> bool:
    """Whether a page is one of docs/, not a generated one."""
    return file.generated_by is None


def origin_of(file: File) -> str | None:
    """Return the file of the repository whose text a page shows; None for a generated page."""
    if written(file):
        return links.DOCS + file.src_uri
    if file.src_uri == "index.md":
        return links.FRONT
    outside = file.src_uri.removeprefix(links.OUTSIDE)
    return outside if outside != file.src_uri and (ROOT / outside).is_file() else None


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Rewrite the links of a page whose text was written for the repository."""
    origin = origin_of(page.file)
    return markdown if origin is None else links.rewritten(markdown, origin, page.file.src_uri, ROOT)


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let long names in tables break after a dot, slash or underscore."""
    return re.sub(
        r"(?<=<td><code>)[^<\s]{24,}(?=</code>)", lambda name: re.sub(r"(?<=[._/])(?=\w|&)", "<wbr>", name[0]), content
    )
