"""Mistakes of all sorts, drawn over the keys of case, robot and controller and over the files that they name."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

from fmu_didim.case.document import CaseDocument
from tests.tools.wrong.place import Files

NUMBERS = (0, -1, float("nan"), float("inf"), 1e300, -1e-300, 1e12, 3.7)
TEXTS = ("abc", "", "1,5", "nan", "rad", "../..", "none.csv", "-", "@case", "q7")
OTHERS: tuple[Any, ...] = (True, [], {}, [1, 2, 3], {"name": "x"}, [None], None)
FACTORS = (-1.0, 1e3, 1e-3, 57.29578, 0.0174533, 1e6, 0.0)
UNITS = ("deg", "mm", "ms", "Nmm", "A", "%", "rpm", "kN.m", "N", "grad", "banana", "")
CELLS = ("", "nan", "abc", "#REF!", "1e400", "-", "1;2")


def draw(rng: random.Random, made: Files) -> str:
    """Put one mistake into the files; returns what it is."""
    kinds = (_value, _value, _value, _number, _number, _key, _further_key, _unit, _cell, _column, _file)
    return rng.choice(kinds)(rng, made)


def _leaves(node: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, Any, tuple[Any, ...]]]:
    """Holder, key and path of all values in a document."""
    pairs = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in list(pairs):
        yield node, key, (*path, key)
        yield from _leaves(value, (*path, key))


def _place(rng: random.Random, made: Files, wanted: Callable[[Any, Any], bool]) -> tuple[str, Any, Any]:
    """A place in one of the documents whose value is wanted: where it is, its holder and its key."""
    name = rng.choice(["case.yaml"] * 4 + ["robot.yaml", "controller.yaml"])
    found = [(h, k, p) for h, k, p in _leaves(made.documents[name]) if wanted(h, k)]
    holder, key, path = rng.choice(found)
    return f"{name}: {'.'.join(map(str, path))}", holder, key


def _value(rng: random.Random, made: Files) -> str:
    """Another value, of a wrong type or an absurd one."""
    where, holder, key = _place(rng, made, lambda holder, key: key not in ("description", "name", "source", "schema"))
    holder[key] = rng.choice(rng.choice((NUMBERS, TEXTS, OTHERS)))
    return f"{where} = {holder[key]!r}"


def _is_number(holder: Any, key: Any) -> bool:
    return isinstance(holder[key], int | float) and not isinstance(holder[key], bool) and key != "schema"


def _number(rng: random.Random, made: Files) -> str:
    """A number off by a factor: a unit, a sign, a lost decimal sign."""
    where, holder, key = _place(rng, made, _is_number)
    old = holder[key]
    holder[key] = (old or 1.0) * rng.choice(FACTORS)
    return f"{where}: {old!r} -> {holder[key]!r}"


def _key(rng: random.Random, made: Files) -> str:
    """A key that is misspelt or missing."""
    where, holder, key = _place(rng, made, lambda holder, key: isinstance(holder, dict))
    value = holder.pop(key)
    if rng.random() < 0.5:
        return f"{where} is missing"
    new = rng.choice((f"{key}s", key[:-1], key.upper(), key.replace("_", "-") + "_"))
    holder[new] = value
    return f"{where} is called {new!r}"


@cache
def _schema() -> dict[str, Any]:
    return CaseDocument.model_json_schema()


SCHEMA_PLACES = {
    (): "", ("loop",): "Loop", ("plant",): "ComponentSource", ("controller",): "ComponentSource",
    ("train",): "ExperimentSource", ("train", "reference"): "ReferenceFile", ("train", "torque"): "TorqueFile",
    ("train", "torque", "time"): "TimeColumn", ("train", "torque", "columns", "tau1"): "Column",
    ("train", "reference", "columns", "q1"): "Column",
}  # fmt: skip
"""Place in the case -> the definition of its keys."""


def _further_key(rng: random.Random, made: Files) -> str:
    """A key that the case may have and has not, with a wrong value."""
    path = rng.choice(list(SCHEMA_PLACES))
    name, holder = SCHEMA_PLACES[path], made.documents["case.yaml"]
    for key in path:
        holder = holder[key]
    known = (_schema()["$defs"][name] if name else _schema())["properties"]
    key = rng.choice(sorted(set(known) - set(holder) - {"description", "obtain"}))
    holder[key] = rng.choice(rng.choice((NUMBERS, TEXTS, OTHERS)))
    return f"case.yaml: {'.'.join([*path, key])} = {holder[key]!r} added"


def _unit(rng: random.Random, made: Files) -> str:
    """Another unit of a column."""
    where, holder, key = _place(rng, made, lambda holder, key: True)
    while key != "unit":
        where, holder, key = _place(rng, made, lambda holder, key: True)
    old, holder[key] = holder[key], rng.choice(UNITS)
    return f"{where}: {old} -> {holder[key]!r}"


def _table(rng: random.Random, made: Files) -> tuple[str, list[list[str]]]:
    name = rng.choice(sorted(made.tables))
    return name, made.tables[name]


def _cell(rng: random.Random, made: Files) -> str:
    """A cell that is no number."""
    name, rows = _table(rng, made)
    row, column = rng.randrange(1, len(rows)), rng.randrange(len(rows[0]))
    rows[row][column] = rng.choice(CELLS)
    return f"{name}: row {row}, {rows[0][column]} is {rows[row][column]!r}"


def _column(rng: random.Random, made: Files) -> str:
    """A column that is missing, constant, swapped, shifted by rows, or in another unit than its head says."""
    name, rows = _table(rng, made)
    at = rng.randrange(len(rows[0]))
    head, body = rows[0][at], [float(row[at]) for row in rows[1:]]
    what = rng.choice(("missing", "constant", "next", "degrees", "thousand", "negative", "reversed", "empty", "twice"))
    match what:
        case "missing":
            for row in rows:
                del row[at]
        case "twice":
            rows[0][at] = rows[0][(at + 1) % len(rows[0])]
        case "next":
            for row in rows[1:]:
                row[at], row[(at + 1) % len(row)] = row[(at + 1) % len(row)], row[at]
        case _:
            factor = {"degrees": 57.29578, "thousand": 1e3, "negative": -1.0}.get(what, 1.0)
            new = [f"{factor * value:.9g}" for value in body]
            new = {"constant": [new[0]] * len(new), "reversed": new[::-1], "empty": [""] * len(new)}.get(what, new)
            for row, text in zip(rows[1:], new, strict=True):
                row[at] = text
    return f"{name}: column {head} {what}"


def _file(rng: random.Random, made: Files) -> str:
    """A file that is missing, empty, cut, of another kind, or in the place of another one."""
    name = rng.choice([*sorted(made.tables), "robot.yaml", "controller.yaml"])
    ways = ("missing", "empty", "binary", "other")
    if name in made.tables:
        ways = (*ways, "cut", "heads only", "no heads", "rows doubled", "semicolons")
    what = rng.choice(ways)
    rows = made.tables.get(name, [])
    match what:
        case "cut":
            del rows[1 + len(rows) // 3 :]
            rows[-1] = rows[-1][:1]
        case "heads only":
            del rows[1:]
        case "no heads":
            del rows[0]
        case "rows doubled":
            rows += [list(row) for row in rows[1:]]
        case "semicolons":
            rows[:] = [[";".join(row)] for row in rows]
        case "other":
            others = sorted({*made.tables, *made.documents} - {name})
            other = rng.choice(others)
            made.tables.pop(name, None)
            if other in made.tables:
                made.documents.pop(name, None)
                made.tables[name] = [list(row) for row in made.tables[other]]
            else:
                made.documents[name] = made.documents[other]
            return f"{name} is {other}"
        case _:
            made.tables.pop(name, None)
            made.documents.pop(name, None)
            made.others |= {} if what == "missing" else {name: b"" if what == "empty" else bytes(range(256)) * 8}
    return f"{name}: {what}"
