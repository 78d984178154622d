"""Where the checks of data decide, on signals made by hand."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.checks.data.expected import Expected, expected, solved_by
from fmu_didim.checks.data.log import is_piled, log_diagnostics, stairs, steps_in_range
from fmu_didim.checks.data.reference import contradiction
from fmu_didim.checks.data.runs import SAME_MOTION, copied, difference, during_log
from fmu_didim.checks.data.torque_channel import best_order, correlations, torque_channel_diagnostics
from fmu_didim.cosim import sample_operator
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.model.experiment import Experiment
from tests.helpers import ROOT, model_of, reference

Array = np.ndarray
N = np.arange(400)
A, B, C = (np.where(N // m % 2 == 0, 1.0, -1.0) for m in (1, 2, 4))
"""Torques without mean that are not correlated."""
TIME = 0.01 * N


def found(measured: Array, simulated: Array, gains: Any = None) -> list[Diagnostic]:
    ones = np.ones(measured.shape[1])
    return torque_channel_diagnostics(
        Expected(measured, simulated), ones if gains is None else np.array(gains), "train"
    )


def names(diagnostics: list[Diagnostic]) -> list[str]:
    return [d.code.name for d in diagnostics]


def mixed(correlation: float, other: Array = C) -> Array:
    """A torque of this correlation with A."""
    return np.asarray(correlation * A + np.sqrt(1 - correlation**2) * other)


@pytest.mark.parametrize(("correlation", "told"), [(-0.701, True), (-0.699, False), (0.9, False), (-1.0, True)])
def test_a_torque_that_runs_against_the_simulated_one(correlation: float, told: bool) -> None:
    one = found(np.column_stack([B, mixed(correlation)]), np.column_stack([B, A]))
    assert names(one) == (["torque-sign"] if told else [])
    if told:
        assert (one[0].place, one[0].bound) == ("train: joint 2", -0.7)
        assert one[0].value == pytest.approx(correlation)


def test_all_torques_that_run_against_it_are_named() -> None:
    both = found(np.column_stack([-A, -B]), np.column_stack([A, B]))
    assert [(d.code.name, d.place) for d in both] == [("torque-sign", f"train: joint {j}") for j in (1, 2)]


@pytest.mark.parametrize(
    ("correlation", "ratio", "told"),
    [
        (1.0, 8.1, True),
        (1.0, 7.9, False),
        (1.0, 1 / 8.1, True),
        (1.0, 1 / 7.9, False),
        (0.71, 50, True),
        (0.69, 50, False),
    ],
)
def test_another_unit(correlation: float, ratio: float, told: bool) -> None:
    one = found((ratio / correlation * mixed(correlation))[:, None], A[:, None])
    assert names(one) == (["torque-unit"] if told else [])
    if told:
        assert one[0].value == pytest.approx(ratio) and one[0].bound == pytest.approx(8.0 if ratio > 1 else 1 / 8)


@pytest.mark.parametrize(
    ("ratios", "gains", "told"),
    [
        ([0.1, 0.05], [10, 20], True),
        ([10, 20], [10, 20], True),
        ([0.2, 0.1], [10, 20], True),  # start values are wrong by two
        ([1.0, 1.0], [10, 20], False),
        ([0.4, 2.5], [10, 20], False),
        ([0.1, 0.05], [1, 1], False),
        ([0.1, 0.05], [100, 300], False),
    ],
)
def test_a_ratio_that_is_the_gain_of_the_drives(ratios: list[float], gains: list[float], told: bool) -> None:
    simulated = np.column_stack([A, B])
    assert ("drive-gain" in names(found(ratios * simulated, simulated, gains))) is told


@pytest.mark.parametrize(
    ("own", "other", "told"),
    # Errors of the own and of the other order, of the mean square, for two joints.
    [(1.02, 0.09, True), (1.02, 0.11, False), (0.98, 0.05, False), (4.0, 0.39, True)],
)
def test_another_order_by_size(own: float, other: float, told: bool) -> None:
    """Each simulated torque is that of the other joint, but for a part of its own."""
    angle = np.arccos(1 - (own - other) / 4)  # of two torques of size one that are so far apart
    measured = np.column_stack([A, np.cos(angle) * A + np.sin(angle) * B])
    simulated = measured[:, ::-1] + np.sqrt(other / 2) * C[:, None]
    error = np.mean((measured[:, :, None] - simulated[:, None, :]) ** 2, axis=0)
    np.testing.assert_allclose([np.trace(error), error[0, 1] + error[1, 0]], [own, other], rtol=1e-9)
    assert ("joint-order" in names(found(measured, simulated))) is told


def test_a_simulation_that_is_far_off_says_nothing_of_the_order() -> None:
    """The other order leaves a thousandth of the error, and still six times the torque's square for each joint."""
    assert names(found(np.column_stack([100 * A, B]), np.column_stack([C, 300 * C]))) == []


