"""The same robot as other plants: FMI 2 and 3, co-simulation and model exchange, Modelica, a vendor's tool."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.case import load_case
from fmu_didim.components import load_fmu, rename
from fmu_didim.cosim import closed_loop, decimated_times
from fmu_didim.data.signals import trajectory
from fmu_didim.estimators import Clie
from fmu_didim.model.parameters import NamedParameters
from tests.cases import scara_case
from tests.conftest import package
from tests.foreign import external_fmu
from tests.helpers import NEAR, model_on, with_torque

SCARA = "examples/scara/identify.yaml"


@pytest.mark.gate
@pytest.mark.parametrize(
    ("fmi", "options"),
    [
        ("2.0", {"interface": "co-simulation"}),
        ("3.0", {"interface": "co-simulation"}),
        pytest.param("2.0", {"interface": "model-exchange", "substeps": 16}, marks=pytest.mark.slow),
        pytest.param("3.0", {"interface": "model-exchange", "substeps": 16}, marks=pytest.mark.slow),
        ("2.0", {"interface": "co-simulation", "isolated": True}),
    ],
)
def test_every_form_of_the_fmu_gives_the_same_values(tmp_path: Path, fmi: str, options: dict[str, Any]) -> None:
    outcome = identify(scara_case(tmp_path, plant={"kind": "fmu", "fmi": fmi, **options}, controller={"fmi": fmi}))
    assert outcome.document.status == "converged"
    expected = identify(SCARA).estimate
    assert (np.abs(outcome.estimate.value - expected.value) <= NEAR * expected.standard_deviation).all()


@pytest.mark.gate
def test_modelica_plant_and_controller_are_identified() -> None:
    """The example, compiled by rumoca and integrated by the master: values as with our plant and controller, and true.

    From rest at zero: the start values that rumoca 0.9.13 takes from parameters do not follow them.
    """
    package("rumoca")
    case = load_case("examples/scara/identify_modelica.yaml")
    outcome = identify(case)
    own = {"plant": {"kind": "model", "source": None, "substeps": None}}
    own["controller"] = {"source": "../../controllers/scara_pd.yaml", "substeps": None}
    expected = identify(case.with_(**own)).estimate
    assert outcome.verdict == "valid"
    assert (np.abs(outcome.estimate.value - expected.value) <= NEAR * expected.standard_deviation).all()
    truth = np.array([3.43, 0.03, 0.82, 0.063, 0.241, 0.014, 0.013, 0.137])
    assert (np.abs(outcome.estimate.value - truth) <= 3.5 * outcome.estimate.standard_deviation).all()


@pytest.mark.parametrize("rate_hz", [100.0, 10.0])
@pytest.mark.parametrize("interface", ["model-exchange", "co-simulation"])
def test_dymola_pair_is_identified_from_torque(rate_hz: float, interface: str) -> None:
    """A vendor's controller and plant as they are; J1, J2, c, d from the torque with 1 % noise.

    In co-simulation the outputs of the controller are taken after its step: before it, it gives them as of where its
    solver has got to, so that the torque jitters by 0.5 % when a parameter changes ever so little.
    """
    exchange = interface == "model-exchange"
    place = "tests/resources of github.com/CATIA-Systems/FMPy"
    plant = load_fmu(external_fmu("Drivetrain", place), interface=interface, substeps=4 if exchange else None)
    controller = load_fmu(external_fmu("Controller", place), interface=interface, substeps=1 if exchange else None)
    step = 1e-3
    time = np.arange(5001) * step
    waves = ((2.0, 0.3), (1.0, 1.1), (0.5, 4.3), (0.3, 9.0), (0.3, 17.0))
    speed = sum(a * np.sin(2 * np.pi * f * time) for a, f in waves)
    reference = trajectory(time, {"dq1": np.asarray(speed)})
    system = closed_loop(
        rename(plant, inputs={"tau1": "tau"}, outputs={"dq1": "w"}),
        rename(
            controller.with_parameters({"PI.yMax": 1000.0}),
            inputs={"dq_ref1": "u_s", "dq1": "u_m"}, outputs={"command1": "y"},
        ),
        joint_count=1, step_size=step, reference_names=reference.names,
    )  # fmt: skip
    system = system if exchange else replace(system, after_step=frozenset({"controller"}))
    truth = np.array([1.0, 2.0, 1e4, 100.0])
    parameters = NamedParameters(
        names=("J1", "J2", "c", "d"), units=("kg.m2", "kg.m2", "N.m/rad", "N.m.s/rad"),
        plant_names=("inertia1.J", "inertia2.J", "spring.c", "spring.d"), torque_units=("N.m",), start=tuple(truth),
        lowest=(0.0,) * 4, highest=(np.inf,) * 4,
    )  # fmt: skip
    times = decimated_times(time, rate_hz)
    model = model_on(system, parameters, reference, times)
    torque = model.torque(truth)
    noise = 0.01 * torque.std() * np.random.default_rng(0).normal(size=torque.shape)
    estimate = Clie(start={"J1": 0.7, "J2": 2.6, "c": 7e3, "d": 140.0}).estimate(with_torque(model, torque + noise))
    assert (np.abs(estimate.value - truth) <= 3 * estimate.standard_deviation).all()
    certain = estimate.standard_deviation <= 0.01 * truth
    assert (np.abs(estimate.value - truth)[certain] <= 0.02 * truth[certain]).all()
