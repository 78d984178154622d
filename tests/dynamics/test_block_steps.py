"""Which method integrates a block, and its substeps, from the rates of both methods."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from fmu_didim.components.base import Component
from fmu_didim.components.model import ModelComponent
from fmu_didim.dynamics.block import Steps, choose_steps
from fmu_didim.model.integration import integration
from tests.helpers import advance, begin, component, drive, scara

STEP = 0.005


@pytest.mark.parametrize(
    ("rates", "steps"),
    [
        ([300.0], Steps(8, True)),  # one method alone
        ([300.0, 2500.0], Steps(8, True)),  # nothing steep: 8 of RK4 for 64
        ([1.0, 2500.0], Steps(4, True)),  # never fewer than resolve the motion
        ([1250.0, 2500.0], Steps(32, True)),  # as dear as 64
        ([1251.0, 2500.0], Steps(64, False)),
        ([5000.0, 5000.0], Steps(128, False)),  # steep friction
        ([5000.0, 12000.0], Steps(128, True)),  # what oscillates asks the method of second order for more
        ([1e9, 2500.0], Steps(64, False)),
    ],
)
def test_the_method_that_needs_less_is_chosen(rates: list[float], steps: Steps) -> None:
    assert choose_steps(rates, STEP) == steps


def test_the_step_decides_nothing() -> None:
    """A run whose steps differ stays with one method."""
    for rates in ([1249.0, 2500.0], [1251.0, 2500.0], [40.0, 2500.0]):
        assert len({choose_steps(rates, h).explicit for h in np.geomspace(1e-6, 0.1, 100)}) == 1


@pytest.mark.parametrize("kind", ["model", "control", "fmu"])
@pytest.mark.parametrize("v0", [0.02, 0.0002])
def test_every_kind_of_component_takes_the_same_steps(kind: str, v0: float) -> None:
    """With 0.02 rad/s RK4, with steeper friction the linearly implicit method, by turns as the parameters ask."""
    block = scara().block({"v0_1": v0, "v0_2": v0})
    steps = block.automatic_steps(STEP)
    assert steps.explicit == (v0 > 0.001)
    torque = np.random.default_rng(1).normal(0, [2.0, 0.4], (40, 2))
    found = drive(component(kind, block), torque, STEP)
    expected = _by_hand(block, steps, torque)
    np.testing.assert_allclose(found[:, :4], expected, rtol=0, atol=1e-12)
    model = ModelComponent(block)
    told = integration(model, STEP)
    assert told is not None and (told.method == "RK4", told.substeps) == (steps.explicit, steps.count)


def _by_hand(block: Any, steps: Steps, torque: np.ndarray) -> np.ndarray:
    """(K, 4) positions and velocities before each step."""
    p, h = ca.DM(block.parameter_values), STEP / steps.count
    x, memory = block.start(torque[0], p), ca.DM.zeros(block.implicit.memory)
    step, rows = block.implicit.step(), []
    for u in torque:
        rows.append(x.full().ravel()[:4])
        for _ in range(steps.count):
            if steps.explicit:
                k1 = block.update(x, u, p)
                k2 = block.update(x + h / 2 * k1, u, p)
                k3 = block.update(x + h / 2 * k2, u, p)
                x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + block.update(x + h * k3, u, p))
            else:
                x, memory = step(x, memory, u, p, h)
    return np.array(rows)


def test_parameters_that_change_in_a_run_change_the_method() -> None:
    """What is remembered of a linearly implicit step is forgotten by RK4."""
    block = scara().block({"v0_1": 0.0002, "v0_2": 0.0002})
    assert not block.automatic_steps(STEP).explicit
    soft = block.with_parameters({"v0_1": 0.05, "v0_2": 0.05})
    assert soft.automatic_steps(STEP).explicit
    outputs = _softened(component("fmu", block))
    np.testing.assert_allclose(outputs, _softened(component("model", block)), rtol=0, atol=1e-12)
    forward = soft.with_parameters(
        {f"{s}_start{j + 1}": outputs[3, i + j] for i, s in ((0, "q"), (2, "dq")) for j in (0, 1)}
    )
    np.testing.assert_allclose(
        drive(component("model", forward), np.full((2, 2), [2.0, 0.4]), STEP), outputs[3:], rtol=0, atol=1e-12
    )


def _softened(made: Component) -> np.ndarray:
    """(5, 6) outputs before three steps with steep and two with soft friction."""
    instance, rows, torque = made.instantiate(), [], np.array([2.0, 0.4])
    begin(instance, torque)
    for k in range(5):
        if k == 3:
            instance.set_parameters({"v0_1": 0.05, "v0_2": 0.05})
        rows.append(advance(instance, torque, k * STEP, STEP))
    instance.close()
    return np.array(rows)
