"""How many small changes of the deciding code the fast tests notice.

    python -m tests.tools.mutation --count 200 --seed 0

Each mutant is one change of one place: another comparison, operator or constant, a negated condition, a dropped
statement, a lost return value. It is made in a temporary copy of the package, and the tests that belong to its file run
there until the first of them fails. Mutants that change nothing that matters are listed with the reason in
``mutation_equivalent.yaml``, by their line before and after; they count neither as killed nor as survived.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "fmu_didim"
EQUIVALENT = Path(__file__).with_name("mutation_equivalent.yaml")
TESTS: dict[str, tuple[str, ...]] = {
    "fit/gap.py": ("fit/test_gap_decisions.py", "discovery/selection/test_decide.py"),
    "discovery/selection/decide.py": ("discovery/selection/test_decide.py",),
    "discovery/selection/rounds.py": ("discovery/selection/test_rounds_by_hand.py",),
    "discovery/selection/competition.py": ("discovery/selection/test_competition.py",),
    "discovery/selection/pre_check.py": ("discovery/selection/test_pre_check_decisions.py",),
    "fit/solver/least_squares.py": ("fit/test_solver_decisions.py", "fit/test_numerical_noise.py"),
    "fit/solver/linear_step.py": ("fit/test_solver_decisions.py", "fit/test_numerical_noise.py"),
    "fit/solver/search.py": ("fit/test_solver_decisions.py", "fit/test_numerical_noise.py"),
    "fit/solver/termination.py": ("fit/test_solver_decisions.py", "fit/test_numerical_noise.py"),
    "fit/linear_problem.py": ("fit/test_solver_decisions.py", "fit/test_region.py"),
    "fit/derivatives/sensitivity.py": ("fit/test_sensitivity_ways.py", "fit/test_differences.py"),
    "cosim/sampling.py": ("cosim/test_sampling_edges.py", "cosim/test_sampling.py"),
    "fit/statistics.py": ("fit/test_statistics_edges.py", "fit/test_statistics.py"),
}
"""File of the package -> its fast tests, from the folder of tests on."""
PATIENCE = 5.0
"""[1] Times what the unchanged tests take: after it, a mutant counts as noticed, being a loop that no longer ends."""

Comparisons = {
    ast.Lt: (ast.LtE, ast.Gt), ast.LtE: (ast.Lt, ast.GtE), ast.Gt: (ast.GtE, ast.Lt), ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}  # fmt: skip
Operators = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change of one place.

    Attributes:
        file: from the package on; line: where; before, after: the text that is replaced, and by what.
        source: of the whole file with the change.
    """

    file: str
    line: int
    before: str
    after: str
    source: str


def mutants(file: str) -> Iterator[Mutant]:
    """All mutants of a file."""
    source = (PACKAGE / file).read_text(encoding="utf-8")
    lines = [line.encode() for line in source.splitlines(keepends=True)]
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    whole, tree = source.encode(), ast.parse(source)
    for node in _places(tree):
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[(node.end_lineno or node.lineno) - 1] + (node.end_col_offset or 0)
        for text in _changes(node):
            changed = (whole[:begin] + text.encode() + whole[end:]).decode()
            before = "".join(source.splitlines(keepends=True)[node.lineno - 1 : node.end_lineno])
            width = len(changed.splitlines()) - len(source.splitlines())
            after = "".join(changed.splitlines(keepends=True)[node.lineno - 1 : (node.end_lineno or 0) + width])
            yield Mutant(file, node.lineno, _stripped(before), _stripped(after), changed)


def _stripped(text: str) -> str:
    return " ".join(text.split())


def _places(tree: ast.Module) -> Iterator[ast.stmt | ast.expr]:
    """Statements and expressions that run: no annotations, imports, docstrings, texts or error messages."""
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        node = waiting.pop(0)
        if isinstance(node, ast.Import | ast.ImportFrom | ast.JoinedStr):
            continue
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue
        if isinstance(node, ast.stmt | ast.expr):
            yield node
        if isinstance(node, ast.Raise):
            continue
        for name, value in ast.iter_fields(node):
            if name not in ("annotation", "returns", "decorator_list", "bases"):
                waiting += [v for v in (value if isinstance(value, list) else [value]) if isinstance(v, ast.AST)]


def _changes(node: ast.stmt | ast.expr) -> Iterator[str]:
    """Texts by which a node may be replaced."""
    if isinstance(node, ast.Compare):
        for i, operator in enumerate(node.ops):
            for other in Comparisons[type(operator)]:
                changed = copy.deepcopy(node)
                changed.ops[i] = other()
                yield f"({ast.unparse(changed)})"
    elif isinstance(node, ast.BinOp) and type(node.op) in Operators:
        yield f"({ast.unparse(ast.BinOp(node.left, Operators[type(node.op)](), node.right))})"
    elif isinstance(node, ast.BoolOp):
        other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        yield f"({ast.unparse(ast.BoolOp(other, node.values))})"
    elif isinstance(node, ast.UnaryOp):
        if isinstance(node.op, ast.Not | ast.USub):
            yield f"({ast.unparse(node.operand)})"
    elif isinstance(node, ast.Constant):
        yield from _other_constants(node.value)
    elif isinstance(node, ast.IfExp):
        yield f"({ast.unparse(ast.IfExp(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse))})"
    elif isinstance(node, ast.stmt):
        yield from _other_statements(node)


