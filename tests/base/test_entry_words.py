"""What is wrong with an entry is said in our own words, whatever pydantic calls it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml
from pydantic_core import core_schema

from fmu_didim.base.documents import load_yaml, validate
from fmu_didim.base.entry_words import WORDS, in_words
from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.planning.document import CampaignDocument
from fmu_didim.case.document import CaseDocument
from fmu_didim.dynamics.robot.description import RobotDescription
from fmu_didim.results.findings import load_findings
from fmu_didim.results.result import read_result

OF_PYDANTIC = re.compile(
    r"Input should|Unable to|valid (string|number|integer|boolean|list|tuple)|\[key\]|pydantic|validation err"
)
WRONG: list[Any] = [3, "a", "3,43", None, True, -1, 1e400, [], [1, "a"], {"a": "b"}, {43: None}, {"x": [{}]}]


def every_key(model: type[Any]) -> list[str]:
    return [info.alias or name for name, info in model.model_fields.items()]


@pytest.mark.parametrize("model", [CaseDocument, CampaignDocument, RobotDescription])
def test_no_word_of_pydantic_reaches_the_user(model: type[Any]) -> None:
    told = []
    for key in every_key(model):
        for value in WRONG:
            with pytest.raises(InputError) as caught:  # none of these documents is complete
                validate(model, {key: value}, where="x.yaml")
            told.append(str(caught.value))
    assert not [text for text in told if OF_PYDANTIC.search(text)]
    assert all("next:" in text for text in told)


def test_types_of_errors_are_those_of_pydantic_and_unknown_ones_have_words_too() -> None:
    known = set(get_args(core_schema.ErrorType))
    assert set(WORDS) <= known
    for kind in known - set(WORDS) - {"value_error", "assertion_error"}:
        assert "fit" in in_words({"type": kind, "loc": ("a",), "msg": "Input should be x", "input": 1})


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("plant: {parameters: {m: 3,43}}", "plant.parameters.43: a name is needed as key"),
        ("plant: {parameters: {m: '3,43'}}", "with a decimal point: 3.43"),
        ("loop: {rate_hz: abc}", "loop.rate_hz: a number is needed here (got 'abc')"),
        ("loop: {rate_hz: -1}", "loop.rate_hz: must be greater than 0 (got -1)"),
        ("plant: {substeps: 2.5}", "plant.substeps: a whole number is needed here (got 2.5)"),
        ("plant: {kind: foo}", "plant.kind: must be one of 'fmu', 'model' or 'control' (got 'foo')"),
    ],
)
def test_the_words_name_what_is_needed(text: str, told: str) -> None:
    with pytest.raises(InputError) as caught:
        validate(CaseDocument, yaml.safe_load(text), where="case.yaml")
    assert told in str(caught.value)
    if "43}" in text:
        assert "plant.parameters.43: a number" not in str(caught.value), "the value of a wrong key is no second problem"


@pytest.mark.parametrize("text", ["a: !!int ''", "a: !!float ''", "a: !!timestamp x", "a: !!bool x", "a: !!binary é"])
def test_a_tag_that_its_text_does_not_fit_is_invalid_yaml(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="not valid YAML") as caught:
        load_yaml(tmp_path / "a.yaml")
    assert "line 1" in str(caught.value)


@pytest.mark.parametrize("content", ["{", "[]", '{"schema_version": "x"}'])
def test_a_damaged_result_is_told_in_our_words(content: str, tmp_path: Path) -> None:
    readers: Mapping[str, Any] = {"result.json": read_result, "findings.json": load_findings}
    for name, read in readers.items():
        (tmp_path / name).write_text(content, encoding="utf-8")
        with pytest.raises(InputError) as caught:
            read(tmp_path)
        assert not OF_PYDANTIC.search(str(caught.value)), str(caught.value)
