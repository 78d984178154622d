"""Two folders of records beside each other: names and verdicts, the largest differences of parameters, times."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.tools.regression.record import Project

ERROR = "error"
"""Verdict of a case that failed."""


@dataclass(frozen=True)
class Value:
    """A parameter with its standard deviation; None where there is no number."""

    value: float | None
    std: float | None = None


@dataclass(frozen=True)
class Record:
    """What is compared of a record.

    Attributes:
        project: that gave it, in words; options, inputs: what it was run with and on.
        verdict: of discovery, or the status of an identification; names: what was found, or the error.
        values: parameters by name, those of an effect behind effect and joint.
        seconds: by the clock, which other work on the machine lengthens; cpu_seconds: of the processor.
    """

    case: str
    project: str
    options: Mapping[str, Any]
    inputs: Mapping[str, str]
    verdict: str
    names: tuple[str, ...]
    values: Mapping[str, Value]
    seconds: float
    cpu_seconds: float

    @property
    def outcome(self) -> str:
        """Verdict and names."""
        return f"{self.verdict}: {', '.join(self.names)}" if self.names else self.verdict


@dataclass(frozen=True)
class Difference:
    """Of one parameter.

    Attributes:
        relative: |b - a| over the larger of |a| and |b|; infinite if only one of the records has it.
        sigma: |b - a| over the standard deviation of a; None if that has none.
    """

    parameter: str
    relative: float
    sigma: float | None


@dataclass(frozen=True)
class Limits:
    """How much a parameter may differ, None: as much as it likes.

    Attributes:
        relative: to its value; sigma: in standard deviations of A.
    """

    relative: float | None = None
    sigma: float | None = None


@dataclass(frozen=True)
class Row:
    """A case of both records.

    Attributes:
        relative, sigma: the parameters that differ most; None where nothing differs, or names and verdict do.
        problem: what is wrong with the case; empty if nothing is.
    """

    a: Record
    b: Record
    relative: Difference | None
    sigma: Difference | None
    problem: str

    @property
    def is_same(self) -> bool:
        """Whether names and verdict are the same."""
        return _same(self.a, self.b)


@dataclass(frozen=True)
class Comparison:
    """What :func:`compare` returns: a row a case of both, the worst first, and the cases of one alone."""

    rows: tuple[Row, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether there are cases in both, and none has a problem."""
        return bool(self.rows) and not any(row.problem for row in self.rows)


def read_records(folder: Path) -> dict[str, Record]:
    """The records of a folder by case.

    Raises:
        FileNotFoundError: it holds none.
    """
    found = [read_record(json.loads(file.read_text(encoding="utf-8"))) for file in sorted(folder.glob("*.json"))]
    if not found:
        raise FileNotFoundError(f"no records in {folder}")
    return {record.case: record for record in found}


def read_record(content: Mapping[str, Any]) -> Record:
    """A record from the content of its file."""
    if content["result"] is None:
        verdict, names, values = _of_failure(content["error"])
    elif content["verb"] == "identify":
        verdict, names, values = _of_identification(content["result"])
    else:
        verdict, names, values = _of_discovery(content["result"])
    return Record(
        case=content["case"], project=str(Project(**content["project"])), options=content["options"],
        inputs=content["inputs"], verdict=verdict, names=names, values=values, seconds=content["seconds"],
        cpu_seconds=content["cpu_seconds"],
    )  # fmt: skip


_Parts = tuple[str, tuple[str, ...], dict[str, Value]]
"""Verdict, names and values."""


def _of_failure(error: str) -> _Parts:
    return ERROR, (error.splitlines()[0],), {}


def _of_identification(result: Mapping[str, Any]) -> _Parts:
    return result["status"], (), {name: Value(p["value"], p["std"]) for name, p in result["parameters"].items()}


def _of_discovery(result: Mapping[str, Any]) -> _Parts:
    values = {p["name"]: Value(p["value"], p["std"]) for p in result["base_parameters"]}
    names = []
    for finding in result["findings"]:
        name = f"{finding['effect']}@{finding['joint']}"
        names.append(name)
        values |= {f"{name} {p['name']}": Value(p["value"], p["std"]) for p in finding["parameters"]}
    return result.get("answer", result["verdict"]), tuple(sorted(names)), values


def difference(parameter: str, a: Value | None, b: Value | None) -> Difference | None:
    """How far apart two values of a parameter are; None if they are the same.

    Args:
        a, b: None where the record does not have the parameter.
    """
    first, second = (None if v is None else v.value for v in (a, b))
    if (a is None) == (b is None) and first == second:
        return None
    if a is None or first is None or second is None:
        return Difference(parameter, math.inf, None)
    apart = abs(second - first)
    return Difference(parameter, apart / max(abs(first), abs(second)), apart / a.std if a.std else None)


