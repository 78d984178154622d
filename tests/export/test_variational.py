"""The key under which a library of derivatives is kept: whatever the library follows from has a part in it."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import casadi as ca
import pytest

import fmu_didim.export.variational as variational
from fmu_didim.dynamics.block import Balance
from fmu_didim.dynamics.linearly_implicit import LinearlyImplicit
from fmu_didim.export.variational import WRITERS, _digest_of_writer, _packed, _Request


def function(factor: float = 1.0) -> ca.Function:
    x = ca.SX.sym("x", 2)
    return ca.Function("f", [x], [factor * x + 0.1])


def request() -> _Request:
    balance = Balance(function(2.0), function(3.0), function(4.0), function(5.0), symmetric=True)
    implicit = LinearlyImplicit(*(function(k) for k in (6.0, 7.0, 8.0, 9.0, 10.0)))
    equations = (function(11.0), function(12.0), function(13.0), function(14.0))
    return _Request(equations, balance, implicit, False, ((0, 1), (1, 0)), 2, (0,))


def other(value: Any) -> list[Any]:
    """Other values in the place of one, each of which gives another library."""
    if isinstance(value, ca.Function):
        return [function(20.0), function(11.0 + 1e-15)]
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1]
    if isinstance(value, tuple):
        changed = [(*value[:i], one, *value[i + 1 :]) for i, part in enumerate(value) for one in other(part)]
        return [*changed, value[:-1]]
    assert isinstance(value, Balance | LinearlyImplicit)
    parts = [(entry.name, one) for entry in fields(value) for one in other(getattr(value, entry.name))]
    return [None, *(replace(value, **{name: one}) for name, one in parts)]


def test_each_part_of_a_request_has_a_part_in_its_digest() -> None:
    given = request()
    changed = [replace(given, **{e.name: one}) for e in fields(given) for one in other(getattr(given, e.name))]
    digests = [one.digest() for one in (given, *changed)]
    assert len(changed) > 30
    assert len(set(digests)) == len(digests)


@pytest.mark.parametrize("values", [("1", 1), ((1, 2), (1, (2,))), ((1, 23), (12, 3)), (("a", "bc"), ("ab", "c"))])
def test_what_reads_alike_is_told_apart(values: tuple[object, object]) -> None:
    assert _packed(values[0]) != _packed(values[1])


def test_a_part_of_no_known_kind_is_no_part_of_a_key() -> None:
    with pytest.raises(TypeError, match="set"):
        _packed({1})


def test_digests_are_the_same_in_every_process() -> None:
    call = [sys.executable, "-c", "from tests.export.test_variational import request; print(request().digest())"]
    environments = [os.environ | {"PYTHONHASHSEED": seed} for seed in "12"]
    found = {subprocess.run(call, capture_output=True, text=True, check=True, env=one).stdout for one in environments}
    assert found == {f"{request().digest()}\n"}


def test_another_writer_has_other_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    before = request().digest()
    monkeypatch.setattr(variational, "wrapper_source", lambda name: "another text")
    _digest_of_writer.cache_clear()
    try:
        assert request().digest() != before
    finally:
        _digest_of_writer.cache_clear()


def test_all_modules_that_write_are_known() -> None:
    """Those of this package that the writer imports, but for those that keep and compile what it has written."""
    text = Path(variational.__file__).read_text(encoding="utf-8")
    imported = {
        line.split()[1].removeprefix("fmu_didim.") for line in text.splitlines() if line.startswith("from fmu_didim")
    }
    assert imported - {"base.cache", "export.build"} == set(WRITERS) - {"export.variational"}
