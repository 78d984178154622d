"""Whether the residual repeats with the motion: chance, colour, misfits of every shape, and what is said."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter

from fmu_didim.checks.identification import checked
from fmu_didim.checks.motion.periods import FEWEST_DIFFERENCES, Repetition, repetition_diagnostics, repetition_of_fit
from fmu_didim.data.filters import LowPass
from fmu_didim.estimators import Didim
from fmu_didim.fit.fit import Fit, point
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.model.loop_model import LoopModel
from tests.checks.data.right import case_of, loaded, logged

RATE_HZ, PERIOD_S = 50.0, 10.0
RNG = np.random.default_rng


@cache
def repeating(periods: float) -> LoopModel:
    """The SCARA along its motion, so many times."""
    case, model = case_of("scara"), loaded("scara")
    source = case.document.runs["estimation"].reference
    reference = source.model_copy(update={"duration_s": periods * PERIOD_S}).trajectory(1 / case.step_size)
    model = logged(model.on("estimation"), "estimation", reference, RATE_HZ)
    torque = model.torque(model.start, "estimation")
    return model.with_experiment("estimation", replace(model.experiments["estimation"], torque=torque))


@cache
def fit_of(periods: float, cutoff_hz: float = 0.0) -> Fit:
    model = repeating(periods)
    model = model.with_low_pass(LowPass(cutoff_hz)) if cutoff_hz else model
    return point(model, NoiseOfResidual(model))


def left(fit: Fit, residual: np.ndarray) -> list[Repetition]:
    """What repeats in a residual (N, n)."""
    return repetition_of_fit(replace(fit, outputs=fit.model.measured_outputs - residual))


COLOURS = {"white": (), "memory of two samples": (0.6,), "memory of 50 ms at 200 Hz": (0.9,), "hum": (1.2, -0.95)}


@pytest.mark.parametrize("periods", [1.5, 2.0, 4.0])
@pytest.mark.parametrize("colour", COLOURS.values(), ids=COLOURS.keys())
def test_noise_of_any_colour_repeats_no_more_often_than_the_level_says(periods, colour):
    fit = fit_of(periods)
    shape, values = fit.outputs.shape, []
    for seed in range(100):
        white = RNG(seed).normal(size=(shape[0] + 200, 2))
        values += [one.p_value for one in left(fit, lfilter([1.0], [1.0, *(-a for a in colour)], white, axis=0)[200:])]
    assert len(values) == 200
    assert np.mean(np.array(values) < 0.05) < (4 if len(colour) == 2 else 2) * 0.05, "a sharp hum leaks into the band"
    assert np.sum(np.array(values) < 0.0005) <= 2, "three of 200 have a chance of 0.02 %"


def misfits(time, fit):
    turns = 2 * np.pi * time / PERIOD_S
    return {
        "slow": np.sin(turns),
        "steps": np.sign(np.sin(3 * turns)),
        "once in a period": (turns % (2 * np.pi) < 0.3) * 4.0,
        "the torque": fit.outputs[:, 0] ** 3 / np.std(fit.outputs[:, 0] ** 3),
    }


@pytest.mark.parametrize("name", ["slow", "steps", "once in a period", "the torque"])
@pytest.mark.parametrize("periods", [1.5, 2.0, 4.0])
def test_what_repeats_is_told(name, periods):
    fit = fit_of(periods)
    noise = RNG(1).normal(size=fit.outputs.shape)
    size = 2.0 if periods < 2 else 1.0  # of the noise; half a period to compare with says less
    noise[:, 0] += size * misfits(fit.model.experiments.time, fit)[name]
    first, second = left(fit, noise)
    assert first.p_value < 5e-4 < second.p_value
    (told,) = repetition_diagnostics([first, second])
    assert (told.code.name, told.place) == ("residual-above-noise", "joint 1")
    assert told.value > told.bound
    assert f"{first.periods} periods" in told.text and "it repeats" in told.text


def test_a_misfit_does_not_widen_its_own_bound():
    """The larger it is, the clearer: nothing of it is in what it is compared with."""
    fit = fit_of(2.0)
    noise, shape = RNG(2).normal(size=fit.outputs.shape), misfits(fit.model.experiments.time, fit)["steps"][:, None]
    ratios = [left(fit, noise + size * shape)[0].ratio for size in (0.0, 1.0, 10.0, 100.0)]
    assert ratios[0] < 2
    for smaller, larger in pairwise(ratios[1:]):
        assert larger == pytest.approx(100 * smaller, rel=0.3)


def test_what_the_fit_has_used_up_does_not_count():
    fit = fit_of(2.0)
    noise = RNG(3).normal(size=fit.outputs.shape)
    moved = noise + fit.jacobian @ (50.0 / np.linalg.norm(fit.jacobian, axis=(0, 1)))
    assert [one.ratio for one in left(fit, moved)] == pytest.approx([one.ratio for one in left(fit, noise)], rel=1e-6)


def test_what_happens_in_one_period_only_does_not_repeat():
    fit = fit_of(4.0)
    residual = RNG(4).normal(size=fit.outputs.shape)
    residual[600:620] += 5.0
    assert all(one.p_value > 5e-4 for one in left(fit, residual))


def test_offset_and_hum_do_not_count():
    """Noise may drift; a hum may keep step with the period."""
    fit = fit_of(2.0)
    time, noise = fit.model.experiments.time[:, None], RNG(5).normal(size=fit.outputs.shape)
    assert all(one.p_value > 5e-4 for one in left(fit, noise + 2.0 + 3 * np.sin(2 * np.pi * 12 * time)))


def test_rows_that_are_missing_change_little():
    model, fit = repeating(2.0), fit_of(2.0)
    own, kept = model.experiments["estimation"], np.delete(np.arange(1000), np.r_[100:140, 523, 700:705])
    rows = model.with_experiment("estimation", own.at(kept))
    noise = RNG(6).normal(size=(1000, 2)) + misfits(own.time, fit)["steps"][:, None]
    assert all(one.p_value < 5e-4 for one in left(point(rows, NoiseOfResidual(rows)), noise[kept]))


def test_motions_that_do_not_repeat_are_not_tested():
    assert repetition_of_fit(fit_of(1.0)) == []
    assert repetition_of_fit(fit_of(1.2)) == [], "a fifth of a period says too little"
    assert repetition_diagnostics([]) == []


def test_a_filtered_log_is_tested_in_its_band():
    fit, plain = fit_of(2.0, 1.0), fit_of(2.0)
    noise = RNG(7).normal(size=plain.outputs.shape)
    for size, told in ((0.0, False), (1.0, True)):
        residual = noise + size * misfits(plain.model.experiments.time, plain)["slow"][:, None]
        found = left(fit, fit.model.experiments.filtered(residual, "estimation"))
        assert all(one.first < other.first for one, other in zip(found, left(plain, noise), strict=True))
        assert bool(repetition_diagnostics(found)) is told


def test_few_differences_say_nothing():
    assert all(one.second >= FEWEST_DIFFERENCES for one in left(fit_of(1.5), RNG(8).normal(size=(750, 2))))


@pytest.mark.gate
@pytest.mark.parametrize(("size", "doubted"), [(0.0, False), (0.5, True)])
def test_the_verdict_says_it(size, doubted):
    """A ripple that no function of the motion follows, a third of the noise."""
    model = repeating(2.0)
    own = model.experiments["estimation"]
    deviation = 0.02 * own.torque.std(axis=0)
    ripple = np.sin(2 * np.pi * 13 / PERIOD_S * own.time[:, None])
    noise = RNG(9).normal(size=own.torque.shape)
    model = model.with_experiment("estimation", replace(own, torque=own.torque + deviation * (noise + size * ripple)))
    reasons = checked(Didim(start="description").estimate(model), []).judgement.reasons
    assert ([d for d in reasons if "it repeats" in d.text] != []) is doubted
    assert bool(reasons) is doubted
