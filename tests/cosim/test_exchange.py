"""Model exchange in the compiled loop: the same as in Python, inputs on straight lines, events, and what fails."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import control
import numpy as np
import pytest

from fmu_didim.base.errors import SimulationError
from fmu_didim.components import Component, load_fmu, wrap_control
from fmu_didim.components.fmu import model_exchange
from fmu_didim.cosim import Connection, Recording, System, simulate
from fmu_didim.data.signals import Trajectory, Variable, trajectory
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu
from tests.awkward.build import EVENTS, library, pack
from tests.helpers import begin, ports

RATE, STEP = 0.8, 0.5


def lag(update: ca.SX | None = None) -> Block:
    """x' = -a x + u, x(0) = 0, y = x."""
    x, u, p = ca.SX.sym("x", 1), ca.SX.sym("u", 1), ca.SX.sym("p", 1)
    return Block(
        name="lag",
        inputs=ports("u"),
        outputs=ports("y", causality="output"),
        states=ports("x", causality="local"),
        parameters=(Variable("a", causality="parameter", start=RATE),),
        update=ca.Function("update", [x, u, p], [-p * x + u if update is None else update]),
        output=ca.Function("output", [x, u, p], [x]),
        start=ca.Function("start", [u, p], [ca.SX(0)]),
    )


def driven(component: Component, inputs: Trajectory, *, ramps: bool = True) -> System:
    return System(
        components={"model": component}, connections=(Connection("reference.u", "model.u"),), order=("model",),
        step_size=STEP, ramps=frozenset({"u"}) if ramps else frozenset(),
    )  # fmt: skip


def zigzag(count: int = 60) -> Trajectory:
    return trajectory(STEP * np.arange(count), {"u": np.random.default_rng(3).normal(size=count)})


def exact(inputs: Trajectory, *, ramps: bool) -> np.ndarray:
    """The solution from tick to tick, for inputs u + s t: x = e^(-a t) (x0 - c) + c + s t / a, c = u / a - s / a^2."""
    u, x, found = inputs.values[:, 0], 0.0, []
    for k in range(u.size):
        found.append(x)
        slope = (u[k + 1] - u[k]) / STEP if ramps and k + 1 < u.size else 0.0
        c = u[k] / RATE - slope / RATE**2
        x = np.exp(-RATE * STEP) * (x - c) + c + slope * STEP / RATE
    return np.array(found)


def outputs(recording: Recording) -> np.ndarray:
    return recording.sampled["model.y"]


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("ramps", [True, False])
@pytest.mark.parametrize(("solver", "error"), [("rk4", 1e-7), ("cvode", 1e-6)])
def test_inputs_are_held_or_go_straight_to_the_next_tick(version: str, ramps: bool, solver: str, error: float) -> None:
    inputs = zigzag()
    made = load_fmu(build_fmu(lag(), fmi_version=version), interface="model-exchange", solver=solver)
    made = made.with_substeps(20) or made
    wanted = exact(inputs, ramps=ramps)
    fast, slow = (simulate(driven(made, inputs, ramps=ramps), inputs, compiled=c) for c in (True, False))
    for recording in (fast, slow):
        np.testing.assert_allclose(outputs(recording), wanted, rtol=0, atol=error * np.abs(wanted).max())
    if solver == "rk4":
        np.testing.assert_array_equal(outputs(fast), outputs(slow))
    assert np.abs(exact(inputs, ramps=True) - exact(inputs, ramps=False)).max() > 0.1


def test_a_second_run_holds_its_inputs_again() -> None:
    """An instance that is run again has no slopes left."""
    from fmu_didim.cosim import InstancePool

    inputs, pool = zigzag(), InstancePool()
    made = load_fmu(build_fmu(lag()), interface="model-exchange")
    for ramps in (True, False, True):
        for compiled in (True, False):
            got = simulate(driven(made, inputs, ramps=ramps), inputs, compiled=compiled, pool=pool)
            np.testing.assert_allclose(outputs(got), exact(inputs, ramps=ramps), rtol=0, atol=1e-6)
    pool.close()


