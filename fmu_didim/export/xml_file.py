"""The parts of XML files that all FMI versions share."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

_ILLEGAL = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def is_text(text: str) -> bool:
    """Whether a text has only characters that XML 1.0 can hold (its section 2.2)."""
    return _ILLEGAL.search(text) is None


def document(root: ET.Element) -> str:
    """The text of a file, indented."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def add_defaults(root: ET.Element, sample_time: float | None) -> None:
    """Append the log categories and, of a sampled block, the experiment with its sample time (s)."""
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="Errors; they are always logged.")
    if sample_time is not None:
        ET.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(sample_time))


def stated(**attributes: str | None) -> dict[str, str]:
    """The attributes that hold a text."""
    return {name: text for name, text in attributes.items() if text}
