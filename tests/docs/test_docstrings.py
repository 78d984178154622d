"""What docstrings say of keys, and that every key of every document is told of."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import BaseModel

from fmu_didim.case.document import CaseDocument
from fmu_didim.controllers import LAWS
from fmu_didim.discovery.findings import FindingsDocument
from fmu_didim.docstrings import about, entries, key_texts, section
from fmu_didim.identification.result import ResultDocument
from fmu_didim.robot import RobotDescription

DOCUMENTS: tuple[type[BaseModel], ...] = (
    CaseDocument, RobotDescription, *LAWS.values(), ResultDocument, FindingsDocument,
)  # fmt: skip


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


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda d: d.__name__)
def test_every_key_of_every_document_is_told_of(document: type[BaseModel]) -> None:
    schema: dict[str, Any] = document.model_json_schema(by_alias=True)
    parts = {document.__name__: schema, **schema.get("$defs", {})}
    silent = [
        f"{name}.{key}"
        for name, part in parts.items()
        for key, content in part.get("properties", {}).items()
        if not content.get("description")
    ]
    assert not silent, f"no docstring says what these are: {', '.join(silent)}"
