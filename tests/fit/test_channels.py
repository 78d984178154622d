"""What was measured beside the torque, fitted with it: tables, sensitivities, noise of each, and both answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.cosim import sample_operator
from fmu_didim.data.signals import Array
from fmu_didim.estimators import Clie, Didim
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.noise.shared import Part, counted_once, remembered_s, shared_variance, variance_by_sharing
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.signals.channel import Channel
from tests.helpers import with_torque
from tests.tools.monte_carlo import context

RATE = 50
ENCODER = 1e-4
"""[rad] Noise of the encoders."""


def model_with_positions(times: Array, values: Array | None = None) -> LoopModel:
    """The SCARA with the positions of its truth at some instants, or with values (N, 2)."""
    here = context(RATE)
    model, label = with_torque(here.model, here.torque), here.model.first
    run = model.simulation(here.truth, label)
    ticks = run.experiment.reference.time.size
    start = float(run.experiment.reference.time[0])
    operator = sample_operator(times, start=start, step=run.step_size, tick_count=ticks)
    operator = operator.stamped_later(0.0, ticks, between=True)
    if values is None:
        recording = run.record(ticks=operator.ticks)
        values = operator.apply(recording.table(model.loop.joint_signals("q"), sampled=True))
    channels = tuple(
        Channel(f"q{j + 1}", f"plant.q{j + 1}", "rad", times, values[:, j], operator) for j in range(2)
    )  # fmt: skip
    return model.with_experiment(label, replace(model.experiments[label], channels=channels))


def noisy(seed: int, encoder: Callable[[np.random.Generator, int], Array] | None = None) -> LoopModel:
    """The same with noise on both torques and both positions."""
    here, rng = context(RATE), np.random.default_rng(seed)
    times = here.model.experiments[here.model.first].time[:-2] + 0.0013
    model = model_with_positions(times)
    label = model.first
    torque = here.torque + here.noise * rng.normal(size=here.torque.shape)
    own = [ENCODER * rng.normal(size=times.size) if encoder is None else encoder(rng, times.size) for _ in range(2)]
    channels = [
        replace(channel, values=channel.values + noise)
        for channel, noise in zip(model.experiments[label].channels, own, strict=True)
    ]
    return model.with_experiment(label, replace(model.experiments[label], torque=torque, channels=tuple(channels)))


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    return Didim().estimate(noisy(0))


def test_the_table_of_all_outputs_has_a_row_an_instant_and_zeros_where_nothing_was_measured() -> None:
    here = context(RATE)
    torque_times = here.model.experiments[here.model.first].time
    times = np.append(torque_times[10:13], torque_times[20] + 0.004)
    model = model_with_positions(times, np.arange(1.0, 9.0).reshape(4, 2))
    table = model.measured_outputs
    assert table.shape == (torque_times.size + 1, 4)
    assert table[10:13, 2].tolist() == [1.0, 3.0, 5.0] and table[21].tolist() == [0.0, 0.0, 7.0, 8.0]
    assert np.count_nonzero(table[:, 2:]) == 8
    np.testing.assert_array_equal(model.torque_of(table), model.measured)
    assert model.output_counts.tolist() == [torque_times.size, torque_times.size, 4, 4]
    np.testing.assert_array_equal(model.torque_of(model.outputs(here.truth)), model.torque(here.truth))


def test_positions_are_followed_between_the_ticks() -> None:
    """The straight line between two ticks, whose values are those of the run."""
    here = context(RATE)
    model, period = here.model, 1 / 200
    ticks = model.simulation(here.truth).record(all_ticks=True).table(["plant.q1"], sampled=True)[:, 0]
    start = float(model.experiments[model.first].reference.time[0])
    outputs = model_with_positions(start + period * np.array([3.0, 7.25]), np.zeros((2, 2))).outputs(here.truth)
    np.testing.assert_allclose(outputs[outputs[:, 2] != 0, 2], [ticks[3], 0.75 * ticks[7] + 0.25 * ticks[8]], rtol=1e-9)


def test_sensitivities_of_positions_are_those_of_differences() -> None:
    here = context(RATE)
    times = here.model.experiments[here.model.first].time[50:300:7] + 0.0021
    model = model_with_positions(times)
    table = sensitivity(model, here.truth, model.outputs(here.truth))
    for i, parameter in enumerate(model.free_parameters):
        step = 1e-3 * parameter.scale
        sides = [model.outputs(here.truth + by * np.eye(here.truth.size)[i]) for by in (step, -step)]
        wanted = (sides[0] - sides[1]) / (2 * step)
        assert (np.abs(table[:, :, i] - wanted) <= 3e-5 * np.abs(wanted).max(axis=0)).all()


def test_torque_alone_is_what_it_was(estimate: Estimate) -> None:
    alone = Didim().estimate(noisy(0).torque_alone)
    assert estimate.joint is not None and alone.joint is None
    np.testing.assert_array_equal(estimate.joint.alone, alone.value)
    np.testing.assert_array_equal(estimate.joint.alone_deviation, alone.standard_deviation)


def test_positions_make_the_values_better_known(estimate: Estimate) -> None:
    joint = estimate.joint
    assert joint is not None
    assert (estimate.standard_deviation[3:] < 0.8 * joint.alone_deviation[3:]).all()
    assert (np.abs(estimate.value - context(RATE).truth) < 4 * estimate.standard_deviation).all()
    assert [channel.name for channel in joint.channels] == ["q1", "q2"]
    assert [channel.deviation for channel in joint.channels] == pytest.approx([ENCODER, ENCODER], rel=0.1)
    assert joint.p_value > 1e-3 and (np.abs(joint.apart) < 4).all()
    assert estimate.measured.shape[1] == 2 and estimate.fit is not None and estimate.fit.jacobian.shape[1] == 2


def test_a_stated_noise_counts() -> None:
    model, label = noisy(1), context(RATE).model.first
    channels = tuple(replace(c, deviation=3e-4) for c in model.experiments[label].channels)
    stated = model.with_experiment(label, replace(model.experiments[label], channels=channels))
    joint = Didim().estimate(stated).joint
    assert joint is not None
    assert [(channel.is_stated, channel.deviation) for channel in joint.channels] == [(True, 3e-4)] * 2
    assert [channel.rms for channel in joint.channels] == pytest.approx([ENCODER] * 2, rel=0.1)


@pytest.mark.gate
def test_a_torque_of_another_scale_disagrees_with_the_positions() -> None:
    """A drive that gives 20 % less than its log says: inertias by the torque alone are too large, motion tells."""
    model = noisy(2)
    joint = Didim().estimate(with_torque(model, 1.2 * model.measured)).joint
    assert joint is not None and joint.p_value < 1e-3
    assert np.abs(joint.apart).max() > 3


def test_slow_noise_of_an_encoder_counts_by_its_colour() -> None:
    """With a memory of 0.4 s, encoders of the same noise say hardly anything: the values stay as good as without."""

    def slow(rng: np.random.Generator, count: int) -> Array:
        noise = np.zeros(count)
        for k in range(1, count):
            noise[k] = 0.95 * noise[k - 1] + np.sqrt(1 - 0.95**2) * rng.normal()
        return ENCODER * noise

    found = Didim().estimate(noisy(3, slow))
    assert found.joint is not None
    assert all(channel.inflation > 3 for channel in found.joint.channels)
    assert (found.standard_deviation > 0.9 * found.joint.alone_deviation).all()


def test_clie_fits_them_too(estimate: Estimate) -> None:
    found = Clie().estimate(noisy(0))
    assert found.joint is not None
    np.testing.assert_allclose(found.value, estimate.value, atol=0.05 * float(estimate.standard_deviation.min()))


def covered(found: list[Estimate]) -> tuple[float, float]:
    """Share of the 95 % intervals that hold the truth, and scatter over stated deviation, over all parameters."""
    truth = context(RATE).truth
    inside = [(low <= t <= high) for e in found for (low, high), t in zip(e.interval(), truth, strict=True)]
    scatter = np.std([e.value for e in found], axis=0, ddof=1)
    stated = np.sqrt(np.mean([e.standard_deviation**2 for e in found], axis=0))
    return float(np.mean(inside)), float(np.sqrt(np.mean((scatter / stated) ** 2)))


@pytest.mark.slow
def test_joint_intervals_hold() -> None:
    found = [Didim().estimate(noisy(seed)) for seed in range(40)]
    inside, scatter = covered(found)
    assert 0.92 <= inside <= 0.98
    assert scatter == pytest.approx(1.0, abs=0.12)
    chances = [e.joint.p_value for e in found if e.joint is not None]
    assert 0.2 <= np.mean(chances) <= 0.8 and min(chances) > 1e-3


def disturbed(seed: int) -> LoopModel:
    """Slow disturbances of the joints, which the PD control turns into torque, and little noise of the sensors."""
    here, rng = context(RATE), np.random.default_rng(seed)
    model, label = noisy(0), here.model.first
    data = model.experiments[label]
    clean = model_with_positions(data.channels[0].time).experiments[label].channels
    fine = data.time[0] + np.arange(round((data.time[-1] - data.time[0]) * 200) + 50) / 200
    torque, channels = here.torque + 0.3 * here.noise * rng.normal(size=here.torque.shape), []
    for j, (gain, damping) in enumerate(((3700, 230), (62, 4))):
        push, moved = np.zeros(fine.size), np.zeros(fine.size)
        keeps = np.exp(-gain / damping / 200)
        for k in range(1, fine.size):
            push[k] = 0.95 * push[k - 1] + np.sqrt(1 - 0.95**2) * here.noise[j] * rng.normal()
            moved[k] = keeps * moved[k - 1] - (1 - keeps) * push[k - 1] / gain
        torque[:, j] += np.interp(data.time, fine, push)
        seen = np.interp(clean[j].time, fine, moved) + 0.1 * ENCODER * rng.normal(size=clean[j].time.size)
        channels.append(replace(clean[j], values=clean[j].values + seen))
    return model.with_experiment(label, replace(data, torque=torque, channels=tuple(channels)))


@pytest.mark.slow
def test_disturbances_that_feedback_shows_in_both_are_not_counted_twice() -> None:
    """As independent, torque and positions would make deviations smaller by 0.7, which the scatter would not be."""
    found = [Didim().estimate(disturbed(seed)) for seed in range(40)]
    inside, scatter = covered(found)
    assert 0.90 <= inside <= 0.99
    assert scatter == pytest.approx(1.0, abs=0.15)
    ratios = [e.standard_deviation / e.joint.alone_deviation for e in found if e.joint is not None]
    assert np.mean(ratios) > 0.85


# ---- what outputs share


def parts(times: Array) -> list[Part]:
    return [Part("one", slice(None), slice(0, 1), times), Part("one", slice(None), slice(1, 2), times)]


@pytest.mark.parametrize(("share", "wanted"), [(1.0, 2.0), (-1.0, 0.1), (0.0, 1.0)])
def test_variance_of_what_outputs_share(share: float, wanted: float) -> None:
    """Twice the variance where both outputs show the same noise, none where it cancels."""
    rng, times = np.random.default_rng(0), np.arange(20000) * 0.01
    first, second = rng.normal(size=(2, times.size))
    residual = np.column_stack([first, share * first if share else second])
    found = shared_variance(np.ones((times.size, 2, 1)), residual, parts(times))
    assert found == pytest.approx(wanted, abs=0.15)


def test_joints_of_one_part_count_as_independent() -> None:
    rng, times = np.random.default_rng(0), np.arange(2000) * 0.01
    same = rng.normal(size=times.size)
    one = [Part("one", slice(None), slice(0, 2), times)]
    assert shared_variance(np.ones((times.size, 2, 3)), np.column_stack([same, same]), one).tolist() == [1.0] * 3


def test_time_that_noise_remembers() -> None:
    rng, noise = np.random.default_rng(1), np.zeros(20000)
    for k in range(1, noise.size):
        noise[k] = 0.9 * noise[k - 1] + rng.normal()
    times = 0.02 * np.arange(noise.size)
    assert remembered_s(noise, times) == pytest.approx(0.02 * 19, rel=0.15)
    assert remembered_s(rng.normal(size=noise.size), times) == pytest.approx(0.02, rel=0.1)


def test_the_covariance_counts_what_outputs_share_once() -> None:
    """Without channels nothing is shared; with them a covariance grows by the root of both variances."""
    model = load_case("examples/scara/identify.yaml").model
    residual, influence = np.ones((10, 2)), np.ones((10, 2, 3))
    assert variance_by_sharing(influence, residual, model.experiments).tolist() == [1.0] * 3
    found = counted_once(np.array([[1.0, 0.5], [0.5, 2.0]]), np.array([1.0, 4.0]))
    assert found.tolist() == [[1.0, 1.0], [1.0, 8.0]]
