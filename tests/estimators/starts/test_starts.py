"""Starts from a motion that was not simulated: six joints, where errors of the motion drown the light links."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.estimators import local_minima
from fmu_didim.estimators.didim import Didim
from fmu_didim.estimators.finish import Minimum, integration_error
from fmu_didim.estimators.local_minima import Valley, folded_inertias, lowest
from fmu_didim.estimators.starts.reference_start import from_reference
from fmu_didim.estimators.starts.start import start_sequence, start_values
from fmu_didim.fit.fit import point
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.fit.statistics import relative_error_percent
from fmu_didim.model.loop_model import LoopModel
from tests.checks.data.right import loaded
from tests.helpers import ROOT
from tests.tools.benchmarks import tx40
from tests.tools.verdict.catalogue import right
from tests.tools.verdict.run import answer, named

PD_1_KHZ = ROOT / "examples/tx40/pd_1khz.yaml"
NOISE = 0.01
"""Of the torque of each joint."""


@cache
def empty(folder: Path) -> LoopModel:
    """The TX40 at 1 kHz along a first motion, without data."""
    motion, time = tx40.excitation(duration_s=10.0), np.arange(1000) / 100
    path = tx40.write_case(folder, motion, time, np.zeros((1000, 6)), controller=PD_1_KHZ)
    return load_case(path).model


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("tx40")


def measured(folder: Path, seed: int) -> LoopModel:
    """The same along another motion, with torque at 100 Hz and noise."""
    model, label = empty(folder), "estimation"
    reference = tx40.excitation(seed=seed, duration_s=10.0).trajectory(1000)
    model = model.with_experiment(label, replace(model.experiments[label], reference=reference))
    torque = model.torque(model.start)
    noise = NOISE * np.sqrt((torque**2).mean(axis=0)) * np.random.default_rng(seed).normal(size=torque.shape)
    return model.with_experiment(label, replace(model.experiments[label], torque=torque + noise))


@pytest.mark.gate
@pytest.mark.parametrize("seed", [1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 9))])
def test_torque_start_is_usable_for_any_motion(folder: Path, seed: int) -> None:
    model = measured(folder, seed)
    values = start_values(model, "torque")
    assert mass_matrix_problem(model, values) == ""
    error = relative_error_percent(model.measured, model.torque(values))[0]
    assert error <= 3 * 100 * NOISE


@pytest.mark.gate
def test_reference_alone_does_not_start_most_motions(folder: Path) -> None:
    """Why the motion is taken from the torque: least squares along the reference, without more."""
    problems = [mass_matrix_problem(model, from_reference(model)) for model in (measured(folder, s) for s in (2, 4, 5))]
    assert all("not positive definite" in problem for problem in problems)


@pytest.mark.gate
def test_nominal_start_stays_with_what_the_data_do_not_show(folder: Path) -> None:
    """Two seconds of a log at 10 Hz hardly show 52 parameters; those of the description hold them."""
    model = measured(folder, 1)
    label = model.first
    experiment, few = model.experiments[label], np.arange(0, 200, 2)
    operator = replace(
        experiment.operator, ticks=experiment.operator.ticks[few], matrix=experiment.operator.matrix[few][:, few]
    )
    model = model.with_experiment(
        label, replace(experiment, time=experiment.time[few], torque=experiment.torque[few], operator=operator)
    )
    values = start_values(model, "nominal")
    assert mass_matrix_problem(model, values) == ""
    far = np.abs(values - model.start) / np.maximum(np.abs(model.start), 1e-2)
    assert np.median(far) < 0.3


@pytest.mark.parametrize(
    ("start", "expected"),
    [
        ("torque", ("torque", "reference", "nominal", "description")),
        ("reference", ("reference", "torque", "nominal", "description")),
        ({"ZZ1R": 1.0}, ({"ZZ1R": 1.0}, "torque", "reference", "nominal", "description")),
    ],
    ids=["torque", "reference", "values"],
)
def test_other_starts_follow(folder: Path, start: object, expected: tuple[object, ...]) -> None:
    assert start_sequence(empty(folder), start) == expected


@pytest.mark.slow
def test_second_minimum_is_left(folder: Path) -> None:
    """The loop of joint 6 resonates at 71 Hz, seen at 100 Hz: from a third of its motor inertia back to the truth."""
    model = measured(folder, 2)
    truth, place = model.start, model.names.index("Ia6")
    begin = truth.copy()
    begin[place] /= 3
    estimate = Didim(start=dict(zip(model.names, begin, strict=True))).estimate(model)
    assert (np.abs(estimate.value - truth) <= 4 * estimate.standard_deviation).all()
    assert estimate.remarks[-1].startswith("The torque error has several minima along Ia6")
    assert not estimate.rivals


@pytest.mark.gate
def test_resonances_above_half_the_rate_of_the_log(folder: Path) -> None:
    """Joint 6, whose controller is a spring of Kp Ktau N.m/rad and whose inertia is Ia6 + ZZ6, swings at 71 Hz."""
    model = measured(folder, 2)
    folded = folded_inertias(model, model.start)
    spring, inertia = 358.858725 * 6.56, 0.0114 + 0.000353
    assert next(iter(folded)) == model.names.index("Ia6")
    assert folded[model.names.index("Ia6")] == pytest.approx(100 * 2 * np.pi / np.sqrt(spring / inertia), rel=0.02)
    assert all(distance < 2 for distance in folded.values())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1002, 1003, 1006])
def test_minima_are_told_apart_at_20_hz(seed: int) -> None:
    """There they lie 3 to 30 % of the inertia apart, and from the usual start the iterations end in a wrong one."""
    found = answer(right("tx40", seed, rate_hz=20.0), named(loaded("tx40")))
    assert found.farthest <= 4


@pytest.mark.slow
def test_a_minimum_that_is_nearly_as_low_is_a_rival(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By how much another one may be worse decides, and nothing else."""
    model = measured(folder, 2)
    fit = point(model, NoiseOfResidual(model))
    minimum = Minimum(fit, integration_error(fit), fit_uncertainty(fit))
    place = model.names.index("Ia6")
    for worse, told in ((10.7, True), (10.9, False)):
        valley = Valley(place, 0.5, fit.chi_square + worse)
        monkeypatch.setattr(local_minima, "valleys", lambda _, valley=valley: [valley])
        found = lowest(minimum, finish=fail)
        assert found.rivals == ((("Ia6", pytest.approx(0.5 * fit.values[place])),) if told else ())


def fail(_: object) -> Minimum:
    raise AssertionError("nothing is lower")
