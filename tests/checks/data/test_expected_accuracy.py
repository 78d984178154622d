"""What is predicted before an identification: standard deviations, and loops that ring above what a log shows."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim import check, identify
from fmu_didim.case import load_case
from fmu_didim.checks.data.expected_accuracy import predicted, resonance_diagnostics, resonances, ringing
from tests.checks.data.right import loaded
from tests.loads import case_of, free_gains

SCARA = "examples/scara/identify_200hz.yaml"
STEP = 0.005


@pytest.mark.gate
def test_predicted_standard_deviations_are_those_of_the_identification() -> None:
    ahead = check(SCARA).prospect
    assert ahead is not None
    estimate = identify(SCARA).estimate
    assert ahead.names == estimate.names
    np.testing.assert_allclose(ahead.deviation / estimate.standard_deviation, 1.0, atol=0.35)


def test_prediction_by_hand() -> None:
    """Two columns of which the second is nearly the first: (S'S)^-1 written out."""
    model = loaded("scara")
    a, b = np.random.default_rng(0).normal(size=(2, 50))
    columns = np.column_stack([a, a + 0.1 * b, *np.eye(50)[:6]])
    values = np.array([1.0, 0.001, 3.0, 3.0, 3.0, 1.9, 3.0, 3.0])
    found = predicted(model, values, columns)
    assert found is not None
    expected = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    np.testing.assert_allclose(found.deviation, expected, rtol=1e-9)
    assert found.partner[0][0] == model.names[1] and found.partner[1][0] == model.names[0]
    assert {model.names[i] for i in np.flatnonzero(np.abs(values) < 2 * expected)} == set(found.insignificant)
    assert predicted(model, values, np.zeros((50, 8))) is None


@pytest.mark.parametrize(
    ("response", "expected"),
    [
        (lambda t: np.exp(-5 * t) * np.cos(2 * np.pi * 30 * t), 30.0),
        (lambda t: np.exp(-20 * t), 0.0),
        (lambda t: np.exp(-20 * t) * np.cos(10 * t), 0.0),
        (lambda t: 0 * t, 0.0),
    ],
)
def test_ringing(response, expected: float) -> None:  # type: ignore[no-untyped-def]
    assert ringing(response(np.arange(400) * STEP), STEP) == pytest.approx(expected, abs=0.5)


def test_loop_that_rings_between_the_samples_is_told() -> None:
    """Joint 1 with a tenth of its damping: a frequency of sqrt(Kp / M11), M11 with the second link where it starts."""
    case = load_case("examples/scara/identify.yaml")
    assert resonance_diagnostics(case.model, case.model.start) == []
    loose = case.with_(controller={"parameters": {"Kd1": 23.0}}).model
    q2 = float(loose.experiments["estimation"].reference.column("q2")[0])
    zz1, _, _, zz2, mx2, my2, *_ = loose.start
    inertia = zz1 + zz2 + 2 * 0.5 * (mx2 * np.cos(q2) - my2 * np.sin(q2))
    expected = np.sqrt(3700 / inertia) / (2 * np.pi)
    assert resonances(loose, loose.start)[0] == pytest.approx(expected, rel=0.15)
    slow = case.with_(controller={"parameters": {"Kd1": 23.0}}, train={"torque": {"rate_hz": 5}}).model
    (found,) = resonance_diagnostics(slow, slow.start)
    assert (found.place, found.bound) == ("joint 1", pytest.approx(2.5))


@pytest.mark.gate
def test_wrist_of_the_tx40_rings_above_half_the_rate_of_its_log() -> None:
    """sqrt(gain Kp / (ZZ6 + Ia6)) of a rigid joint, but for its damping and delay, in a log at 100 Hz."""
    model = loaded("tx40")
    (found,) = resonance_diagnostics(model, model.start)
    inertia = model.start[model.names.index("ZZ6")] + model.start[model.names.index("Ia6")]
    expected = np.sqrt(6.56 * 358.858725 / inertia) / (2 * np.pi)
    assert found.place == "joint 6" and found.value == pytest.approx(expected, rel=0.1)


@pytest.mark.gate
@pytest.mark.parametrize("tracking", [False, True], ids=["controller known", "nobody knows it"])
def test_prediction_is_what_an_identification_states_of_filtered_torques_too(tracking: bool) -> None:
    """The samples of a filtered torque are not independent: counted so, they would predict two thirds of it."""
    case = case_of(4, tracking=tracking, load={"mass": 2.0, "mass_std": 0.01}, identify=free_gains())
    if not tracking:
        case = case.with_(low_pass={"cutoff_hz": 20.0})
    ahead, found = check(case).prospect, identify(case)
    assert ahead is not None
    stated = np.array([found.parameters[name].std for name in ahead.names])
    ratio = ahead.deviation / stated
    assert np.exp(np.mean(np.log(ratio))) == pytest.approx(1.0, abs=0.1), dict(zip(ahead.names, ratio, strict=True))
