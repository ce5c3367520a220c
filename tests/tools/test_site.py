"""The built site: strict, whole, and at home without a network."""

import os
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

os.environ["NO_MKDOCS_2_WARNING"] = "1"  # a notice of the theme's makers

from mkdocs.commands.build import build
from mkdocs.config import load_config

from tools.website.hooks import made_pages

ROOT = Path(__file__).resolve().parents[2]


pytestmark = pytest.mark.slow  # the site is built once, in half a minute


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """What `./dev docs` builds. In this process, which has loaded most of it already; any warning raises."""
    folder = tmp_path_factory.mktemp("site")
    config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder))
    assert config.strict
    config.plugins.on_startup(command="build", dirty=False)
    build(config)
    config.plugins.on_shutdown()
    return folder


class Links(HTMLParser):
    """Every address in a page: where links lead, and what a browser loads by itself."""

    def __init__(self, text: str):
        super().__init__()
        self.led_to, self.loaded = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        addresses = [values[name] for name in ("href", "src", "srcset", "poster", "data") if values.get(name)]
        if tag in ("a", "link") and values.get("rel") != "stylesheet" and values.get("rel") != "icon":
            self.led_to += addresses
        else:
            self.loaded += addresses


def pages(site: Path) -> list[Path]:
    # 404.html is for web servers alone: its addresses begin at their root
    return [page for page in sorted(site.rglob("*.html")) if page.name != "404.html"]


def test_every_page_of_docs_and_of_the_code_is_there(site):
    wanted = {path.relative_to(ROOT / "docs").with_suffix(".html") for path in (ROOT / "docs").rglob("*.md")}
    wanted |= {Path(name).with_suffix(".html") for name in made_pages()} | {Path("index.html")}
    assert wanted <= {page.relative_to(site) for page in pages(site)}


def test_nothing_is_loaded_from_elsewhere_and_no_link_is_broken(site):
    for page in pages(site):
        links = Links(page.read_text())
        assert [address for address in links.loaded if urlsplit(address).scheme not in ("", "data")] == [], page
        for address in links.led_to + links.loaded:
            parts = urlsplit(address)
            if not parts.scheme and parts.path:
                assert (page.parent / unquote(parts.path)).exists(), f"{page.name} leads to {address}"
    for sheet in site.rglob("*.css"):
        assert re.findall(r"url\(['\"]?(?!data:|#)\w+:|@import", sheet.read_text()) == [], sheet


def test_the_front_page_is_the_readme_with_links_that_hold(site):
    text = (site / "index.html").read_text()
    assert 'href="departures.html"' in text and 'src="trial.gif"' in text
    assert 'href="repository/NOTICE.html"' in text and 'href="repository/reports/dataset.html"' in text


def test_the_reference_has_signatures_and_docstrings(site):
    text = re.sub(r"<[^>]+>", "", (site / "reference" / "pipeline.hand.html").read_text())
    assert "points_on_links" in text and "in their link frames" in text  # of a function
    assert "T_parent_link where the link has not moved" in text  # a comment on a field
    assert "_axis_rotations" not in text
    assert "mani_skill is not installed" in text  # Raises:


def test_the_search_knows_the_words(site):
    index = (site / "search" / "search_index.js").read_text()
    assert index.startswith("var __index = ") and "point_jacobian" in index
    assert "iframe-worker.js" in (site / "index.html").read_text()