def row_of(a: Record, b: Record, limits: Limits) -> Row:
    """Two records of one case beside each other."""
    found = [difference(name, a.values.get(name), b.values.get(name)) for name in {**a.values, **b.values}]
    there = [d for d in found if d is not None] if _same(a, b) else []
    relative = max(there, key=lambda d: d.relative, default=None)
    in_sigma = [d for d in there if d.sigma is not None]
    sigma = max(in_sigma, key=lambda d: d.sigma or 0.0, default=None)
    return Row(a, b, relative, sigma, _problem(a, b, relative, sigma, limits))


def _same(a: Record, b: Record) -> bool:
    return (a.verdict, a.names) == (b.verdict, b.names)


def _problem(a: Record, b: Record, relative: Difference | None, sigma: Difference | None, limits: Limits) -> str:
    if a.inputs != b.inputs:
        return "other input"
    if a.options != b.options:
        return "other options"
    if not _same(a, b):
        return "other verdict" if a.names == b.names else "other names"
    if relative is not None and math.isinf(relative.relative):
        return "other parameters"
    if relative is not None and limits.relative is not None and relative.relative > limits.relative:
        return "beyond the limit"
    if sigma is not None and limits.sigma is not None and (sigma.sigma or 0.0) > limits.sigma:
        return "beyond sigma"
    return ""


def compare(a: Mapping[str, Record], b: Mapping[str, Record], limits: Limits) -> Comparison:
    """All cases that both have; those with a problem first, then by the largest difference."""
    rows = [row_of(record, b[case], limits) for case, record in a.items() if case in b]
    rows.sort(key=lambda row: (not row.problem, -_sigma(row), row.a.case))
    return Comparison(tuple(rows), tuple(sorted(set(a) - set(b))), tuple(sorted(set(b) - set(a))))


def _sigma(row: Row) -> float:
    return row.sigma.sigma if row.sigma is not None and row.sigma.sigma is not None else 0.0


def text(found: Comparison) -> str:
    """The comparison for the terminal."""
    same = [row for row in found.rows if row.is_same]
    identical = sum(row.relative is None for row in same)
    lines = [f"A: {_projects([row.a for row in found.rows])}", f"B: {_projects([row.b for row in found.rows])}"]
    lines += ["", *_table(found.rows), ""]
    lines.append(f"{len(same)} of {len(found.rows)} cases have the same names and verdict, "
                 f"{identical} of them the same parameters to the last bit")  # fmt: skip
    counts = {p: sum(row.problem == p for row in found.rows) for p in {row.problem for row in found.rows} - {""}}
    lines += [f"{count} {problem}" for problem, count in sorted(counts.items())]
    for side, names in (("A", found.only_a), ("B", found.only_b)):
        if names:
            lines.append(f"{len(names)} only in {side}: {', '.join(names)}")
    return "\n".join([*lines, _times(found.rows)])


def _projects(records: Sequence[Record]) -> str:
    return "; ".join(sorted({record.project for record in records})) or "nothing to compare"


def _table(rows: Sequence[Row]) -> list[str]:
    width = max([len(row.a.case) for row in rows], default=4)
    lines = [
        f"{'case':{width}}  {'relative':>8}  {'sigma':>8}  {'A cpu s':>7}  {'B cpu s':>7}  outcome, parameters, problem"
    ]
    for row in rows:
        relative = "-" if row.relative is None else f"{row.relative.relative:.1e}"
        sigma = "-" if row.sigma is None else f"{row.sigma.sigma:.1e}"
        numbers = f"{relative:>8}  {sigma:>8}  {row.a.cpu_seconds:7.1f}  {row.b.cpu_seconds:7.1f}"
        lines.append(f"{row.a.case:{width}}  {numbers}  {_words(row)}")
    return lines


def _words(row: Row) -> str:
    a, b = row.a.outcome, row.b.outcome
    differing = [d.parameter for d in (row.relative, row.sigma) if d is not None]
    parts = [a if a == b else f"{a} -> {b}", *([", ".join(dict.fromkeys(differing))] if differing else [])]
    return "; ".join([*parts, *([row.problem.upper()] if row.problem else [])])


def _times(rows: Sequence[Row]) -> str:
    if not rows:
        return "no case is in both"
    clock = [sum(r.seconds for r in side) for side in ([row.a for row in rows], [row.b for row in rows])]
    cpu = [sum(r.cpu_seconds for r in side) for side in ([row.a for row in rows], [row.b for row in rows])]
    ratios = [row.b.cpu_seconds / row.a.cpu_seconds for row in rows if row.a.cpu_seconds > 0]
    middle = f", in the median {statistics.median(ratios):.2f} times as long" if ratios else ""
    by_clock = f"by the clock {clock[0]:.0f} s, {clock[1]:.0f} s"
    return f"time of the processor: A {cpu[0]:.0f} s, B {cpu[1]:.0f} s{middle}; {by_clock}"
