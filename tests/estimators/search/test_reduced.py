"""The reduced model: what is left out, what comes back, what is told, and what a case with it gives."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import export_robot, identify, load_case, load_result, read_robot
from fmu_didim.base.errors import IdentificationError, InputError
from fmu_didim.case import Case
from fmu_didim.data.signals import trajectory
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotModel, write_robot
from fmu_didim.estimators import no_progress
from fmu_didim.estimators.search import from_values, reduced
from fmu_didim.estimators.search.reduced import candidates, check_reducible, held_out, with_essential, worse
from fmu_didim.fit.estimate import Estimate, Status
from fmu_didim.fit.gap import Ratio
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.report import result_table
from fmu_didim.workflow import search
from fmu_didim.workflow.output.result import Result
from tests import loads
from tests.cases import SCARA
from tests.dynamics.robot.test_frames import puma
from tests.helpers import ROOT

NOISE = (0.17, 0.02)
"""[N.m] Of the torque of each joint."""
ROBOT = read_robot(ROOT / "fmus/scara/robot.yaml")
WITHOUT = {"Fv1": 0.0, "MY2": 0.0}
LABELS = {"estimation": "train_10hz.csv", "validation": "validation_10hz.csv"}


def scara(seed: int, noise: tuple[float, float] = NOISE, truth: dict[str, float] = WITHOUT, **changes: Any) -> Case:
    """The SCARA as a model, at 10 Hz, with a log of a robot that has these values."""
    case = load_case(SCARA).with_(plant={"kind": "model"}, **changes)
    machine, rng, signals = case.with_(robot=ROBOT.with_values(truth)).model, np.random.default_rng(seed), {}
    for label, file in LABELS.items():
        torque = machine.torque(machine.start, label)
        torque = torque + np.array(noise) * rng.normal(size=torque.shape)
        time = machine.experiments[label].time
        signals[file] = trajectory(time, {f"tau{j + 1}": torque[:, j] for j in range(2)})
    return case.with_signals(signals)


@cache
def answered() -> Result:
    return identify(scara(5), essential=True)


def text(result: Result) -> str:
    """What the terminal says, on one line."""
    return " ".join(result_table(result.document).split())


def test_what_the_robot_does_not_have_goes_and_the_others_are_right() -> None:
    found = answered()
    less = found.estimate.essential
    assert less is not None
    assert set(less.left_out) == {"Fv1", "MY2"}
    assert less.model is not None
    assert less.covariance is not None
    truth = ROBOT.with_values(WITHOUT)
    true = dict(zip(found.model.names, scara(5).with_(robot=truth).model.start, strict=True))
    error = [(v - true[n]) / s for n, v, s in zip(less.model.names, less.model.start, np.sqrt(np.diag(less.covariance)),
                                                  strict=True)]  # fmt: skip
    assert np.abs(error).max() < 3.5
    assert less.held_out[0].value < 1.01
    assert found.document.essential is not None
    assert found.document.essential.confirmed


def test_its_values_are_those_that_the_covariance_of_the_full_model_foretells() -> None:
    """As a loop is nearly straight over a standard deviation."""
    found = answered().estimate
    less = found.essential
    assert less is not None
    assert less.model is not None
    zero = [found.names.index(name) for name in less.left_out]
    foretold, known = (
        reduced.eliminated(found.value, found.covariance, found.freedom, zero, lambda v: "").values,
        (np.sqrt(np.diag(found.covariance))),
    )
    kept = [i for i in range(len(found.names)) if i not in zero]
    assert np.abs((less.model.start - foretold[kept]) / known[kept]).max() < 0.1


def test_the_robot_without_them_is_written_and_is_a_robot_of_a_case(tmp_path: Path) -> None:
    found = answered()
    found.save(tmp_path / "first")
    loaded = load_result(tmp_path / "first")
    assert loaded == found
    robot = loaded.essential_robot
    assert robot is not None
    values = {v.name: v.start for v in robot.standard_parameters()}
    assert values["Fv1"] == values["MY2"] == 0.0
    case = scara(5).with_(robot=robot, estimator={"start": "torque"})
    again = identify(case)
    less = found.estimate.essential
    assert less is not None
    assert less.model is not None
    assert again.estimate.names == less.model.names
    assert again.estimate.value == pytest.approx(less.model.start, rel=1e-5)
    assert again.estimate.covariance == pytest.approx(less.covariance, rel=1e-3)
    assert export_robot(case, tmp_path / "arm.urdf", result=again).away < 0.1
    plain = identify(scara(5))
    plain.save(tmp_path / "first")
    assert not (tmp_path / "first" / "robot_essential.yaml").exists()
    assert load_result(tmp_path / "first").essential_robot is None


def test_a_classical_description_has_a_reduced_one_too(tmp_path: Path) -> None:
    """Read in classical frames, written in modified ones, with the names of what is left."""
    model = RobotModel(puma(frames="standard"))
    base = base_parameters(model)
    less = RobotParameters(model, base).without(base.names[5:9])
    values = np.arange(1.0, less.count + 1)
    write_robot(less.described(values), tmp_path / "robot.yaml")
    again = RobotModel(read_robot(tmp_path / "robot.yaml"))
    found = base_parameters(again)
    assert found.names == less.names
    assert found.reduce(again.parameter_values) == pytest.approx(values)


def test_the_page_and_the_terminal_say_what_goes_and_what_that_rests_on() -> None:
    said = text(answered())
    assert "Not needed by these data: " in said
    assert "(2 of 8). F of all together is" in said
    assert "times that of the full model, of joint " in said
    assert "on others they may be" in said
    assert "exclude as little as zero: " in said


@pytest.mark.parametrize(
    ("place", "is_told"),
    [
        pytest.param(lambda p: p.std, True, id="a standard deviation from zero"),
        pytest.param(lambda p: 0.1 * p.std, False, id="nearly zero"),
        pytest.param(lambda p: 9 * p.std, False, id="excluded"),
        pytest.param(lambda p: None, False, id="none"),
    ],
)
def test_what_the_description_has_and_the_data_do_not_exclude_is_told(place: Any, is_told: bool) -> None:
    document = answered().document
    own = document.parameters["MY2"]
    own = own.model_copy(update={"value": 0.1 * own.std, "interval": (-2 * own.std, 2.2 * own.std)})
    other = own.model_copy(update={"described": place(own)})
    changed = document.model_copy(update={"parameters": {**document.parameters, "MY2": other}})
    said = " ".join(result_table(changed).split())
    assert ("A motion that tells: fmu-didim excite CASE.yaml --only MY2." in said) is is_told


def test_without_held_out_data_that_is_told() -> None:
    case = load_case({key: v for key, v in scara(5).content.items() if key != "validation"}, folder=SCARA.parent,
                     signals=scara(5).signals)  # fmt: skip
    found = identify(case, essential=True)
    assert found.document.essential is not None
    assert found.document.essential.held_out is None
    assert not found.document.essential.confirmed
    assert "No experiment is held out (validation:), so that the fitted data alone say so." in text(found)


def answer(case: Case, refit: Any = None) -> tuple[Estimate, Estimate]:
    """The estimate of a case, and the same with its reduced model."""
    found = case.estimator.estimate(case.model)

    def again(model: Any, start: Any) -> Estimate:
        return from_values(case.estimator, start).estimate(model)

    return found, with_essential(found, case.model, refit or again)


def test_what_the_held_out_motion_needs_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """One by one, until the rest serves as well."""
    ratios = [(Ratio(1.4, 1.2, 1.6),), (Ratio(1.02, 0.99, 1.04),)]
    monkeypatch.setattr(reduced, "held_out", lambda before, after: ratios.pop(0))
    more = answer(scara(5))[1]
    less = more.essential
    assert less is not None
    assert {*less.left_out, *less.put_back} == {"Fv1", "MY2"}
    assert len(less.put_back) == 1
    assert "1.4 (1.2 to 1.6) times that of the full model" in less.because
    assert not ratios


LITTLE, MUCH, PERHAPS = Ratio(1.02, 1.01, 1.03), Ratio(1.07, 1.01, 1.1), Ratio(1.07, 0.98, 1.2)


@pytest.mark.parametrize(
    ("ratios", "where"),
    [
        pytest.param([], None, id="nothing is held out"),
        pytest.param([LITTLE, LITTLE, LITTLE], None, id="surely worse, by less than matters"),
        pytest.param([PERHAPS, PERHAPS, PERHAPS], None, id="perhaps worse"),
        pytest.param([MUCH, LITTLE, PERHAPS], "residual would", id="surely worse, by much"),
        pytest.param([LITTLE, LITTLE, MUCH], "residual of joint 2 would", id="of one joint"),
        pytest.param([Ratio(np.inf, np.inf, np.inf)] * 3, "residual would", id="cannot be simulated there"),
    ],
)
def test_how_much_worse_is_worse(ratios: list[Ratio], where: str | None) -> None:
    told = worse(ratios)
    assert where in told if where else not told


def test_a_motion_that_shows_more_brings_a_parameter_back() -> None:
    """Fitted to a slow motion, in which viscous friction is a tenth of the noise; the held-out one is fast."""
    slow, fast = {"reference": {"fundamental_hz": 0.05, "duration_s": 20}}, {"reference": {"fundamental_hz": 0.2}}
    motions = {"train": slow, "validation": fast, "estimator": {"start": "torque"}}
    less = answer(scara(5, (0.3, 0.01), {"Fv1": 0.2}, **motions))[1].essential
    assert less is not None
    assert "Fv1" in less.put_back
    assert "Fv1" not in less.left_out
    assert "joint 1" in less.because


def test_a_reduced_model_without_an_answer_is_none() -> None:
    def fails(model: Any, start: Any) -> Estimate:
        raise IdentificationError("Nothing fits.", next_step="Look.")

    less = answer(scara(5), fails)[1].essential
    assert less is not None
    assert less.left_out == ()
    assert set(less.put_back) == {"Fv1", "MY2"}
    assert less.because == "without them there is no answer: Nothing fits."


def test_a_fit_that_has_not_settled_leaves_nothing_out() -> None:
    case = scara(5)
    found = replace(case.estimator.estimate(case.model), status=Status.MAXIMUM_ITERATIONS)
    less = with_essential(found, case.model, lambda model, start: found).essential
    assert less is not None
    assert less.because == "the values of the full model did not settle"
    assert less.left_out == ()


def test_an_inertia_that_noise_hides_stays() -> None:
    """Where the noise of joint 2 is as large as its torque, the data do not need its inertia, the machine does."""
    less = answer(scara(5, (0.17, 1.5)))[1].essential
    assert less is not None
    assert "ZZ2" not in less.left_out
    assert "inertia matrix is not positive definite" in less.needed["ZZ2"]


def test_a_doubtful_answer_says_so_of_its_reduced_model() -> None:
    document = answered().document.model_copy(update={"verdict": "doubtful"})
    assert "The full model is doubtful, and so is this." in " ".join(result_table(document).split())


def test_all_that_is_needed_is_told() -> None:
    found = identify(scara(6, (1e-3, 1e-4), {}), essential=True)
    assert found.essential_robot is None
    assert "All are needed: the data exclude zero for each that could be left out." in text(found)


def test_rotors_own_values_and_what_a_load_moves_are_no_candidates() -> None:
    arm = load_case(ROOT / "examples/tx40/discover_load.yaml", require_torque=False).model
    names = [arm.names[i] for i in candidates(arm)]
    assert "Ia6" in arm.names
    assert not [name for name in names if name.startswith("Ia")]
    assert {"Fv6", "XY6", "MX6", "ZZ6"} <= set(names)
    own = load_case(ROOT / "examples/scara/two_payloads.yaml").model
    assert [own.names[i] for i in candidates(own)] == ["Fv1", "Fc1", "MY2", "Fv2", "Fc2"]
    loaded = loads.case_of().model
    assert [loaded.names[i] for i in candidates(loaded)] == ["Fv1", "Fc1", "Fv2", "Fc2"]


def test_a_load_keeps_its_parameters_and_a_virtual_controller_its_share() -> None:
    case = loads.case_of(2)
    full = case.estimator.estimate(case.model)
    start = {name: float(v) for name, v in zip(full.names, full.value, strict=True) if name != "Fv1"}
    less = search._refitted(case, no_progress, case.model.without(["Fv1"]), start)
    assert less.names == tuple(name for name in full.names if name != "Fv1")
    load = [i for i, name in enumerate(less.names) if name.startswith("load_")]
    here = [full.names.index(less.names[i]) for i in load]
    assert np.abs((less.value[load] - full.value[here]) / full.standard_deviation[here]).max() < 1
    assert less.choices is not None
    assert (less.standard_deviation >= less.choices.noise_alone).all()
    assert (less.standard_deviation > 1.01 * less.choices.noise_alone).any()


def test_least_squares_on_measured_motion_has_a_reduced_model_too() -> None:
    case = loads.case_of(3, load={"mass": 2.0, "centre": [0.12, -0.03, 0], "inertia": [0, 0, 0.004, 0, 0, 0]})
    case = case.with_(estimator={"kind": "idim_ls", "cutoff_hz": 40})
    found, more = answer(case)
    less = more.essential
    assert less is not None
    assert less.f <= less.limit or not less.left_out
    assert found.fit is None


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        pytest.param({"prior": {"towards": "published.yaml", "relative_std": 0.2}}, "Beside a prior", id="prior"),
        pytest.param({"train": {"torque": {"unsigned": True}}}, "without signs", id="unsigned"),
    ],
)
def test_what_cannot_be_reduced_is_refused_at_once(changes: dict[str, Any], said: str) -> None:
    pendulum = load_case(ROOT / "examples/double_pendulum/identify.yaml")
    with pytest.raises(InputError, match=said):
        identify(pendulum.with_(**changes), essential=True)


def test_a_plant_without_description_is_refused_at_once() -> None:
    with pytest.raises(InputError, match="zero means without them"):
        check_reducible(load_case(ROOT / "examples/house/identify.yaml").model)


def test_held_out_data_that_cannot_be_simulated_are_infinitely_worse() -> None:
    found = answered().estimate
    broken = replace(found, model=found.model.with_values(np.where(found.value > 1, -1.0, found.value)))
    assert held_out(found, replace(broken, fit=None)) == (Ratio(np.inf, np.inf, np.inf),) * 3
