"""Keys that running text and tables of the documentation name, such as ``loop: {delay_s: 0.003}``, are those there are.

Each must be a part of a case, a robot, a controller or a campaign; ``...`` stands for anything.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from fmu_didim.campaigns.planning.document import CampaignDocument, Span
from fmu_didim.workflow.excitation.limits import MotionLimits
from fmu_didim.workflow.reference.schema import SCHEMAS
from tests.docs.test_blocks import BLOCK, GENERATED, PAGES

KEY = re.compile(r"[a-z_]\w*: ")
SIGNAL = re.compile(r"(q|dq|ddq|tau)\d")
ANY = "..."


def loose(node: Any) -> Any:
    """A schema by which keys may be missing, as they are in a part that is named alone."""
    if isinstance(node, dict):
        left = {
            key: loose(value) for key, value in node.items() if key not in ("required", "minItems", "minProperties")
        }
        return {"anyOf" if key == "oneOf" else key: value for key, value in left.items() if key != "discriminator"}
    return [loose(entry) for entry in node] if isinstance(node, list) else node


@cache
def parts() -> tuple[dict[str, Any], ...]:
    """Schemas of all objects that a user may write."""
    found = []
    of_campaigns = [model.model_json_schema() for model in (CampaignDocument, Span, MotionLimits)]
    for whole in (*(SCHEMAS[kind]() for kind in ("case", "robot", "controller")), *of_campaigns):
        schema = loose(whole)
        shared = schema.get("$defs", {})
        found += [{**part, "$defs": shared} for part in (schema, *shared.values(), *schema.get("anyOf", ()))]
    return tuple(part for part in found if "properties" in part)


def without_dots(node: Any) -> Any:
    if isinstance(node, dict):
        return {key: without_dots(value) for key, value in node.items() if value != ANY}
    if isinstance(node, date):  # a schema knows texts alone
        return node.isoformat()
    return [without_dots(entry) for entry in node if entry != ANY] if isinstance(node, list) else node


def is_known(content: dict[str, Any]) -> bool:
    if all(SIGNAL.fullmatch(key) for key in content):
        content = {"columns": content}
    able = [part for part in parts() if set(content) <= set(part["properties"])]
    return any(jsonschema.Draft202012Validator(part).is_valid(without_dots(content)) for part in able)


def named(page: Path) -> Iterator[str]:
    """Codes in the text of a page that look like keys."""
    for code in re.findall(r"`([^`\n]+)`", BLOCK.sub("", page.read_text(encoding="utf-8"))):
        if KEY.match(code):
            yield code


@pytest.mark.parametrize("page", [page for page in PAGES if page.parent.name != GENERATED], ids=lambda page: page.stem)
def test_keys_in_the_text_are_known(page: Path) -> None:
    wrong = [code for code in named(page) if not is_known(yaml.safe_load("{" + code + "}"))]
    assert not wrong


@pytest.mark.parametrize(
    ("text", "known"),
    [
        ("loop: {delay_s: 0.003}", True), ("loop: {delay: 0.003}", False), ("law: pd", True), ("law: pe", False),
        ("estimator: {kind: clie}", True), ("estimator: {kind: cle}", False), ("torque_std: [...]", True),
        ("q1: {name: x, zero: 3}", True), ("q1: {name: x, offset: 3}", False),
    ],
)  # fmt: skip
def test_what_is_no_key_is_told(text: str, known: bool) -> None:
    assert is_known(yaml.safe_load("{" + text + "}")) == known
