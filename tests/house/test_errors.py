"""Every error says what to do next, and every code that refuses or doubts does, too."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import fmu_didim.discovery
import fmu_didim.workflow  # with them, all codes are there
from fmu_didim.base.diagnostics import CATALOGUE, REMARK
from fmu_didim.base.errors import DivergedError, FmuDidimError, InputError, UnknownNameError

PACKAGE = Path(fmu_didim.__file__).parent


def empty_steps() -> Iterator[str]:
    """Places where an error is made whose next step may be empty."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or not getattr(node.func, "id", "").endswith("Error"):
                continue
            for keyword in node.keywords:
                texts = ast.walk(keyword.value) if keyword.arg == "next_step" else ()
                if any(isinstance(text, ast.Constant) and text.value == "" for text in texts):
                    yield f"{path.relative_to(PACKAGE)}:{node.lineno}"


@pytest.mark.parametrize("kind", [FmuDidimError, InputError])
def test_an_error_without_a_next_step_cannot_be_made(kind: type[FmuDidimError]) -> None:
    with pytest.raises(TypeError, match="next_step"):
        kind("It failed.")  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="next_step"):
        DivergedError("It failed.", time=0.0)  # type: ignore[call-arg]


def test_no_error_is_made_with_an_empty_next_step() -> None:
    assert not list(empty_steps())


@pytest.mark.parametrize(
    ("name", "valid", "step"),
    [("mas", ["mass"], "mass"), ("x", ["mass"], "valid names"), ("x", [], "none that could be named")],
)
def test_an_unknown_name_has_a_next_step_whether_one_is_near_or_not(name: str, valid: list[str], step: str) -> None:
    assert step in UnknownNameError("parameter", name, valid).next_step


def test_every_code_that_refuses_or_doubts_has_a_next_step() -> None:
    silent = [code.name for code in CATALOGUE if code.severity is not REMARK and not code.next_step.strip()]
    assert not silent
