"""How the reference reads docstrings: an extension of griffe, which parses the code without running it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import griffe

# An entry of ``Args:`` for several parameters at once: "    firsts, seconds: ...".
_SEVERAL = re.compile(r"^(?P<indent> +)(?P<names>\w+(?:, \w+)+): (?P<text>.*(?:\n(?P=indent) +\S.*)*)", re.MULTILINE)
# A literal block, a span of code, or what a browser would take for a tag.
_CODE_OR_TAG = re.compile(r":(?P<block>:\n\n(?: {4}.*\n?|\n)+)|(?P<code>`+)(?:.|\n)+?(?P=code)|<(?=[\w/])")


def one_by_one(docstring: str) -> str:
    """Return the docstring with an entry for each of several parameters that are explained together."""

    def repeated(match: re.Match[str]) -> str:
        return "\n".join(f"{match['indent']}{name}: {match['text']}" for name in match["names"].split(", "))

    return _SEVERAL.sub(repeated, docstring)


def without_tags(docstring: str) -> str:
    """Return the docstring with names such as <object> outside code kept as text, and ``:`` for ``::``."""
    return _CODE_OR_TAG.sub(lambda match: match["block"] or ("&lt;" if match[0] == "<" else match[0]), docstring)


def comment_on(attribute: griffe.Attribute) -> str:
    """Return what a comment right above, or at the end of the line, says of a constant or field; '' without one."""
    if attribute.lineno is None or not isinstance(attribute.filepath, Path):
        return ""
    lines = attribute.lines_collection[attribute.filepath]
    _, _, trailing = lines[attribute.lineno - 1].partition("  # ")
    above: list[str] = []
    for line in reversed(lines[: attribute.lineno - 1]):
        if not re.match(r" *# (?!noqa|type:)", line):
            break
        above.insert(0, line.strip().removeprefix("# "))
    return " ".join([*above, trailing]).strip()


class Docstrings(griffe.Extension):
    """Prepare every docstring before it is parsed."""

    def on_instance(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrite the docstring of a module, class, function or attribute."""
        if obj.docstring:
            obj.docstring.value = one_by_one(without_tags(obj.docstring.value))

    def on_attribute_instance(self, *, attr: griffe.Attribute, **kwargs: Any) -> None:
        """Take the comment on a constant for its docstring, and show a value with comments inside as written."""
        if attr.docstring or not attr.parent or not attr.parent.is_module:
            return
        text = without_tags(comment_on(attr))
        value = attr.source
        if value.count("\n") and "  # " in value:
            text += f"\n\n~~~~python\n{value}\n~~~~"
            attr.value = None
        if text:
            attr.docstring = griffe.Docstring(text, lineno=attr.lineno, endlineno=attr.endlineno, parent=attr)

    def on_class_members(self, *, cls: griffe.Class, **kwargs: Any) -> None:
        """Add the fields of a class to its docstring, with the comments on them."""
        comments = {name: comment_on(field) for name, field in cls.attributes.items() if not name.startswith("_")}
        fields = [f"    {name}: {without_tags(text)}" for name, text in comments.items() if text]
        if cls.docstring and fields and "\nAttributes:\n" not in cls.docstring.value:
            cls.docstring.value += "\n\nAttributes:\n" + "\n".join(fields)
