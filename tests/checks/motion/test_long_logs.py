"""What long logs are judged by: the same answers by parts, and work and memory that do not grow with all that is
tried."""

from __future__ import annotations

import gc
import tracemalloc
import weakref
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from fmu_didim.base.tall import ROWS, in_blocks
from fmu_didim.checks.motion import colour, misfits
from fmu_didim.checks.motion.colour import (
    Beside,
    Colour,
    Columns,
    Logs,
    Past,
    orthonormal,
    rest_of,
    triangle,
)
from fmu_didim.checks.motion.dependence import JointResidual, Left, OwnColours, dependence, independent
from fmu_didim.checks.motion.misfits import FittedMotions, Misfits
from fmu_didim.checks.power.power import JointTest, smallest_size
from fmu_didim.dynamics.robot.vectorised import TOGETHER
from fmu_didim.fit.fit import Fit, point
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.fit.uncertainty import stretches
from fmu_didim.model.parameters import RobotParameters
from tests.checks.data.right import loaded, right
from tests.patience import Calls

RNG = np.random.default_rng
LONG = 3 * ROWS + 5


def of_logs(*times: np.ndarray) -> Logs:
    return Logs(tuple(stretches(times)))


def peak_of(call: Callable[[], object]) -> int:
    """Bytes that a call takes at their highest."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.fixture(scope="module")
def fit() -> Fit:
    model = right("scara", 1, noise=0.01).on("estimation").with_values(loaded("scara").start)
    return point(model, NoiseOfResidual(model))


@pytest.mark.parametrize("long", [0, 1000])
@pytest.mark.parametrize("most", [0, 1, 4, 7])
@pytest.mark.parametrize(
    "runs", [[range(50)], [range(20), range(25, 26), range(30, 90)], [[*range(9), *range(20, 40)]]]
)
def test_products_of_lags_are_those_of_the_samples_beside_each_other(
    runs: list[list[int]], most: int, long: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within each run only: nothing is said of what lies beside a gap. A run that is too short has no sample."""
    monkeypatch.setattr(colour, "LONG_RUN", long)
    past = Past.of([np.array(run) for run in runs], 7)
    signal = RNG(1).normal(size=100) + 3.0
    beside = np.array([[signal[run[t - k]] for k in range(most + 1)] for run in runs for t in range(7, len(run))])
    np.testing.assert_allclose(past.products(signal, most), beside.T @ beside, rtol=1e-12)
    assert past.samples == len(beside)
    for k in range(most + 1):
        np.testing.assert_array_equal(signal[past.rows[k]], beside[:, k])


@pytest.mark.parametrize("at", [0, -1])
def test_a_sample_that_is_far_larger_at_an_end_does_not_blur_the_colour(at: int) -> None:
    """From a sum to the next one only samples at the ends change, by a difference that such a sample would drown."""
    noise = RNG(2).normal(size=3000)
    noise[at] = 1e9
    (past,) = (logs := of_logs(np.arange(3000) / 100.0)).pasts
    found = colour._autoregression(noise, past, past.lags, 0)[0]
    table = np.column_stack([noise[past.rows[k]] for k in [*range(1, found.size + 1), 0]])
    exact = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=None)[0]
    np.testing.assert_allclose(found, exact, atol=1e-6)
    assert logs.samples == past.samples


@pytest.mark.parametrize("part", [1.0, 1e-3, 1e-7])
def test_a_long_table_has_the_triangle_and_the_basis_of_an_orthogonal_factorisation(part: float) -> None:
    """A column may depend nearly on another one, which products do not tell."""
    table = RNG(3).normal(size=(LONG, 5))
    table[:, 4] = table[:, 1] + part * table[:, 4]
    np.testing.assert_allclose(np.abs(triangle(table)), np.abs(np.linalg.qr(table, mode="r")), rtol=1e-7, atol=1e-7)
    basis = orthonormal(table)
    np.testing.assert_allclose(basis.T @ basis, np.eye(5), atol=1e-13)
    np.testing.assert_allclose(rest_of(table, basis) / np.linalg.norm(table, axis=0), 0.0, atol=1e-13)
    assert independent(table).shape[1] == (5 if part > 1e-6 else 4)


def test_a_column_that_depends_on_others_is_left_out_whatever_its_unit() -> None:
    table = RNG(4).normal(size=(LONG, 4)) * (1e-8, 1.0, 1e8, 1.0)
    table[:, 3] = table[:, 1] + 1e-8 * table[:, 2]
    assert independent(table).shape[1] == 3
    assert independent(np.zeros((5, 2))).shape == (5, 0)


