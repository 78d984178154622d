"""Motions that do not start on their reference: simulated from where the case says, and identified."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim import Case, Log, identify, load_case, simulate
from fmu_didim.base.errors import UnknownNameError
from fmu_didim.campaigns.planning.truth import simulated_truth
from tests.helpers import ROOT

NOISE = np.array([0.35, 0.012])
EVERY = 20
"""[ticks] From one sample of the log to the next."""


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case(ROOT / "examples/scara/identify.yaml")


def test_the_loop_starts_where_the_case_says(case: Case) -> None:
    moved = simulate(case.with_(train={"initial_state": {"q1": 1.25}}))
    assert moved.column("q1")[0] == 1.25
    assert moved.column("q2")[0] == simulate(case).column("q2")[0]
    with pytest.raises(UnknownNameError, match="q7"):
        simulate(case.with_(train={"initial_state": {"q7": 1.25}}))


def test_the_machine_of_a_campaign_starts_where_its_case_says(case: Case) -> None:
    there = case.with_(train={"initial_state": {"q1": 1.25}})
    first = [simulated_truth(dict(one.content), one.folder).logs["estimation"].torque[0] for one in (case, there)]
    np.testing.assert_allclose(first[1], [simulate(there).column(f"tau{j}")[0] for j in (1, 2)])
    assert abs(first[1] - first[0]).max() > 100


@pytest.mark.parametrize(
    "off", [0.02, pytest.param(0.3, marks=pytest.mark.gate), pytest.param(1.0, marks=pytest.mark.gate)]
)
def test_a_log_whose_transient_is_larger_than_all_else_is_no_foreign_one(case: Case, off: float) -> None:
    truth = dict(zip(case.model.names, case.model.start, strict=True))
    begin = float(simulate(case).column("q1")[0]) + off
    motion = simulate(case.with_(train={"initial_state": {"q1": begin}}))
    torque = np.column_stack([motion.column(f"tau{j}")[::EVERY] for j in (1, 2)])
    rng = np.random.default_rng(4)
    found = identify(case, log=Log(motion.time[::EVERY], torque + NOISE * rng.standard_normal(torque.shape)))
    assert found.document.verdict == "valid"
    for name, value in truth.items():
        assert abs(found.parameters[name].value - value) < 3.5 * found.parameters[name].std
    start = found.parameters["q_start1[estimation]"]
    assert abs(start.value - begin) < 3.5 * start.std
