"""Pushes of a simulated robot: found with their times and torques, and not found where there are none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.discovery.base_model import prepare
from fmu_didim.discovery.external_torques.fit import FittedExternalTorques, find_external_torques
from fmu_didim.fit.fit import Fit
from fmu_didim.model.external_torque import ExternalTorque
from tests.discovery.helpers import base_of, with_torque
from tests.discovery.vendor import vendor_case

SAMPLE_S = 0.01


def pushed_data(folder: Path, external_torques: tuple[ExternalTorque, ...]) -> Fit:
    """The base fit to data of a complete model that was pushed, with noise."""
    base = load_case(vendor_case(folder)).model
    assert base is not None
    model = prepare(base).fit.model
    change = model.pushed("estimation", external_torques).torque(model.start) - model.torque(model.start)
    return prepare(with_torque(base, base.measured + change)).fit


@pytest.mark.gate
@pytest.mark.parametrize(
    "is_logged", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["on the joint", "in the command"]
)
def test_a_push_is_found_with_its_times_and_torque(tmp_path: Path, is_logged: bool) -> None:
    truth = (ExternalTorque(1, 2.3137, 2.9512, 6.0, is_logged), ExternalTorque(1, 7.0288, 7.4433, -4.0, is_logged))
    fitted_torques = find_external_torques(pushed_data(tmp_path, truth))
    assert fitted_torques is not None
    assert [(p.joint, p.is_logged) for p in fitted_torques.external_torques] == [(1, is_logged)] * 2
    for got, wanted in zip(fitted_torques.external_torques, truth, strict=True):
        assert abs(got.begin_s - wanted.begin_s) < SAMPLE_S / 2
        assert abs(got.end_s - wanted.end_s) < SAMPLE_S / 2
        assert got.torque == pytest.approx(wanted.torque, rel=0.03)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("hidden", "values"), [("", {}), ("stribeck", {"Fs": 0.4, "vs": 0.2})], ids=["nothing", "friction"]
)
def test_no_push_is_found_where_there_is_none(tmp_path: Path, hidden: str, values: dict[str, float]) -> None:
    assert find_external_torques(base_of(vendor_case(tmp_path, hidden, **values))) is None


@pytest.mark.gate
def test_a_torque_that_comes_back_with_the_motion_is_no_push(tmp_path: Path) -> None:
    truth = tuple(ExternalTorque(1, 2.3 + 4.0 * k, 2.9 + 4.0 * k, 6.0) for k in range(3))
    assert find_external_torques(pushed_data(tmp_path, truth)) is None


@pytest.mark.gate
def test_pushes_that_a_model_needs_stay_and_others_are_superfluous(tmp_path: Path) -> None:
    """As where an effect that was found beside them explains what they had stood for."""
    push = ExternalTorque(1, 2.3137, 2.9512, 6.0, False)
    needed = find_external_torques(pushed_data(tmp_path / "pushed", (push,)))
    assert needed is not None and needed.superfluous_beside(needed.fit) is None

    base = pushed_data(tmp_path / "calm", ())
    model = base.model.pushed("estimation", (replace(push, torque=0.01),))
    held = replace(base, model=model, outputs=model.outputs(base.values))
    free = replace(held, values=np.append(held.values, np.zeros(4)))
    without = FittedExternalTorques(held, free, "estimation", 1.0, 0.7).superfluous_beside(held)
    assert without is not None and without.model.experiments["estimation"].external_torques == ()
    assert without.chi_square == pytest.approx(base.chi_square, rel=1e-3)
