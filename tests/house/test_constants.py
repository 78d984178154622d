"""A number that decides has a name, a unit and a reason beside its decision, and results record the important ones."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import pytest

from fmu_didim.base.constants import recorded
from fmu_didim.discovery.constants import DECIDING as OF_DISCOVERY
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.results import provenance

ROOT = Path(__file__).parents[2] / "fmu_didim"
DECIDING = [
    *sorted((ROOT / "discovery").rglob("*.py")),
    *sorted((ROOT / "checks").rglob("*.py")),
    *(ROOT / "fit" / f"{n}.py" for n in ("uncertainty", "fit_uncertainty", "base_projection", "gap", "log_noise")),
    *sorted((ROOT / "fit" / "noise").glob("*.py")),
    *sorted((ROOT / "fit" / "derivatives").glob("*.py")),
    *(ROOT / "fit" / "solver" / f"{n}.py" for n in ("least_squares", "admissible")),
]
MOTIONS = ("programs.py", "motions.py")
"""How proposed motions look is written where they are made."""
PLAIN = {0, 1, 2, 3, 0.5, 100, 1000}
"""Numbers of arithmetic: halves, indices, percent."""
ELSEWHERE = {
    ("feasibility.py", 4),  # rows of a pseudo-inertia
    ("units.py", 180), ("units.py", 4),  ("units.py", 0.001),  # degrees and millimetres
    ("findings.py", 500), ("black_box.py", 128), ("black_box.py", 256),  # lengths of texts and caches
    ("findings.py", 4),  # number of the schema
}  # fmt: skip


ARITHMETIC = (ast.Constant, ast.Tuple, ast.UnaryOp, ast.BinOp, ast.Load, ast.USub, ast.operator, ast.Name)
"""What the value of a number consists of."""


def constants(path: Path) -> list[tuple[str, str]]:
    """Numbers with names in capitals at the top of a module, and what stands below each."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    found = []
    for line, below in zip(body, [*body, None][1:], strict=True):
        if not isinstance(line, ast.Assign) or not isinstance(line.targets[0], ast.Name):
            continue
        name = line.targets[0].id
        numbers = [n for n in ast.walk(line.value) if isinstance(n, ast.Constant) and type(n.value) in (int, float)]
        only = all(isinstance(n, ARITHMETIC) for n in ast.walk(line.value))
        if name.strip("_").isupper() and numbers and only:
            is_text = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
            found.append((name, str(below.value.value) if is_text else ""))  # type: ignore[union-attr]
    return found


@pytest.mark.parametrize("path", DECIDING, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_each_constant_says_its_unit_and_its_reason(path: Path) -> None:
    if path.name in MOTIONS:
        return
    assert [name for name, text in constants(path) if not re.match(r"\[[^\]]+\] \S", text)] == []


@pytest.mark.parametrize("deciding", [OF_DISCOVERY, provenance.DECIDING], ids=["discovery", "identification"])
def test_results_record_those_on_which_an_answer_depends(deciding: Any) -> None:
    found = recorded(deciding)
    assert len(found) == sum(len(names) for _, names in deciding) >= 50
    for module, names in deciding:
        assert set(names) <= {name for name, _ in constants(Path(module.__file__))}


def test_the_names_and_values_that_are_recorded() -> None:
    found = recorded(OF_DISCOVERY)
    assert found["discovery.selection.decide.bic"] == 10.0
    assert found["fit.solver.search.kept_promise"] == [0.5, 1.5]
    assert found["fit.statistics.confidence"] == 0.95


def test_the_values_that_options_take_by_default() -> None:
    wanted = Options(
        rounds=5, threshold=10.0, smallest_size=0.6, smallest_gain=0.2, smallest_share=0.05, smallest_part=0.03, seed=0
    )
    assert Options() == wanted


@pytest.mark.parametrize("path", DECIDING, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_no_other_number_decides(path: Path) -> None:
    """Every number is written down, or one of arithmetic, or the rank of a diagnostic."""
    if path.name in MOTIONS:
        return
    tree = ast.parse(path.read_text(encoding="utf-8"))
    named = {name for name, _ in constants(path)}
    tree.body = [
        line
        for line in tree.body
        if not (isinstance(line, ast.Assign) and isinstance(line.targets[0], ast.Name) and line.targets[0].id in named)
    ]
    shown = {id(node) for text in ast.walk(tree) if isinstance(text, ast.JoinedStr) for node in ast.walk(text)}
    shown |= {id(of.value) for of in ast.walk(tree) if isinstance(of, ast.keyword) and of.arg == "rank"}
    found = {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and type(node.value) in (int, float) and id(node) not in shown
    }
    allowed = PLAIN | {value for name, value in ELSEWHERE if name == path.name}
    assert found - allowed <= ({1000} if path.stem == "black_box" else set())