def test_a_memory_is_taken_out_of_those_columns_alone_that_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of forty functions of the motion the test chooses a few: the others are not transformed."""
    columns, original = list[int](), Logs.remembered

    def counted(self: Logs, table: np.ndarray, memory: float) -> np.ndarray:
        columns.append(table.shape[1])
        return original(self, table, memory)

    monkeypatch.setattr(Logs, "remembered", counted)
    time, rng = np.arange(4000) / 200.0, RNG(5)
    dependence(
        rng.normal(size=4000), rng.normal(size=(4000, 6)), rng.normal(size=(4000, 40)), [f"{k}" for k in range(40)],
        joint=1, logs=of_logs(time),
    )  # fmt: skip
    assert 0 < sum(columns) <= 6 + 1 + 4  # the sensitivities, the residual, and two functions of each start


def test_white_noise_is_whitened_once_for_all_that_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both starts and all choices lead to white noise: the functions are looked at beside the sensitivities once."""
    counts, original = list[int](), Beside.of

    def counted(basis: np.ndarray, blocks: Callable[[], Iterable[np.ndarray]], count: int) -> Beside:
        counts.append(count)
        return original(basis, blocks, count)

    rng, time = RNG(10), np.arange(4000) / 200.0
    used, motion = orthonormal(rng.normal(size=(4000, 6))), rng.normal(size=(4000, 40))
    tested = OwnColours.of(rng.normal(size=4000), Columns(of_logs(time), used)).with_functions(motion)
    assert tested.alone.orders == (0,)
    monkeypatch.setattr(Beside, "of", counted)
    tested.steps()
    assert counts == [41]


def test_the_past_of_a_log_takes_no_table() -> None:
    """Fifty samples before each are looked at, and no more is kept of that than where the log begins and ends."""
    time, noise = np.arange(100_000) / 200.0, RNG(7).normal(size=100_000)
    logs = of_logs(time)
    assert logs.pasts[0].lags >= 50
    assert peak_of(lambda: colour._autoregression(noise, logs.pasts[0], logs.pasts[0].lags, 0)) < 2 * noise.nbytes


def test_a_log_with_many_gaps_is_no_more_work_than_one_without() -> None:
    """Its thousand runs are not looked at one by one."""
    places, noise = np.flatnonzero(np.arange(20_000) % 10 != 9), RNG(12).normal(size=20_000)
    (whole,), (part,) = of_logs(np.arange(20_000) / 200.0).pasts, of_logs(places / 200.0).pasts
    calls = []
    for past in (whole, part):
        assert past.rows
        with Calls() as counted:
            past.products(noise[: past.samples + past.lags * len(past.runs)], past.lags)
        calls.append(counted.count)
    assert calls[1] < calls[0] + 100


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_what_follows_the_motion_takes_little_more_memory_than_the_functions(colour: float) -> None:
    """Of any number of functions: none of their tables is made again, whitened or beside the sensitivities."""
    count = 100_000
    rng, time = RNG(8), np.arange(count) / 200.0
    used, motion, residual = rng.normal(size=(count, 6)), rng.normal(size=(count, 40)), rng.normal(size=count)
    residual, logs = lfilter([1.0], [1.0, -colour], residual), of_logs(time)
    peak = peak_of(lambda: dependence(residual, used, motion, [f"{k}" for k in range(40)], joint=1, logs=logs))
    assert peak < 1.5 * motion.nbytes


def test_what_has_been_asked_of_a_joint_is_gone_with_it() -> None:
    """Its tables are as large as many logs: they must not wait for a search for circles of references."""
    rng, time = RNG(15), np.arange(400) / 20.0
    motion = np.column_stack([np.sin((k + 1) * time) for k in range(6)])
    one = JointResidual(1, Left(rng.normal(size=400), np.ones((400, 1)), of_logs(time)), motion, list("abcdef"))
    one = one.beside(["g"], [np.sin(9 * time).astype(np.float32)])
    test = JointTest.of(one, [np.cos(7 * time).astype(np.float32)], 1)
    assert test is not None
    smallest_size([test], 0, 100.0)
    assert one.dependence().p_value > 1e-3
    gone = [weakref.ref(part) for part in (one.left, one.motion, one.tested, test.all)]
    gc.disable()
    try:
        del one, test, motion
        assert [ref() for ref in gone] == [None] * 4
    finally:
        gc.enable()