@pytest.mark.parametrize(("own", "other", "told"), [(0.2, 0.75, True), (0.3, 0.75, False), (0.1, 0.69, False)])
def test_another_order_by_shape(own: float, other: float, told: bool) -> None:
    """Correlations of two torques with their own and with the other simulated one; sizes say nothing."""
    simulated = np.column_stack([A, B])
    rest = np.sqrt(1 - own**2 - other**2) * C
    measured = 3 * np.column_stack([own * A + other * B + rest, own * B + other * A + rest])
    np.testing.assert_allclose(correlations(measured, simulated), [[own, other], [other, own]], atol=1e-9)
    assert ("joint-order" in names(found(measured, simulated))) is told


@pytest.mark.parametrize("count", [1, 2, 6])
def test_the_best_order_has_the_largest_sum(count: int) -> None:
    """With and without the largest elements on the diagonal."""
    rng, kept = np.random.default_rng(count), 0
    for trial in range(20):
        gain = rng.normal(size=(count, count)) + 2 * (trial % 4) * np.eye(count)
        rows, columns = best_order(gain)
        sums = [gain[range(count), list(order)].sum() for order in itertools.permutations(range(count))]
        assert gain[rows, columns].sum() == pytest.approx(max(sums), abs=1e-12)
        assert sorted(columns) == list(range(count))
        kept += (columns == rows).all()
    assert 5 <= kept <= 20


def test_constant_torques_are_not_correlated() -> None:
    both = correlations(np.column_stack([A, np.ones(400)]), np.column_stack([-A, B]))
    assert both.tolist() == [[pytest.approx(-1.0), pytest.approx(0.0)], [0.0, 0.0]]


def test_a_log_that_nothing_explains_is_foreign_and_one_that_base_parameters_explain_is_not() -> None:
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(400, 1, 3))
    own, other = columns @ [1.0, 2.0, 3.0], rng.normal(size=(400, 1))
    for measured, told in ((own, []), (other, ["reference-foreign"])):
        given = Expected(measured, None, columns, np.zeros_like(measured))
        assert names(torque_channel_diagnostics(given, np.ones(1), "train")) == told


@pytest.mark.parametrize(
    ("rate", "off"),
    [
        (lambda dq: dq, 0.0), (lambda dq: 0 * dq, 1.0), (lambda dq: 0.97 * dq, 0.03), (lambda dq: 1.06 * dq, 0.06),
        (lambda dq: -dq, 2.0), (lambda dq: 1000 * dq, 1.0),
    ],
)  # fmt: skip
def test_contradiction_is_the_part_that_the_integral_lacks(rate: Any, off: float) -> None:
    motion = reference(2.0)
    found = contradiction(motion.time, motion.column("q1"), rate(motion.column("dq1")))
    assert found == pytest.approx(off, rel=0.06, abs=1e-3)


def test_a_joint_at_rest_contradicts_nothing() -> None:
    assert contradiction(TIME, np.full(400, 0.3), np.zeros(400)) == 0.0


@pytest.mark.parametrize(
    ("torque", "order", "every"),
    [
        (np.repeat(A[:80], 5), 1, 5.0),
        (A, 1, 1.0),
        (np.interp(N, N[::4], np.cumsum(A)[::4] * np.sin(N[::4])), 2, 4.0),
        (np.sin(0.1 * N), 2, 1.0),
        (np.where(N < 200, np.sin(N), 0.0), 1, 1.0),  # at rest for half of the time
        (np.sin(3.0 * np.floor(0.4 * N)), 1, 2.5),  # 40 Hz in a log at 100 Hz
    ],
)
def test_stairs(torque: Array, order: int, every: float) -> None:
    assert stairs(np.asarray(torque, dtype=float)[:, None], order) == pytest.approx(every, rel=0.02)


