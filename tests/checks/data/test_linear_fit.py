"""Fits along a motion near a log: what some of the samples tell for sure, and how the motion is approached."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.checks.data import linear_fit, timing
from fmu_didim.checks.data.checks import _quick
from fmu_didim.checks.data.linear_fit import FittedMotion, fitted_motion
from fmu_didim.data.filters import LowPass
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.prediction import Prediction
from tests.checks.data.right import right
from tests.checks.data.test_wrong_inputs import late


def test_a_misfit_by_some_of_the_samples_is_no_larger() -> None:
    """What is sure by them is so by all: of other timings, and of other rows."""
    fitted = fitted_motion(right("scara", 1, noise=0.01).on("estimation"))
    assert fitted is not None
    own, step = fitted.experiment.operator, fitted.run.step_size
    sure = 0
    for late_s in (0.0, 1e-3, -3e-3, 0.01, -0.05, 0.3):
        operator = own.stamped_later(late_s / step, fitted.experiment.reference.time.size, between=True)
        misfit = fitted.misfit(operator)
        for part in (1 / 20, 1 / 4, 1 / 1.5):
            sure += fitted.is_above(part * misfit, operator)
        assert not any(fitted.is_above(bound, operator) for bound in (1.001 * misfit, 2 * misfit, np.inf))
    assert sure >= 8
    turned = replace(fitted, changed=lambda ticks: (fitted.along(ticks)[0][:, ::-1], fitted.along(ticks)[1]))
    least = fitted.misfit_of(turned)
    assert least > 10
    assert fitted.is_above(least / 20, own, turned.rows)
    assert not fitted.is_above(1.001 * least, own, turned.rows)


def test_nothing_is_sure_by_some_samples_of_a_log_that_is_filtered() -> None:
    model = right("scara", 1, noise=0.01).on("estimation")
    filtered = replace(model, experiments=replace(model.experiments, low_pass=LowPass(5.0)))
    fitted = fitted_motion(filtered)
    assert fitted is not None
    late = fitted.experiment.operator.stamped_later(50.0, fitted.experiment.reference.time.size, between=True)
    assert fitted.misfit(late) > 10
    assert not fitted.is_above(1e-6, late)


@pytest.mark.parametrize("late_s", [0.0, 0.011, -0.004])
def test_the_shift_of_a_log_is_that_by_all_of_the_samples(late_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A grid that is looked at by some of the samples leads to the same minimum as by all of them."""
    fitted = fitted_motion(right("scara", 2, change=late(late_s), noise=0.01).on("estimation"))
    assert fitted is not None
    found, asked = timing._least_misfit(fitted), list[float]()

    def never(fitted: FittedMotion, bound: float, *_: object) -> bool:
        asked.append(bound)
        return False

    monkeypatch.setattr(FittedMotion, "is_above", never)
    assert timing._least_misfit(fitted) == found
    assert len(asked) == 2 * len(timing.SHIFTS_S)


@pytest.mark.gate
@pytest.mark.parametrize("robot", ["puma560", "tx40_5khz"])
def test_a_motion_is_approached_by_few_steps_of_the_plant(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It comes to the same one, in as many simulations, of which the last has as many steps as before."""
    model, counts = _quick(right(robot, 1)).on("estimation"), list[int | None]()
    predict = linear_fit.predict

    def counted(model: LoopModel, values: Array) -> Prediction:
        counts.append(model.loop.substeps)
        return predict(model, values)

    monkeypatch.setattr(linear_fit, "predict", counted)
    found = fitted_motion(model)
    assert found is not None
    is_coarse = robot == "puma560"
    assert found.run.model.loop.substeps == model.loop.substeps == (4 if is_coarse else 1)
    assert set(counts) == {1}
    monkeypatch.setattr(linear_fit, "_approached", lambda *_: None)
    fine = fitted_motion(model)
    assert fine is not None
    assert set(counts) == ({1, 4} if is_coarse else {1})
    values, deviation = fine.values()
    assert float((np.abs(found.values()[0] - values) / deviation).max()) < 0.02
    assert found.misfit() == pytest.approx(fine.misfit(), rel=1e-3)


def test_a_plant_that_is_too_coarse_is_not_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the error with few steps is not that of the motion, the motion is approached with all of them."""
    model, steps, asked = _quick(right("puma560", 1)).on("estimation"), linear_fit._steps, list[int | None]()

    def flattering(model: LoopModel, values: Array) -> tuple[float, Array] | None:
        asked.append(model.loop.substeps)
        found = steps(model, values)
        return found if found is None or model.loop.substeps != 1 else (0.9 * found[0], found[1])

    monkeypatch.setattr(linear_fit, "_steps", flattering)
    assert fitted_motion(model) is not None
    assert asked == [1, 4]