def test_what_is_left_beside_a_basis_is_that_of_a_table() -> None:
    rng = RNG(13)
    basis, table = orthonormal(rng.normal(size=(LONG, 4))), rng.normal(size=(LONG, 7))
    found, left = Beside.of(basis, lambda: in_blocks(table), 7), rest_of(table, basis)
    np.testing.assert_allclose(found.along, basis.T @ table, atol=1e-10)
    np.testing.assert_allclose(found.squares, np.sum(table**2, axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.products, left.T @ left, rtol=1e-9, atol=1e-9)


def test_whitened_by_parts_is_whitened_as_a_whole() -> None:
    """With gaps and two rates, and columns of several tables in any order."""
    times = (np.delete(np.arange(LONG) / 200.0, slice(500, 900)), np.arange(3000) / 20.0)
    logs, rng = of_logs(*times).with_lags((3, 2)), RNG(14)
    samples = sum(time.size for time in times)
    tables = [rng.normal(size=(samples, k)) for k in (3, 1, 2)]
    columns = Columns(logs, tables[0]).beside(tables[1]).beside(tables[2])
    a, deviations = (np.array([0.5, -0.2, 0.1]), np.array([0.3])), (0.5, 2.0)
    order, whole = [4, 0, 3, 2], np.column_stack(tables)
    parts = [
        (whole[past.rows[0]] - sum(c * whole[past.rows[k]] for k, c in enumerate(own, start=1))) / deviation
        for past, own, deviation in zip(logs.pasts, a, deviations, strict=True)
    ]
    found = columns.whitened(Colour(0, a, deviations, np.inf), order)
    np.testing.assert_allclose(found, np.concatenate(parts)[:, order], atol=1e-12)
    np.testing.assert_array_equal(columns.rows_of(order), whole[:, order])


def test_misfits_are_the_same_however_many_are_answered_together(fit: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    """One at a time, too, some of which the loop has no part in; nothing of a load is kept but its answer."""
    motions = FittedMotions.of(fit)
    assert motions is not None
    usual = Misfits.of(fit)
    monkeypatch.setattr(misfits, "AT_ONCE", 1)
    for one, other in zip(usual, Misfits.of(fit), strict=True):
        assert one.what == other.what
        np.testing.assert_allclose(one.signature, other.signature, rtol=1e-9, atol=1e-9 * np.abs(one.signature).max())
        assert not one.load.tables


def test_the_answer_of_a_joint_is_that_among_all_outputs(fit: Fit) -> None:
    motions = FittedMotions.of(fit)
    assert motions is not None
    (response,), (motion,) = motions.responses.values(), motions.motions.values()
    loads = RNG(9).normal(size=(len(motion.q), 3))
    for j in range(fit.model.joint_count):
        among = np.zeros((*motion.q.shape, 3))
        among[:, j] = loads
        np.testing.assert_allclose(response.of_joint(loads, j), response.at_samples(among)[:, j], rtol=1e-9, atol=1e-12)


def test_a_regressor_of_many_points_is_that_of_each_and_takes_little_more_than_itself(fit: Fit) -> None:
    parameters, rng = fit.model.parameters, RNG(10)
    assert isinstance(parameters, RobotParameters)
    q, dq, ddq = (rng.normal(size=(3 * TOGETHER + 7, fit.model.joint_count)) for _ in range(3))
    columns, known = parameters.regressor(q, dq, ddq)
    for k in (0, TOGETHER - 1, TOGETHER, len(q) - 1):
        own = slice(k, k + 1)
        np.testing.assert_array_equal(columns[own], parameters.regressor(q[own], dq[own], ddq[own])[0])
        np.testing.assert_array_equal(known[own], parameters.regressor(q[own], dq[own], ddq[own])[1])
    longer = [np.tile(signal, (8, 1)) for signal in (q, dq, ddq)]
    assert peak_of(lambda: parameters.regressor(*longer)) < 1.5 * 8 * (columns.nbytes + known.nbytes)


def test_a_residual_that_is_changed_forgets_its_colour() -> None:
    """What is known of one is not said of another one."""
    rng, time = RNG(11), np.arange(400) / 20.0
    motion = np.column_stack([np.sin((k + 1) * time) for k in range(6)])
    one = JointResidual(1, Left(rng.normal(size=400), np.ones((400, 1)), of_logs(time)), motion, list("abcdef"))
    assert one.dependence().p_value > 1e-3
    assert replace(one, left=replace(one.left, residual=one.residual + motion[:, 2])).dependence().p_value < 1e-9
