"""The motion that a measured torque implies, against the motion of the simulation that the torque is from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest

from fmu_didim.base.errors import SimulationError
from fmu_didim.case import load_case
from fmu_didim.components.user_control import wrap_control
from fmu_didim.cosim import Connection
from fmu_didim.data.signals import Array
from fmu_didim.estimators.starts.inverse_simulation import implied_motion, light_plant
from fmu_didim.estimators.starts.reference_start import whole_reference
from fmu_didim.model.loop_model import LoopModel
from tests.cases import TRUTH

CONTROLLERS = Path("controllers").resolve()
NEAR_ENOUGH = 3e-4
"""rad: the computed torque of the true robot tracks so well that nothing is left to be told by the torque."""


def scara(**changes: object) -> LoopModel:
    """The SCARA with torque at 200 Hz of the true values, without noise."""
    model = load_case("examples/scara/identify_200hz.yaml").with_(**changes).model
    assert model is not None
    experiment = model.experiments["estimation"]
    return model.with_experiment("estimation", replace(experiment, torque=model.torque(TRUTH, "estimation")))


def tracking_and_rest(model: LoopModel) -> tuple[Array, Array]:
    """(n,) how far the true motion is from the reference, and from what the torque implies; where the start is over."""
    recording = model.simulation(TRUTH, "estimation").record(all_ticks=True)
    true = recording.table(model.loop.joint_signals("q"))
    begun = slice(true.shape[0] // 10, -true.shape[0] // 10)
    run = model.simulation(model.start, "estimation")
    tracking = true - whole_reference(run)[0]
    rest = true - implied_motion(run)[0]
    return tuple(np.sqrt((error[begun] ** 2).mean(axis=0)) for error in (tracking, rest))


@pytest.mark.gate
@pytest.mark.parametrize(
    ("changes", "most"),
    [
        ({"controller": {"kind": "fmu", "source": str(CONTROLLERS / "scara_pd.yaml")}}, 0.25),
        ({"controller": {"kind": "model", "source": str(CONTROLLERS / "scara_cascade.yaml")}}, 0.25),
        ({"controller": {"kind": "model", "source": str(CONTROLLERS / "scara_pid.yaml")}}, 0.25),
        ({"controller": {"kind": "model", "source": str(CONTROLLERS / "scara_computed_torque.yaml")}}, 0.25),
        ({"controller": {"kind": "control", "source": f"{CONTROLLERS / 'scara_pd_control.py'}:controller"}}, 0.25),
        ({"loop": {"delay_samples": 1.5}}, 0.4),
    ],
    ids=["PD FMU", "cascade", "PID", "computed torque", "python-control", "delay"],
)
def test_motion_follows_from_the_torque(changes: dict[str, object], most: float) -> None:
    """The bandwidth is 8 Hz at a control rate of 200 Hz, less with a delay; what friction does faster is left."""
    tracking, rest = tracking_and_rest(scara(**changes))
    assert (rest <= np.maximum(most * tracking, NEAR_ENOUGH)).all()


def test_controller_that_does_not_look_is_not_inverted() -> None:
    """One whose command is the reference alone: any motion gives its torque."""
    system = control.ss([], [], [], [[1.0, 0.0], [0.0, 1.0]], 0.005)
    blind = wrap_control(control.ss(system, inputs=["q_ref1", "q_ref2"], outputs=["command1", "command2"]))
    model = scara()
    systems = {}
    for label, loop in model.loop.systems.items():
        kept = [c for c in loop.connections if not c.target.startswith("controller.")]
        wires = [Connection(f"reference.q{j}", f"controller.q_ref{j}") for j in (1, 2)]
        components = {**loop.components, "controller": blind}
        systems[label] = replace(loop, components=components, connections=(*kept, *wires))
    with pytest.raises(SimulationError, match="does not follow from the motion of the joints"):
        implied_motion(model.with_loop(systems=systems).simulation(model.start, "estimation"))


def test_light_plant_is_that_of_its_equation() -> None:
    """ddq = tau/m + drive - r dq with held inputs, against its closed solution; a rate of zero and one near it."""
    step, mass, rate = 0.01, np.array([2.0, 0.5, 4.0]), np.array([3.0, 0.0, 1e-9])
    q, dq, tau, drive = np.random.default_rng(3).normal(size=(4, 3))
    instance = light_plant(step, 1 / mass, rate, np.concatenate([q, dq])).instantiate()
    instance.begin_initialisation(0.0)
    instance.inputs[:] = [*tau, *drive]
    instance.set()
    instance.end_initialisation()
    instance.get()
    force = tau / mass + drive
    np.testing.assert_allclose(instance.outputs, [*q, *dq, *(force - rate * dq)], rtol=1e-12)
    instance.step(0.0, step)
    instance.get()
    end = dq[0] * np.exp(-rate[0] * step) + force[0] * (1 - np.exp(-rate[0] * step)) / rate[0]
    np.testing.assert_allclose(instance.outputs[3:6], [end, *(dq + force * step)[1:]], rtol=1e-8)
    moved = q[0] + (dq[0] - end + force[0] * step) / rate[0]
    np.testing.assert_allclose(instance.outputs[:3], [moved, *(q + dq * step + force * step**2 / 2)[1:]], rtol=1e-8)
