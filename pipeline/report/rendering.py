"""Templates of the report filled with values: every text is escaped, and nothing that is missing goes unnoticed."""

from __future__ import annotations

import base64
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from pipeline.report.wording import anchor, percent, spoken

TEMPLATES = Path(__file__).parent / "templates"


def render(template: str, **values: Any) -> Markup:
    """Return the HTML of a file of ``templates/``.

    Args:
        values: by the names that the template uses; strings are escaped, :class:`Markup` is taken as it is.
    """
    return Markup(environment(TEMPLATES).get_template(template).render(values))


@cache
def environment(templates: Path) -> Environment:
    """Return what fills the templates of a folder."""
    made = Environment(
        loader=FileSystemLoader(templates),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters |= {"percent": percent, "spoken": spoken, "anchor": anchor, "data_uri": data_uri}
    made.globals["verbatim"] = verbatim
    return made


def verbatim(name: str) -> Markup:
    """Return the text of a style sheet or script of ``templates/``."""
    return Markup((TEMPLATES / name).read_text(encoding="utf-8"))


def data_uri(picture: bytes) -> Markup:
    """Return a JPEG, a WebP or an mp4 as a data URI."""
    kind = "image/webp" if picture[8:12] == b"WEBP" else "video/mp4" if picture[4:8] == b"ftyp" else "image/jpeg"
    return Markup(f"data:{kind};base64,{base64.b64encode(picture).decode()}")
