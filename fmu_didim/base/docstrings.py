"""Descriptions of keys, attributes and arguments from docstrings, for schemas and the reference."""

from __future__ import annotations

import inspect
import re
from collections.abc import Collection

SECTIONS = ("Attributes", "Args", "Returns", "Raises")
_HEAD = re.compile(rf"^({'|'.join(SECTIONS)}):$", re.MULTILINE)
_ENTRY = re.compile(r"((?:\*{0,2}\w+)(?:, \*{0,2}\w+)*): +(?=\S)")


def about(documented: object) -> str:
    """The text of a docstring before its first section, empty without one of its own."""
    return _HEAD.split(_own(documented))[0].strip()


def section(documented: object, name: str) -> str:
    """The text of a section, indentation removed; empty if there is none."""
    parts = _HEAD.split(_own(documented))
    found = dict(zip(parts[1::2], parts[2::2], strict=True))
    return inspect.cleandoc(found.get(name, ""))


def entries(documented: object, name: str, known: Collection[str]) -> dict[str, str]:
    """Each known name of a section -> its description.

    Entries are ``name: text`` or ``one, another: text`` at the start of a line, or after a semicolon.
    """
    found: dict[str, str] = {}
    for paragraph in re.split(r"\n(?=\S)", section(documented, name)):
        text = " ".join(paragraph.split())
        for part in _divided(text, known):
            match = _ENTRY.match(part)
            if match is not None:
                found |= {key: part[match.end() :].rstrip(";. ") + "." for key in _names(match) if key in known}
    return found


def key_texts(documented: type, known: Collection[str]) -> dict[str, str]:
    """Attribute -> description, by a class and its base classes; the nearest class counts."""
    found: dict[str, str] = {}
    for base in reversed(documented.__mro__):
        found |= entries(base, "Attributes", known)
    return found


def _own(documented: object) -> str:
    """Its docstring, never that of a class it is derived from."""
    text = vars(documented).get("__doc__") if isinstance(documented, type) else inspect.getdoc(documented)
    return inspect.cleandoc(text or "")


def _names(match: re.Match[str]) -> list[str]:
    return match[1].replace("*", "").split(", ")


def _divided(text: str, known: Collection[str]) -> list[str]:
    """A text cut where a semicolon ends the text of one name and another known name follows."""
    cuts = [m.end() for m in re.finditer(r"; ", text) if (n := _ENTRY.match(text, m.end())) and _names(n)[0] in known]
    return [text[begin:end] for begin, end in zip([0, *cuts], [*cuts, len(text)], strict=True)]
