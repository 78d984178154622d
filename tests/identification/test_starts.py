"""Starts from a motion that was not simulated: six joints, where errors of the motion drown the light links."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.estimators.didim import Didim
from fmu_didim.identification.second_minimum import folded_inertias
from fmu_didim.identification.start import start_sequence, start_values
from fmu_didim.prediction.guard import mass_matrix_problem
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.reference_start import from_reference
from fmu_didim.statistics import relative_error_percent
from tests.benchmarks import tx40
from tests.helpers import ROOT

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


@pytest.mark.parametrize("seed", range(1, 9))
def test_torque_start_is_usable_for_any_motion(folder: Path, seed: int) -> None:
    model = measured(folder, seed)
    values = start_values(model, "torque")
    assert mass_matrix_problem(model, values) == ""
    error = relative_error_percent(model.measured, model.torque(values))[0]
    assert error <= 3 * 100 * NOISE


def test_reference_alone_does_not_start_most_motions(folder: Path) -> None:
    """Why the motion is taken from the torque: least squares along the reference, without more."""
    problems = [mass_matrix_problem(model, from_reference(model)) for model in (measured(folder, s) for s in (2, 4, 5))]
    assert all("not positive definite" in problem for problem in problems)


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


def test_second_minimum_is_left(folder: Path) -> None:
    """The loop of joint 6 resonates at 71 Hz, seen at 100 Hz: from a third of its motor inertia back to the truth."""
    model = measured(folder, 2)
    truth, place = model.start, model.index("Ia6")
    begin = truth.copy()
    begin[place] /= 3
    estimate = Didim(start=dict(zip(model.names, begin, strict=True))).estimate(model)
    assert (np.abs(estimate.value - truth) <= 4 * estimate.standard_deviation).all()
    assert estimate.remarks[-1].startswith("The torque error has several minima along Ia6")
    assert place in folded_inertias(model, truth)
