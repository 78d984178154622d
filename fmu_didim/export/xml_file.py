"""What the XML files of both FMI versions have in common."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

_ILLEGAL = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def is_text(text: str) -> bool:
    """Has a text only characters that XML 1.0 can hold (its section 2.2)?"""
    return _ILLEGAL.search(text) is None


def document(root: ET.Element) -> str:
    """The text of a file, indented."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def stated(**attributes: str | None) -> dict[str, str]:
    """The attributes that hold a text."""
    return {name: text for name, text in attributes.items() if text}