def _other_constants(value: object) -> Iterator[str]:
    if isinstance(value, bool):
        yield str(not value)
    elif isinstance(value, int):
        yield from (str(value + 1), str(value - 1) if value > 0 else f"({value - 1})")
    elif isinstance(value, float):
        yield from (repr(1.1 * value), repr(0.9 * value)) if value else ("1.0",)


def _other_statements(node: ast.stmt) -> Iterator[str]:
    if isinstance(node, ast.Return) and node.value is not None and ast.unparse(node.value) != "None":
        yield "return None"
    elif isinstance(node, ast.Expr | ast.AugAssign | ast.Continue | ast.Break | ast.Raise | ast.Return) or (
        isinstance(node, ast.Assign) and not all(isinstance(t, ast.Name | ast.Tuple) for t in node.targets)
    ):
        yield "pass"
    elif isinstance(node, ast.If):
        changed = ast.If(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse)
        yield ast.unparse(changed).replace("\n", "\n" + " " * node.col_offset)


def chosen(files: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """That many mutants of all files together, drawn at random; the same ones for a seed."""
    every = [m for file in files for m in mutants(file)]
    return every if count >= len(every) else random.Random(seed).sample(every, count)


def killed(mutant: Mutant, folder: Path, tests: Sequence[str], limit_s: float) -> bool:
    """Whether the tests notice a mutant; those that take longer than ``limit_s`` do."""
    path = folder / "fmu_didim" / mutant.file
    original = path.read_text(encoding="utf-8")
    try:
        path.write_text(mutant.source, encoding="utf-8")
        return not passes(folder, tests, limit_s)
    finally:
        path.write_text(original, encoding="utf-8")


def passes(folder: Path, tests: Sequence[str], limit_s: float | None = None) -> bool:
    """Whether the tests pass in a copy of the project, within a time if one is given."""
    command = [sys.executable, "-B", "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
    environment = {**os.environ, "PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1", "FMU_DIDIM_WORKERS": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # tests/__init__.py would take it, and ``-B`` with it, away
    try:
        done = subprocess.run(
            [*command, *(str(folder / "tests" / test) for test in tests)], cwd=folder, env=environment,
            capture_output=True, timeout=limit_s, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def copied(folder: Path) -> Path:
    """The project in a folder of its own."""
    for name in ("fmu_didim", "tests", "examples", "controllers", "fmus"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def known_equivalents() -> dict[tuple[str, str, str], str]:
    """File, line before and after -> why it makes no difference."""
    rows = yaml.safe_load(EQUIVALENT.read_text(encoding="utf-8")) if EQUIVALENT.is_file() else []
    return {(row["file"], row["before"], row["after"]): row["reason"] for row in rows or []}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run mutants, print the survivors and a summary; fails where too few are killed."""
    parser = argparse.ArgumentParser(description="Small changes of the code that the fast tests should notice.")
    parser.add_argument("--count", type=int, default=200, help="mutants, of all files together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--files", nargs="+", default=list(TESTS), help="from the package on")
    parser.add_argument("--tests", nargs="+", help="instead of those that belong to the files, from tests on")
    parser.add_argument("--least", type=float, default=85.0, help="percent that must be killed")
    asked = parser.parse_args(arguments)
    equivalent, counts = known_equivalents(), {"killed": 0, "survived": 0, "equivalent": 0}
    with tempfile.TemporaryDirectory() as name:
        folder = copied(Path(name))
        limits_s: dict[tuple[str, ...], float] = {}
        for file in asked.files:
            tests = tuple(asked.tests or TESTS[file])
            if tests in limits_s:
                continue
            begin = time.perf_counter()
            if not passes(folder, tests):
                print(f"The tests of {file} fail without any change.")
                return 2
            limits_s[tests] = PATIENCE * (time.perf_counter() - begin)
        begin = time.perf_counter()
        for mutant in chosen(asked.files, asked.count, asked.seed):
            if (mutant.file, mutant.before, mutant.after) in equivalent:
                outcome = "equivalent"
            else:
                tests = tuple(asked.tests or TESTS[mutant.file])
                outcome = "killed" if killed(mutant, folder, tests, limits_s[tests]) else "survived"
            counts[outcome] += 1
            print(f"{outcome}: {mutant.file}:{mutant.line}", flush=True)
            if outcome == "survived":
                print(f"  - {mutant.before}\n  + {mutant.after}", flush=True)
    judged = counts["killed"] + counts["survived"]
    share = 100 * counts["killed"] / judged if judged else 100.0
    print(f"{counts['killed']} of {judged} killed ({share:.1f} %), {counts['equivalent']} equivalent, "
          f"{time.perf_counter() - begin:.0f} s")  # fmt: skip
    return 0 if share >= asked.least else 1


if __name__ == "__main__":
    sys.exit(main())
