"""A parameter of a foreign plant that the case leaves at its maker's value, as the cause of a misfit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import pytest

from fmu_didim import identify
from fmu_didim.checks.plant.unidentified import unidentified_diagnostics
from tests.foreign import crane, exported, foreign_case, one_joint, plant_block, spring_pendulum

CRANE = {"M": 3.0, "m": 1.0, "l": 0.8, "d": 2.0, "b": 0.3}
TROLLEY = {"M": {"minimum": 0.01}, "d": {}}
SLOW: dict[str, Any] = {"gains": (60.0, 20.0), "size": 0.1}


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(tmp_path_factory.mktemp("crane"), plant_block("crane", CRANE, crane, count=4))


def misfit(case: Path) -> tuple[str, list[Any]]:
    found = identify(case)
    return found.verdict, [r for r in found.document.reasons if r.code == "parameter-not-identified"]


@pytest.mark.gate
@pytest.mark.parametrize(("idle", "value"), [("m", 1.8), ("l", 0.6)])
def test_it_is_named_first_with_the_value_that_it_would_take(
    tmp_path: Path, plant: Path, idle: str, value: float
) -> None:
    values = {"M": 4.0, "d": 3.0, idle: value}
    verdict, told = misfit(foreign_case(tmp_path, plant, plant, TROLLEY, values=values, **SLOW))
    assert verdict == "doubtful"
    (reason,) = told
    assert reason.place == idle
    found = re.search(r"with ([0-9.]+) the torque error falls from ([0-9.]+) % to ([0-9.]+) %", reason.text)
    assert found is not None
    would_be, before, after = map(float, found.groups())
    assert would_be == pytest.approx(value, rel=0.02)
    assert before > 5 * after
    assert f"identify: {{{idle}: {{parameter: {idle}}}}}" in reason.next_step
    assert f"plant: {{parameters: {{{idle}: " in reason.next_step


@pytest.mark.gate
def test_nothing_is_blamed_where_nothing_is_wrong(tmp_path: Path, plant: Path) -> None:
    values = {"M": 4.0, "d": 3.0}
    assert misfit(foreign_case(tmp_path, plant, plant, TROLLEY, values=values, **SLOW)) == ("valid", [])


@pytest.mark.gate
@pytest.mark.parametrize("identified", [("m", "k", "d"), ("m", "k")])
def test_friction_that_is_missing_is_no_parameter(tmp_path: Path, identified: tuple[str, ...]) -> None:
    """Neither the length nor the damping of a pendulum does what Coulomb friction does."""
    own = {"m": 1.4, "l": 0.5, "k": 4.0, "d": 0.3}
    plant = exported(tmp_path / "plant", one_joint("pendulum", own, spring_pendulum))
    data = exported(tmp_path / "data", one_joint("pendulum", {**own, "Fc": 1.0}, spring_pendulum, rate=4000.0))
    verdict, told = misfit(foreign_case(tmp_path, plant, data, {name: {} for name in identified}))
    assert (verdict, told) == ("doubtful", [])


@pytest.mark.gate
def test_those_that_the_data_do_not_tell_apart_are_named_together(tmp_path: Path) -> None:
    def two_springs(p: Mapping[str, ca.SX], q: ca.SX, dq: ca.SX) -> tuple[ca.SX, ca.SX]:
        return p["J"], (p["inner.k"] + p["outer.k"]) * q + p["d"] * dq

    own = {"J": 0.3, "inner.k": 2.0, "outer.k": 3.0, "d": 0.3, "unused": 0.0}
    plant = exported(tmp_path / "plant", one_joint("springs", own, two_springs))
    values = {"outer.k": 9.0}
    found = identify(foreign_case(tmp_path, plant, plant, {"J": {}, "d": {}}, values=values))
    (told,) = unidentified_diagnostics(found.estimate.fit)
    assert {told.place} < {"inner.k", "outer.k"}
    assert "these data do not tell it from" in told.text
    values = [float(v) for v in re.findall(r"(?:with|outer.k =|inner.k =) ([0-9.]+[0-9])", told.text)]
    assert {8.0, 9.0} <= {round(v, 1) for v in values}