@pytest.mark.parametrize("steps", [3, 24, 200])
def test_steps_of_a_quantised_log(steps: int) -> None:
    values = np.rint(steps / 2 * np.sin(0.37 * N)) * 0.7 + 0.1
    assert steps_in_range(values) == pytest.approx(steps, abs=1)
    assert steps_in_range(values + 1e-2 * np.random.default_rng(0).normal(size=400) * 0.7) != steps


EVEN = np.sin(2 * np.pi * 0.6180339887 * N)
"""Of a sine whose phases are spread evenly."""


@pytest.mark.parametrize(
    ("values", "at", "piled"),
    [
        (79 * EVEN, 79, False),
        ((79 * EVEN).clip(-75, 75), 75, True),
        ((79 * EVEN).clip(-47, 47), 47, True),
        (79 * EVEN + 2 * np.random.default_rng(5).normal(size=400), None, False),
    ],
)
def test_more_samples_at_an_extreme_than_steps_alone_bring_there(values: Array, at: int | None, piled: bool) -> None:
    own = np.rint(values)
    extreme = float(own.max())
    assert at is None or extreme == at
    assert is_piled(own, extreme, steps_in_range(own)) is piled
    assert is_piled(values, float(values.max()), None)  # without steps nothing else brings several there


def test_part_of_a_log_that_stands_in_another() -> None:
    log = np.column_stack([np.sin(N), np.cos(N)])
    assert copied(log[100:200], log) == 1.0
    assert copied(np.vstack([log[:30], log[:70] + 0.5]), log) == pytest.approx(0.3)
    assert copied(np.ones((100, 2)), np.ones((100, 2))) == 0.0  # at rest: all rows are alike


def moving(*columns: Array, begin: float = 0.0, names: tuple[str, ...] = ("q1", "q2")) -> Trajectory:
    """A reference with these columns."""
    return trajectory(begin + 0.01 * np.arange(columns[0].size), dict(zip(names, columns, strict=False)))


SLOW, FAST, REST = np.sin(0.05 * N), np.sin(0.11 * N), np.zeros(400)
UNEVEN = np.sqrt(2) * np.sin(1.7 * N)
"""Of RMS 1."""


@pytest.mark.parametrize(
    ("held_out", "fitted", "same"),
    [
        (moving(SLOW, FAST), moving(SLOW, FAST), True),
        (moving(SLOW, FAST, begin=7.0), moving(SLOW, FAST), True),  # each counts from its own first row
        (moving(SLOW + 0.009 * SLOW.std() * UNEVEN, FAST), moving(SLOW, FAST), True),
        (moving(SLOW + 0.011 * SLOW.std() * UNEVEN, FAST), moving(SLOW, FAST), False),
        (moving(SLOW, SLOW), moving(SLOW, FAST), False),  # one joint moves otherwise
        (moving(SLOW, REST), moving(SLOW, REST), True),  # a joint at rest says nothing
        (moving(SLOW, REST), moving(SLOW, FAST), False),
        (moving(REST, REST), moving(REST, REST), False),  # nothing moves
        (moving(SLOW[:100], FAST[:100]), moving(SLOW, FAST), True),  # a part of the fitted motion
        (moving(SLOW, FAST), moving(SLOW[:210], FAST[:210]), True),
        (moving(SLOW, FAST), moving(SLOW[:190], FAST[:190]), False),  # most of it is new
        (moving(SLOW, FAST), moving(SLOW), False),
        (moving(SLOW, FAST, names=("q1", "pulse1")), moving(SLOW, names=("q1",)), False),  # pulses of its own
        (moving(SLOW, names=("tau1",)), moving(SLOW, names=("tau1",)), False),  # no positions
    ],
)
def test_references_of_the_same_motion(held_out: Trajectory, fitted: Trajectory, same: bool) -> None:
    assert (difference(held_out, fitted)[0] < SAME_MOTION) == same


PERIODIC = [sum(np.sin(0.02 * np.pi * k * np.arange(1000) + 2.0 * k + j) / k for k in (1, 2, 3)) for j in (0, 1)]
"""Two joints along a motion with a period of 1 s, ten times."""


