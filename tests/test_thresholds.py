"""The tables of thresholds: each number has one home, a unit and a reason, and results record all of them."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest

from fmu_didim.discovery.all_thresholds import TABLES, all_thresholds
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.identification import provenance
from fmu_didim.identification import thresholds as identification
from fmu_didim.thresholds import Table, recorded

ROOT = Path(__file__).parent.parent / "fmu_didim"
MODULES = sorted(path for path in ROOT.rglob("thresholds.py") if path.parent != ROOT)
DECIDING = [
    *sorted((ROOT / "discovery").rglob("*.py")),
    *sorted((ROOT / "diagnosis").rglob("*.py")),
    *(ROOT / "prediction" / f"{n}.py" for n in ("noise", "repetition", "least_squares", "differences", "guard")),
    *(ROOT / "prediction" / f"{n}.py" for n in ("sensitivity", "base_projection", "weighting")),
    *(ROOT / "prediction" / f"{n}.py" for n in ("colour", "residual_noise", "uncertainty", "fit_uncertainty")),
]
MOTIONS = ("programs.py", "motions.py")
"""How proposed motions look is written where they are made."""
PLAIN = {0, 1, 2, 3, 0.5, 100, 1000}
"""Numbers of arithmetic: halves, indices, percent."""
ELSEWHERE = {
    ("noise.py", 1e-300), ("noise.py", 1e-12),  # nothing is divided by less
    ("feasibility.py", 4),  # rows of a pseudo-inertia
    ("units.py", 180), ("units.py", 0.001),  # degrees and millimetres
    ("findings.py", 500), ("black_box.py", 128), ("black_box.py", 256),  # lengths of texts and caches
    ("findings.py", 4),  # number of the schema
}  # fmt: skip


def test_a_table_hands_values_back_and_keeps_them() -> None:
    table = Table("box")
    assert (table("LEAST", 3, "samples", "Why."), table("RANGE", (0.1, 0.2), "s", "Why.")) == (3, (0.1, 0.2))
    assert [row.name for row in table] == ["box.least", "box.range"]
    assert recorded([table]) == {"box.least": 3, "box.range": [0.1, 0.2]}
    with pytest.raises(AssertionError, match="twice"):
        table("LEAST", 4, "samples", "Why.")


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.parent.name)
def test_each_constant_is_a_row_of_its_name(path: Path) -> None:
    module = importlib.import_module(".".join(path.relative_to(ROOT.parent).with_suffix("").parts))
    constants = {
        target.id: getattr(module, target.id)
        for line in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(line, ast.Assign)
        for target in line.targets
        if isinstance(target, ast.Name) and target.id != "TABLE"
    }
    rows = {row.name.split(".")[1].upper(): row for row in module.TABLE}
    assert {name: row.value for name, row in rows.items()} == constants
    assert all(row.unit and row.reason for row in rows.values())


def test_results_record_all_of_them() -> None:
    found = all_thresholds()
    assert len(found) == sum(len(list(table)) for table in TABLES) > 200
    assert found["selection.bic"] == 10.0
    assert found["prediction.kept_promise"] == [0.5, 1.5]
    assert found["statistics.confidence"] == 0.95
    own = recorded(provenance.TABLES).keys() - found.keys()
    assert own == recorded([identification.TABLE]).keys()


def test_the_values_that_options_take_by_default() -> None:
    wanted = Options(
        rounds=5, threshold=10.0, smallest_size=0.6, smallest_gain=0.2, smallest_share=0.05, smallest_part=0.03, seed=0
    )
    assert Options() == wanted


@pytest.mark.parametrize("path", DECIDING, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_no_other_number_decides(path: Path) -> None:
    """Every number is written down, or one of arithmetic, or the rank of a diagnostic."""
    if path.name in (*MOTIONS, "thresholds.py"):
        return
    tree = ast.parse(path.read_text(encoding="utf-8"))
    shown = {id(node) for text in ast.walk(tree) if isinstance(text, ast.JoinedStr) for node in ast.walk(text)}
    shown |= {id(of.value) for of in ast.walk(tree) if isinstance(of, ast.keyword) and of.arg == "rank"}
    found = {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and type(node.value) in (int, float) and id(node) not in shown
    }
    allowed = PLAIN | {value for name, value in ELSEWHERE if name == path.name}
    assert found - allowed <= ({1000} if path.stem == "black_box" else set())
