"""A simulated experiment as a table, and what of a run is recorded for it."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.checks.validation import validate_on
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.simulated_table import simulated_table
from tests.checks.data.right import right


@pytest.mark.parametrize("motion", [("q", "dq"), ("q", "dq", "ddq"), ()])
@pytest.mark.parametrize("sampled", [True, False])
def test_a_table_of_a_run_that_nobody_asks_for_again_is_the_same(motion: tuple[str, ...], sampled: bool) -> None:
    model, tables = right("scara", 1), list[np.ndarray]()
    for alone in (True, False):
        run = model.simulation(1.1 * model.start)
        table = simulated_table(run, motion=motion, sampled=sampled, alone=alone)
        assert table.names == tuple(f"{name}{j}" for name in ("tau", *motion) for j in (1, 2))
        tables.append(table.values)
    np.testing.assert_array_equal(*tables)


def test_of_held_out_experiments_nothing_is_recorded_that_nobody_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of those that are fitted all is, because checks ask for their accelerations."""
    model, recorded = right("scara", 1), dict[str, int | None]()
    record = Simulation.record

    def counted(run: Simulation, **asked: object) -> object:
        signals = asked.get("signals")
        recorded[run.label] = None if signals is None else len(signals)  # type: ignore[arg-type]
        return record(run, **asked)  # type: ignore[arg-type]

    monkeypatch.setattr(Simulation, "record", counted)
    found = {label: validate_on(model, model.start, label) for label in model.experiments}
    assert recorded == {label: None if found[label].role == "estimation" else 6 for label in model.experiments}
    assert {one.role for one in found.values()} == {"estimation", "validation"}
    assert all(set(one.motion) == {"q1", "q2", "dq1", "dq2"} for one in found.values())
    _compared(model, found["validation"].every.values)  # type: ignore[union-attr]


def _compared(model: LoopModel, torque: np.ndarray) -> None:
    whole = model.simulation(model.start, "validation")
    np.testing.assert_array_equal(torque, whole.logged_torque(whole.record(all_ticks=True)))