@pytest.mark.parametrize(
    ("begin", "end", "fitted_end", "later"),
    [
        (250, 400, 500, 2.5),  # a part of what is fitted
        (350, 450, 300, 0.5),  # further periods: within the fitted ones there is the same
        (400, 720, 150, None),  # longer than what is fitted: more than half of it has nothing to be compared with
        (380, 470, 100, -0.2),  # its first fifth is that of no fitted period, the rest is
    ],
)
def test_a_reference_that_begins_within_another(begin: int, end: int, fitted_end: int, later: float | None) -> None:
    held_out = moving(*(q[begin:end] for q in PERIODIC))
    apart, since = difference(held_out, moving(*(q[:fitted_end] for q in PERIODIC)))
    assert (apart < SAME_MOTION) == (later is not None)
    if later is not None:
        assert since % 1.0 == pytest.approx(later % 1.0, abs=1e-4)


def test_a_reference_that_begins_between_two_rows_of_another() -> None:
    fitted = moving(SLOW, FAST)
    time = 1.2345 + 0.007 * np.arange(300)
    held_out = trajectory(time, {"q1": np.sin(5 * time), "q2": np.sin(11 * time)})
    apart, since = difference(held_out, fitted)
    assert apart < SAME_MOTION
    assert since == pytest.approx(1.2345, abs=1e-3)
    other = trajectory(time, {"q1": np.sin(5 * time), "q2": np.sin(11 * time + 0.1)})
    assert difference(other, fitted)[0] > SAME_MOTION


def test_two_parts_of_one_reference_are_two_motions() -> None:
    operator = sample_operator(TIME, start=0.0, step=0.01, tick_count=400)
    whole = Experiment(moving(SLOW, FAST), TIME, np.column_stack([SLOW, FAST]), operator)
    first, second = replace(whole, time=TIME[:200]), replace(whole, time=TIME[200:])
    assert difference(during_log(second), during_log(first))[0] > SAME_MOTION
    assert difference(during_log(second), during_log(second)) == (0.0, 0.0)


def of_log(torque: Array, **changes: Any) -> list[Diagnostic]:
    """What is said of a log at 100 Hz that is expected to be a sine."""
    motion = reference(4.0, joints=1)
    operator = sample_operator(TIME, start=0.0, step=0.005, tick_count=motion.time.size)
    given = Expected(torque[:, None], np.sin(0.05 * N)[:, None])
    return log_diagnostics(
        replace(Experiment(motion, TIME, torque[:, None], operator), **changes), "train", given, 200.0
    )


NOISY = np.sin(0.05 * N) + 0.01 * np.random.default_rng(4).normal(size=400)


@pytest.mark.parametrize(
    ("torque", "changes", "code", "value"),
    [
        (NOISY, {}, None, None),
        (NOISY, {"time": np.where(N < 100, TIME, TIME + 0.03)}, "samples-missing", 3.0),
        (NOISY, {"stamps": TIME + 0.0002 * A}, None, None),
        (NOISY, {"stamps": TIME + 0.001 * A}, "stamps-jitter", 0.1),
        (NOISY, {"stamps": TIME[::2]}, "rate-above-log", 100.0),
        (NOISY.clip(-0.5, 0.5), {}, "log-saturated", None),
        (NOISY.clip(-0.99, 0.99), {}, None, None),
        (np.where(N == 77, 5.0, NOISY), {}, "log-outliers", None),
        (np.where(N == 77, NOISY + 0.5, NOISY), {}, None, None),
        (np.where(N == 77, NOISY + 0.8, NOISY), {}, "log-outliers", None),  # less than half the range, but alone
        (np.where(N == 1, NOISY + 0.8, NOISY), {}, None, None),  # where a loop swings in
        (np.where(N % 23 == 7, NOISY + 0.8, NOISY), {}, None, None),  # what comes often is the motion
        (NOISY + 0.2 * np.random.default_rng(3).normal(size=N.size), {}, None, None),
        (np.zeros(400), {}, "log-constant", 0.0),
        (np.where(N > 350, NOISY[350], NOISY), {}, "log-constant", 50.0),  # the logger repeats its last value
        (np.where(N > 390, NOISY[390], NOISY), {}, None, None),  # too short to tell
        (np.rint(NOISY * 50) / 50, {}, "log-quantised", None),
        (np.rint(NOISY * 8) / 8, {}, "log-coarse", None),
    ],
)  # fmt: skip
def test_log(torque: Array, changes: dict[str, Any], code: str | None, value: float | None) -> None:
    told = of_log(torque, **changes)
    assert names(told) == ([code] if code else [])
    if value is not None:
        assert told[0].value == pytest.approx(value, rel=0.02)


