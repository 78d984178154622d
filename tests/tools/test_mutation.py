"""The mutation script: what it changes, and that its list of equivalent mutants is up to date."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.tools import mutation
from tests.tools.mutation import TESTS, chosen, known_equivalents, mutants


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        (
            "if a < 1:\n    b()\n",
            {"if (a <= 1):", "if (a > 1):", "if a < 2:", "if a < 0:", "b() -> pass", "if not a < 1: b()"},
        ),
        ("c = a * b + 0.5\n", {"c = (a * b - 0.5)", "c = (a / b) + 0.5", "c = a * b + 0.55", "c = a * b + 0.45"}),
        ("def f():\n    return not (a and b)\n", {"return None", "return (a and b)", "return not ((a or b))"}),
        ("x.y = True\n", {"pass", "x.y = False"}),
        ('"""A text."""\nimport a\nraise E(1, 2)\n', {"pass"}),
        ("c = f'{a + 1}' if a else b\n", {"c = (f'{a + 1}' if not a else b)"}),
    ],
)  # fmt: skip
def test_the_changes_of_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, wanted: set[str]) -> None:
    (tmp_path / "one.py").write_text(line, encoding="utf-8")
    monkeypatch.setattr(mutation, "PACKAGE", tmp_path)
    found = list(mutants("one.py"))
    assert all(ast.parse(m.source) for m in found)
    assert {m.after if m.before != "b()" else f"{m.before} -> {m.after}" for m in found} == wanted


@pytest.mark.parametrize(("module", "tests"), TESTS.items())
def test_what_is_mutated_and_its_tests_exist(module: str, tests: tuple[str, ...]) -> None:
    assert (mutation.PACKAGE / module).is_file()
    assert [name for name in tests if not (Path(__file__).parents[1] / name).is_file()] == []


def test_the_same_mutants_for_a_seed() -> None:
    one, again, other = (chosen(["fit/statistics.py"], 10, seed) for seed in (1, 1, 2))
    assert one == again != other and len(one) == 10


def test_equivalent_mutants_exist() -> None:
    every = {(m.file, m.before, m.after) for file in TESTS for m in mutants(file)}
    assert set(known_equivalents()) <= every
