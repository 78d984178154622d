"""A plant FMU that takes steps of its own, longer than those of the loop."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.checks.data.plant import held_steps, plant_diagnostics
from tests.awkward.build import awkward_fmu
from tests.campaigns.helpers import REFERENCE

RAMP = np.arange(60.0)


@pytest.mark.parametrize(
    ("column", "steps"),
    [
        (RAMP, 1),
        (np.repeat(RAMP, 10), 10),
        (np.repeat(RAMP, 2), 2),
        (np.repeat(RAMP[:8], 10), 1),  # too few changes for a word
        (np.r_[RAMP, np.full(200, 60.0), RAMP], 1),  # a pause
        (np.zeros(60), 1),
    ],
)
def test_how_long_outputs_are_held(column: np.ndarray[Any, Any], steps: int) -> None:
    assert held_steps(column[:, None]) == steps
    assert held_steps(np.column_stack([column, np.zeros(column.size)])) == steps
    assert held_steps(np.column_stack([column, np.arange(column.size)])) == 1


@pytest.mark.parametrize(
    ("macros", "rate_hz", "told"),
    [(("HOLDS",), None, [("plant-holds", 10.0)]), (("HOLDS",), 50.0, [("plant-holds", 20.0)]), ((), None, []),
     ((), 10.0, [])],
)  # fmt: skip
def test_a_plant_that_holds_its_outputs(
    macros: tuple[str, ...], rate_hz: float | None, told: list[tuple[str, float]], tmp_path: Path
) -> None:
    """That of a plant which the case itself has run at a lower rate is no surprise."""
    plant = {
        "source": str(awkward_fmu(tmp_path, *macros)), "inputs": {"tau1": "u"}, "outputs": {"dq1": "y"},
        "parameters": {"d": 0.0}, "isolated": False,
    }  # fmt: skip
    content = {
        "name": "held", "plant": plant | ({"rate_hz": rate_hz} if rate_hz else {}),
        "controller": {"source": str(awkward_fmu(tmp_path)), "isolated": False, "inputs": {"dq_ref1 - dq1": "u"},
                       "outputs": {"command1": "y"}},
        "identify": {"a": {"parameter": "a", "minimum": 0}}, "estimator": {"kind": "clie"}, "loop": {"rate_hz": 100},
        "train": {"reference": REFERENCE, "torque": {"file": "log.csv", "rate_hz": 50}},
    }  # fmt: skip
    np.savetxt(tmp_path / "log.csv", [[0.02 * k, 0.0] for k in range(200)], delimiter=",", header="t,tau1", comments="")
    model = load_case(content, folder=tmp_path).model
    found = plant_diagnostics(model.simulation(model.start, model.first))
    assert [(d.code.name, d.value) for d in found] == told
