"""What docstrings say of keys, and that every key of every document is told of."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from fmu_didim.base.docstrings import about, entries, key_texts, section
from fmu_didim.campaigns.planning.document import CampaignDocument
from fmu_didim.case.document import CaseDocument
from fmu_didim.results.findings import findings_schema
from fmu_didim.results.result import result_schema
from fmu_didim.workflow.reference.schema import SCHEMAS
from tests.conftest import ROOT

SCHEMAS_OF_ALL: dict[str, Callable[[], dict[str, Any]]] = {
    **SCHEMAS,
    "campaign": CampaignDocument.model_json_schema,
    "result": result_schema,
    "findings": findings_schema,
}


class Base:
    """First line.

    More of it: not an entry.

    Attributes:
        one, two: what both are,
            on two lines; three: something; four is no name.
        Five: a text; with: a colon
            ``a: b``.

    Raises:
        ValueError: never.
    """


class Derived(Base):
    """Another.

    Attributes:
        three: said anew.
    """


def test_entries_of_a_docstring() -> None:
    known = ("one", "two", "three", "Five", "six")
    both = "what both are, on two lines."
    assert entries(Base, "Attributes", known) == {
        "one": both, "two": both, "three": "something; four is no name.", "Five": "a text; with: a colon ``a: b``.",
    }  # fmt: skip
    assert about(Base) == "First line.\n\nMore of it: not an entry."
    assert section(Base, "Raises") == "ValueError: never."
    assert section(Base, "Args") == ""


def test_the_nearest_class_says_it() -> None:
    assert key_texts(Derived, ("one", "three")) == {"one": "what both are, on two lines.", "three": "said anew."}
    assert about(type("Silent", (Base,), {})) == ""


def test_schema_tells_what_the_docstring_says() -> None:
    schema = CaseDocument.model_json_schema(by_alias=True)
    assert schema["properties"]["torque_std"]["description"].startswith("known standard deviation of the torque noise")
    assert schema["$defs"]["TorqueFile"]["properties"]["time"]["description"].startswith("name of the time column, or")
    assert "Attributes:" not in str(schema)


@pytest.mark.parametrize("name", SCHEMAS_OF_ALL)
def test_every_key_of_every_schema_has_its_line(name: str) -> None:
    """What is printed by ``fmu-didim schema``, and what result files hold."""
    silent = [place for place, entry in _keys(SCHEMAS_OF_ALL[name]()) if not str(entry.get("description", "")).strip()]
    assert not silent, f"no docstring says what these are: {', '.join(silent)}"


def _keys(node: Any, place: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every key of a schema with its place, those of parts and alternatives too."""
    if isinstance(node, dict):
        for key, entry in node.get("properties", {}).items():
            yield f"{place}.{key}", entry
        for key, inner in node.items():
            yield from _keys(inner, f"{place}/{key}")
    elif isinstance(node, list):
        for k, inner in enumerate(node):
            yield from _keys(inner, f"{place}/{k}")


@pytest.mark.parametrize("page", sorted((ROOT / "docs/reference").glob("*.md")), ids=lambda page: page.stem)
def test_no_row_of_the_reference_is_without_its_meaning(page: Path) -> None:
    heads: list[str] = []
    for line in page.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] if line.startswith("|") else []
        if cells and heads and not set(line) <= set("|-"):
            assert all(cell for head, cell in zip(heads, cells, strict=True) if head in TOLD), line
        heads = [] if not cells else heads or cells


TOLD = ("meaning", "what it is", "what it lists", "name", "key", "value", "option", "member", "argument", "effect")
"""Heads of columns that are never empty."""
