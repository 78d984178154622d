"""The EMPS benchmark: real measured data, against the published values (Janot, Gautier, Brunot 2019)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import identify
from fmu_didim.case import Case, load_case
from fmu_didim.checks.validation import validate_on
from fmu_didim.estimators import Didim, OutputError
from fmu_didim.fit.estimate import Estimate, Status
from tests.conftest import needs_emps

pytestmark = needs_emps
PUBLISHED = np.array([95.1089, 203.5034, 20.3935, -3.1648])
WITHIN = np.array([0.005, 0.04, 0.03, 0.06])


def emps_case(folder: Path, rate_hz: float | None, *, phase_s: float | None = None, sampling: str = "point") -> Case:
    """The example with another torque rate; None is the full rate of 1 kHz."""
    source = Path("examples/emps")
    content = yaml.safe_load((source / "identify.yaml").read_text(encoding="utf-8"))
    torque = content["train"]["torque"]
    for key in ("rate_hz", "phase_s"):
        torque.pop(key)
    if rate_hz is not None:
        # A sample stands for the middle of its period, as in the example.
        torque |= {"rate_hz": rate_hz, "phase_s": 0.5 / rate_hz if phase_s is None else phase_s, "sampling": sampling}
    content["robot"] = str((source / content["robot"]).resolve())
    content["controller"]["source"] = str((source / content["controller"]["source"]).resolve())
    for experiment in ("train", "validation"):
        for part in ("reference", "torque"):
            name = content[experiment][part]["file"].removeprefix("data:")
            content[experiment][part]["file"] = str(_data() / name)
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return load_case(path)


def _data() -> Path:
    from fmu_didim.case.files import data_folder

    return data_folder(Path(__file__).parent).resolve()


def full_rate_errors(estimate: Estimate, folder: Path) -> tuple[float, float]:
    """Simulated force error in % on the estimation and the validation set, both at 1 kHz."""
    full = emps_case(folder, None).model
    assert full is not None
    found = [validate_on(full, estimate.base_value, label) for label in ("estimation", "validation")]
    assert [v.role for v in found] == ["estimation", "validation"]
    return found[0].total_percent, found[1].total_percent


@pytest.mark.gate
@pytest.mark.parametrize(
    "rate_hz",
    [None, 100, *(pytest.param(r, marks=pytest.mark.slow) for r in (10, 4))],
    ids=["1 kHz", "100 Hz", "10 Hz", "4 Hz"],
)
def test_every_start_gives_the_published_values(tmp_path: Path, rate_hz: float | None) -> None:
    case = emps_case(tmp_path, rate_hz)
    assert case.model is not None
    first: Estimate | None = None
    for mass in (20, 60, 120, 250, 500):
        estimate = Didim(start={"M": mass}).estimate(case.model)
        assert estimate.status is Status.CONVERGED
        assert estimate.iteration_count <= 6, f"start M = {mass}"
        first = first or estimate
        assert not any(colour.is_louder for colour in estimate.colours)  # its misfit is no noise
        np.testing.assert_allclose(estimate.value, first.value, rtol=1e-4)
    assert first is not None
    direct, cross = full_rate_errors(first, tmp_path)
    assert direct <= (4.6 if rate_hz != 4 else 4.7)
    assert cross <= 5.4
    if rate_hz != 4:
        assert (np.abs(first.value / PUBLISHED - 1) <= WITHIN).all()


def test_far_start_is_recovered(tmp_path: Path) -> None:
    """[1000, 1000, 100, 20] leads unguarded to no mass and negative friction."""
    case = emps_case(tmp_path, 100)
    assert case.model is not None
    start = {"M": 1000.0, "Fv": 1000.0, "Fc": 100.0, "offset": 20.0}
    estimate = Didim(start=start).estimate(case.model)
    assert any("restarted from the reference trajectory" in it.note for it in estimate.iterations)
    assert (np.abs(estimate.value / PUBLISHED - 1) <= WITHIN).all()


@pytest.mark.gate
def test_delay_moves_the_mass_and_can_be_estimated(tmp_path: Path) -> None:
    case = emps_case(tmp_path, 100)
    assert case.model is not None
    by_delay = {d: Didim().estimate(case.model.with_delay(d)) for d in (0.0, 0.5, 1.0)}
    errors = [np.linalg.norm(e.residual) for e in by_delay.values()]
    assert errors[0] < errors[1] < errors[2]
    assert abs(by_delay[1.0].value[0] - by_delay[0.0].value[0]) > 1.5 * by_delay[0.0].standard_deviation[0]
    estimate = Didim(estimate_delay=True).estimate(case.model.with_delay(0.5))
    assert estimate.names[-1] == "delay"
    assert 0 <= estimate.value[-1] < 0.2
    assert estimate.standard_deviation[-1] < 0.1


@pytest.mark.gate
def test_idim_ls_gives_the_published_values() -> None:
    outcome = identify("examples/emps/identify_idim_ls.yaml")
    np.testing.assert_allclose(outcome.estimate.value, PUBLISHED, rtol=0.005)
    fit = 100 * np.linalg.norm(outcome.estimate.residual) / np.linalg.norm(outcome.estimate.measured)
    assert abs(fit - 4.0834) < 0.1
    # Published standard deviations; the residual is model error for the most part, which is anything but white.
    stage = outcome.estimate.stages["idim_ls"]
    assert (outcome.estimate.standard_deviation > 1.5 * stage.formulas["paper"]).all()
    np.testing.assert_allclose(stage.formulas["paper"], [0.1085, 1.146, 0.1012, 0.0444], rtol=0.05)


@pytest.mark.gate
def test_torque_where_it_acts_leaves_less_of_a_measured_machine() -> None:
    """By an eighth less than at the instants of the samples, and less on the held-out motion, too."""
    case, left = load_case("examples/emps/identify_idim_ls.yaml"), dict[bool, float]()
    held_out = dict[bool, float]()
    for held in (False, True):
        outcome = identify(case.with_(estimator={**case.content["estimator"], "held": held, "sharp_coulomb": False}))
        left[held] = float(np.linalg.norm(outcome.estimate.residual) / np.linalg.norm(outcome.estimate.measured))
        held_out[held] = outcome.validations[1].total_percent
    assert left[True] < 0.95 * left[False]
    assert held_out[True] < held_out[False]


def test_output_error_on_positions_agrees() -> None:
    case = load_case("examples/emps/identify_idim_ls.yaml")
    assert case.model is not None
    estimate = OutputError(start={"M": 80.0, "Fv": 150.0, "Fc": 15.0}).estimate(case.model)
    assert estimate.status is Status.CONVERGED
    np.testing.assert_allclose(estimate.value, PUBLISHED, rtol=0.01)