@pytest.mark.parametrize("kind", ["fmu 2", "fmu 3", "linear"])
def test_what_holds_its_inputs_holds_them_halfway(kind: str) -> None:
    """Outputs at a tick are those of the inputs there; the step begins with the mean over it."""
    inputs = zigzag()
    u = inputs.values[:, 0]
    made: Component
    if kind == "linear":
        made = wrap_control(control.ss([[-RATE]], [[1.0]], [[1.0]], [[0.5]]), substeps=20)
        through = 0.5
    else:
        found = load_fmu(build_fmu(lag(), fmi_version=f"{kind[-1]}.0")).with_substeps(200)
        assert found is not None
        made, through = found, 0.0
    assert not made.follows_ramps
    made = replace_names(made)
    fast, slow = (simulate(driven(made, inputs), inputs, compiled=c) for c in (True, False))
    np.testing.assert_array_equal(outputs(fast), outputs(slow))
    means = trajectory(inputs.time, {"u": np.append((u[1:] + u[:-1]) / 2, u[-1])})
    wanted = exact(means, ramps=False) + through * u
    np.testing.assert_allclose(outputs(fast), wanted, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(fast.inputs["model.u"], u)  # what is recorded is what acts at the tick


def replace_names(component: Component) -> Component:
    """The component with an input u and an output y."""
    return component.with_names(
        (replace(component.inputs[0], name="u"),), (replace(component.outputs[0], name="y"),)
    )  # fmt: skip


@pytest.mark.parametrize("solver", ["rk4", "cvode"])
def test_events_are_those_of_the_loop_in_python(tmp_path: Path, solver: str) -> None:
    made = load_fmu(pack(tmp_path / "events.fmu", EVENTS, library("events")), solver=solver, substeps=7)
    made = replace(made, isolated=False)
    inputs = trajectory(0.1 * np.arange(15), {"u": np.linspace(-1, 1, 15)})
    system = replace(driven(made, inputs, ramps=False), step_size=0.1)
    fast, slow = (outputs(simulate(system, inputs, compiled=c)) for c in (True, False))
    np.testing.assert_allclose(fast, slow, rtol=0, atol=0 if solver == "rk4" else 1e-7)


@pytest.mark.parametrize("compiled", [True, False])
def test_states_that_run_away_are_told(compiled: bool, capfd: pytest.CaptureFixture[str]) -> None:
    """x' = exp(exp(x)) has no solution for long: CVode gives up, says when, and prints nothing by itself."""
    x = ca.SX.sym("x", 1)
    u, p = ca.SX.sym("u", 1), ca.SX.sym("p", 1)
    block = replace(lag(), update=ca.Function("update", [x, u, p], [ca.exp(ca.exp(x)) + 0 * u * p]))
    made = load_fmu(build_fmu(block), interface="model-exchange", solver="cvode")
    inputs = zigzag(20)
    with pytest.raises(SimulationError, match="CVode could not integrate") as caught:
        simulate(driven(made, inputs), inputs, compiled=compiled)
    assert "t = 0" in str(caught.value)
    assert "".join(capfd.readouterr()) == ""


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (model_exchange.ENDED, "ended the simulation"),
        (model_exchange.NO_END_OF_EVENTS, "event iteration of the FMU does not end"),
        (-3, "CVode could not integrate"),
    ],
)
def test_every_end_below_zero_has_words(status: int, words: str) -> None:
    instance = load_fmu(build_fmu(lag()), interface="model-exchange").instantiate()
    begin(instance, np.zeros(1))
    native = instance.native()
    assert native is not None and native.exchange is not None  # type: ignore[union-attr]
    assert words in str(native.exchange.explain(status, 0.25))  # type: ignore[union-attr]
    instance.close()
