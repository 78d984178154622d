"""Derivatives of expressions are formed by one thread at a time, wherever in the package."""

from __future__ import annotations

import re
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import casadi as ca
import numpy as np
import pytest

from fmu_didim.base import symbolic
from tests.conftest import ROOT

NAMES = ("jacobian", "forward", "reverse")
DIFFERENTIATES = re.compile(r"\bca\.(jacobian|hessian|gradient|tangent|jtimes|linearize|forward|reverse)\(|\.factory\(")


def arguments(name: str) -> tuple[Any, ...]:
    x = ca.SX.sym("x", 2)
    y = ca.vertcat(x[0] * x[1], ca.sin(x[0]))
    return (y, x) if name == "jacobian" else ([y], [x], [[ca.SX([1, 0])]])


@pytest.mark.parametrize("name", NAMES)
def test_threads_wait_for_each_other(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Were two at it, the second would come while the first still waits."""
    inside, most = [0], [0]
    change = threading.Lock()
    own = getattr(ca, name)

    def watched(*given: Any) -> Any:
        with change:
            inside[0] += 1
            most[0] = max(most[0], inside[0])
        time.sleep(0.01)
        with change:
            inside[0] -= 1
        return own(*given)

    monkeypatch.setattr(symbolic.ca, name, watched)
    with ThreadPoolExecutor(4) as threads:
        assert len(list(threads.map(lambda _: getattr(symbolic, name)(*arguments(name)), range(8)))) == 8
    assert most == [1]


@pytest.mark.parametrize("name", NAMES)
def test_derivatives_are_those_of_casadi(name: str) -> None:
    given = arguments(name)
    x = given[1] if name == "jacobian" else given[1][0]
    found = getattr(symbolic, name)(*given)
    value = ca.Function("f", [x], [found if name == "jacobian" else found[0][0]])
    at = np.array([0.3, 2.0])
    table = np.array([[at[1], at[0]], [np.cos(at[0]), 0.0]])
    expected = {"jacobian": table, "forward": table[:, :1], "reverse": table[:1].T}[name]
    assert np.asarray(value(at)) == pytest.approx(expected, abs=1e-14)


def test_nothing_else_in_the_package_differentiates() -> None:
    files = [path for path in (ROOT / "fmu_didim").rglob("*.py") if path.name != "symbolic.py"]
    assert [str(path) for path in files if DIFFERENTIATES.search(path.read_text(encoding="utf-8"))] == []