@pytest.mark.parametrize(("at", "codes"), [(2, []), (5, []), (6, ["log-outliers"]), (None, ["log-outliers"])])
def test_a_loop_that_swings_in_is_no_outlier(at: int | None, codes: list[str]) -> None:
    """What the simulation does, too, a sample or two earlier or later."""
    log = np.where(N == 3, 5.0, NOISY)
    simulated = np.sin(0.05 * N) if at is None else np.where(at == N, 6.0, np.sin(0.05 * N))
    columns = np.sin(0.05 * N)[:, None, None]  # along the reference the loop need not swing in
    motion = reference(4.0, joints=1)
    operator = sample_operator(TIME, start=0.0, step=0.005, tick_count=motion.time.size)
    given = Expected(log[:, None], simulated[:, None], columns)
    assert names(log_diagnostics(Experiment(motion, TIME, log[:, None], operator), "train", given, 200.0)) == codes


@pytest.mark.parametrize(
    ("size", "count", "at", "code"),
    [
        (2.0, 1, 33, "few-outliers"),
        (20.0, 1, 33, "log-outliers"),  # one sample may move the values, too
        (2.0, 9, 33, "log-outliers"),
    ],
)
def test_outliers_that_move_no_value_are_remarked(size: float, count: int, at: int, code: str) -> None:
    """A single wrong sample is told; a doubt it is where it moves the values."""
    count_all = 10 * N.size
    n, time = np.arange(count_all), np.arange(count_all) * (TIME[1] - TIME[0])
    log = np.sin(0.05 * n) + 0.2 * np.random.default_rng(4).normal(size=count_all)
    log[at : at + 20 * count : 20] += size
    columns = np.stack([np.sin(0.05 * n), np.cos(0.05 * n)], axis=1)[:, None, :]
    motion = reference(40.0, joints=1)
    operator = sample_operator(time, start=0.0, step=0.005, tick_count=motion.time.size)
    given = Expected(log[:, None], np.sin(0.05 * n)[:, None], columns)
    (told,) = log_diagnostics(Experiment(motion, time, log[:, None], operator), "train", given, 200.0)
    assert told.code.name == code
    if code == "few-outliers":  # by least squares: what the sample moves the two values by, in their deviations
        shift = np.linalg.lstsq(columns[:, 0], np.where(n == at, size, 0.0), rcond=None)[0]
        normal = columns[:, 0].T @ columns[:, 0]
        assert told.value == pytest.approx(float(np.sqrt(shift @ normal @ shift)) / 0.2, rel=0.2)


def test_a_wrong_sample_of_a_real_held_out_log_is_found() -> None:
    """One sample of joint 1 is 3.5 N.m off for a control period, just less than half the range of that log."""
    model = model_of(ROOT / "examples/double_pendulum/identify.yaml")
    run = model.simulation(model.start, "validation")
    told = log_diagnostics(run.experiment, "validation", expected(run), 1 / run.step_size)
    (found,) = [d for d in told if "outliers" in d.code.name]
    assert found.code.name == "few-outliers"
    assert "1 of 700 samples" in found.text
    assert "of the squared difference from the expected torque" in found.text


def test_held_command_of_a_slower_control_is_no_upsampling() -> None:
    """Control at 20 Hz, log at 100 Hz: stairs of five samples are what such a log must show."""
    held = np.repeat(np.random.default_rng(2).normal(size=80), 5)
    motion = reference(4.0, joints=1)
    operator = sample_operator(TIME, start=0.0, step=0.005, tick_count=motion.time.size)
    log = Experiment(motion, TIME, held[:, None], operator)
    given = Expected(held[:, None], held[:, None])
    assert names(log_diagnostics(log, "train", given, 20.0)) == []
    (told,) = log_diagnostics(log, "train", given, 200.0)
    assert (told.code.name, told.bound) == ("log-upsampled", pytest.approx(20.0, rel=0.01))
    assert "rate_hz: 20" in told.advice


def test_a_column_of_zeros_takes_no_value() -> None:
    """As that of a load that nothing carries in an experiment."""
    rng = np.random.default_rng(0)
    columns, true = rng.normal(size=(50, 2, 3)) * [1.0, 0.0, 1e-3], np.array([2.0, 0.0, -3.0])
    value, deviation = solved_by(columns, columns @ true, np.array([1.0, 10.0]))
    np.testing.assert_allclose(value, true, atol=1e-9)
    assert np.isfinite(deviation).all()
