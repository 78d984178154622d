"""The glossary: its terms are defined once, and what it points to exists; the README and the first page lead to it."""

from __future__ import annotations

import re
import typing
from collections import Counter
from collections.abc import Iterator

import pytest

import fmu_didim
from fmu_didim.checks.judgement import Verdict
from fmu_didim.results.findings import FindingsDocument
from fmu_didim.results.result import ResultDocument
from tests.conftest import ROOT
from tests.docs.test_inline_keys import parts

PAGE = ROOT / "docs/glossary.md"
ROW = re.compile(r"^\| \*\*(.+?)\*\* \| (.+) \| (.+) \|$", re.M)
ROWS = [match.groups() for match in ROW.finditer(PAGE.read_text(encoding="utf-8"))]
TERMS = (
    "DIDIM", "Base parameters", "Regrouping", "Gap", "Residual", "Noise σ", "Held-out data, validation", "Verdict",
    "Effect", "Signature", "Ambiguous set", "Tick", "Substep", "Sampling kind", "CLIE", "IDIM-LS", "SSP",
    "FMI co-simulation", "FMI model exchange", "Coverage",
)  # fmt: skip
"""Terms that other pages use without a definition."""


def names(schema: typing.Any) -> Iterator[str]:
    """All keys of a JSON Schema's objects."""
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
        for value in schema.values():
            yield from names(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from names(value)


KEYS = {
    *(key for part in parts() for key in names(part)),
    *names(FindingsDocument.model_json_schema(by_alias=True)), *names(ResultDocument.model_json_schema(by_alias=True)),
}  # fmt: skip


def test_every_term_is_defined_once() -> None:
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| **")]
    assert len(rows) == len(ROWS), "a row that is not understood"
    assert Counter(term for term, _, _ in ROWS).most_common(1)[0][1] == 1
    assert set(TERMS) <= {term for term, _, _ in ROWS}


@pytest.mark.parametrize(("term", "meaning", "where"), ROWS, ids=[row[0] for row in ROWS])
def test_what_a_term_points_to_exists(term: str, meaning: str, where: str) -> None:
    links = re.findall(r"\]\(([^)]*)\)", where)
    keys = [name for name in re.findall(r"`([^`]*)`", where) if "{" not in name]  # those are in test_inline_keys.py
    assert links or keys
    for link in links:
        page, _, anchor = link.partition("#")
        text = (PAGE.parent / page).read_text(encoding="utf-8")
        heads = {
            re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in re.findall(r"^#+ (.*)$", text, re.M)
        }
        assert not anchor or anchor in heads, link
    for key in keys:
        home, _, name = key.rpartition(".")
        assert hasattr(fmu_didim, name) if home == "fmu_didim" else key in KEYS, key


def test_the_verdicts_are_those_that_there_are() -> None:
    (meaning,) = (meaning for term, meaning, _ in ROWS if term == "Verdict")
    assert re.findall(r"\*\*(.+?)\*\*", meaning) == [verdict.replace("_", " ") for verdict in typing.get_args(Verdict)]


@pytest.mark.parametrize(("page", "link"), [("README.md", "docs/glossary.md"), ("docs/index.md", "glossary.md")])
def test_it_is_found(page: str, link: str) -> None:
    assert f"({link})" in (ROOT / page).read_text(encoding="utf-8")
