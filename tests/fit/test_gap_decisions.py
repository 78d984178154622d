"""The gap and what a comparison of two models is worth, by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.document import values_found
from fmu_didim.fit.gap import (
    bic_gain,
    channel_gaps,
    delta_bic,
    explained,
    explained_gap,
    held_out_block,
    held_out_blocks,
    held_out_ratios,
    joint_gaps,
    part_of_first,
    rms_ratio,
    total_gap,
)
from fmu_didim.fit.statistics import confidence_interval
from fmu_didim.model.free_parameter import PLANT, FreeParameter
from tests.discovery.by_hand import SIGNS, TableModel, fit_of, noise, residual

TWO = noise([1.0, 2.0])
LOG = np.log(400)


def test_gaps_by_hand() -> None:
    table = residual(5.0, 4.0 * 1.25)
    assert joint_gaps(table, TWO).tolist() == pytest.approx([2.0, 0.5])
    assert total_gap(table, TWO) == pytest.approx(np.sqrt((5 + 1.25) / 2 - 1))
    assert joint_gaps(residual(0.5, 3.9), TWO).tolist() == [0.0, 0.0]
    assert total_gap(residual(0.5, 4.0), TWO) == 0.0


@pytest.mark.parametrize(
    ("before", "after", "cost", "wanted"),
    [
        ((4.0,), (2.0,), 1.0, 400 * np.log(2) - LOG),
        ((4.0,), (2.0,), 3.0, 400 * np.log(2) - 3 * LOG),
        ((4.0,), (2.0,), -1.0, 400 * np.log(2) + LOG),
        ((2.0,), (4.0,), 0.0, -400 * np.log(2)),
        # No residual counts as less than a quarter of the variance of the noise.
        ((1.0,), (0.26,), 0.0, 400 * np.log(1 / 0.26)),
        ((1.0,), (0.24,), 0.0, 400 * np.log(4)),
        ((1.0,), (0.001,), 0.0, 400 * np.log(4)),
        ((0.2,), (0.1,), 1.0, -LOG),
    ],
)
def test_difference_of_the_information_criterion(
    before: tuple[float], after: tuple[float], cost: float, wanted: float
) -> None:
    assert delta_bic(residual(*before), residual(*after), cost, noise()) == pytest.approx(wanted, abs=1e-9)


def test_joints_add_up_and_all_samples_count_in_the_cost() -> None:
    found = delta_bic(residual(4.0, 16.0), residual(2.0, 4.0), 1.0, TWO)
    assert found == pytest.approx(400 * np.log(2) + 400 * np.log(4) - np.log(800))


def test_what_is_left_by_the_better_model_says_how_many_samples_count() -> None:
    slow = np.where(np.arange(400) // 2 % 2 == 0, 1.0, -1.0)[:, None]  # neighbours: half alike, half not
    rho = float(np.sum(slow[1:] * slow[:-1]) / 400)
    factor = (1 - rho) / (1 + rho)
    assert 0 < rho < 0.01
    assert delta_bic(2 * residual(1.0), slow, 0.0, noise()) == pytest.approx(400 * factor * np.log(4))
    blocks = np.where(np.arange(400) // 50 % 2 == 0, 1.0, -1.0)[:, None]
    rho = float(np.sum(blocks[1:] * blocks[:-1]) / 400)
    assert delta_bic(2 * residual(1.0), blocks, 0.0, noise()) == pytest.approx(400 * (1 - rho) / (1 + rho) * np.log(4))
    # The colour of what is worse does not matter.
    assert delta_bic(2 * blocks, residual(1.0), 0.0, noise()) == pytest.approx(400 * np.log(4))


def test_two_samples_count_at_least() -> None:
    one = np.array([[1.0], [1.0]])
    assert delta_bic(one, one, 1.0, noise()) == pytest.approx(-np.log(2))


@pytest.mark.parametrize(
    ("before", "after", "size", "share"),
    [
        ((5.0, 4.0), (1.0, 4.0), 2.0, 1.0),
        ((5.0, 4.0), (3.0, 4.0), np.sqrt(2), 0.5),
        ((5.0, 20.0), (3.0, 12.0), np.sqrt(2), 0.5),  # (2 + 2) of (4 + 4), on both joints alike
        ((5.0, 20.0), (3.0, 8.0), np.sqrt(3), 5 / 8),
        ((5.0, 4.0), (6.0, 4.0), 0.0, 0.0),
        ((5.0, 4.0), (0.5, 4.0), np.sqrt(4.5), 1.0),
        ((1.5, 2.0), (1.25, 2.0), 0.5, 0.5),  # half of a small gap
        ((0.5, 2.0), (0.25, 2.0), 0.5, 0.0),  # no gap, no share of it
    ],
)
def test_what_a_model_explains(before: tuple[float], after: tuple[float], size: float, share: float) -> None:
    assert explained(residual(*before), residual(*after), TWO) == (pytest.approx(size), pytest.approx(share))


@pytest.mark.parametrize(
    ("first", "before", "after", "wanted"),
    [
        ((101.0, 4.0), (50.0, 4.0), (47.0, 4.0), 0.03),
        ((101.0, 84.0), (50.0, 44.0), (48.0, 4.0), 0.5),  # (11 - 1) of (21 - 1) on the second joint, where it is most
        ((101.0, 8.0), (47.0, 8.0), (50.0, 8.0), 0.0),
        ((1.0, 4.0), (1.0, 4.0), (0.5, 4.0), 1.0),  # no gap at all there
        ((1.5, 4.0), (1.5, 4.0), (1.25, 4.0), 0.5),
    ],
)
def test_part_of_the_first_gap(first: tuple[float], before: tuple[float], after: tuple[float], wanted: float) -> None:
    tables = [residual(*squares) for squares in (first, before, after)]
    assert part_of_first(tables[0], tables[1], tables[2], TWO) == pytest.approx(wanted, abs=1e-12)


def test_ratio_of_two_residuals() -> None:
    found = rms_ratio(residual(9.0, 4.0), residual(1.0, 16.0), TWO, block=10)
    assert found.value == pytest.approx(np.sqrt((1 + 4) / (9 + 1)))
    assert found.low == pytest.approx(found.value) == found.high
    assert rms_ratio(np.zeros((400, 2)), np.zeros((400, 2)), TWO, block=1000).value == 0.0


def test_what_is_shorter_than_two_blocks_is_one() -> None:
    uneven = residual(1.0) * np.where(np.arange(400) < 200, 0.2, 1.3)[:, None]
    found = rms_ratio(residual(1.0), uneven, noise(), block=300)
    assert found.low == pytest.approx(found.value) == found.high


def test_interval_of_a_ratio_against_the_normal_one() -> None:
    rng = np.random.default_rng(3)
    before, after = rng.normal(size=(4000, 1)), 0.8 * rng.normal(size=(4000, 1))
    found = rms_ratio(before, after, noise(), block=1)
    deviation = found.value * np.sqrt(2 * 2 / (4 * 4000))  # of the root of a ratio of two variances
    assert (found.high - found.low) / (2 * 1.96 * deviation) == pytest.approx(1.0, abs=0.06)
    again, other = (rms_ratio(before, after, noise(), block=1, seed=seed) for seed in (0, 1))
    assert found == again != other


@pytest.mark.parametrize(("correlation", "freedom"), [(0.0, 2 * 400 - 2), (0.98, 800 / 99 - 2)])
def test_intervals_of_values_that_were_found(correlation: float, freedom: float) -> None:
    parameters = tuple(FreeParameter(n, "N", "plant", n, v, 1.0) for n, v in (("a", 2.0), ("b", 3.0)))
    slopes = np.stack([np.tile(SIGNS[:, None], (1, 2)), np.ones((400, 2))], axis=2)
    white = noise([1.0, 2.0], correlation=correlation)
    fit = fit_of(TableModel(residual(1.0, 4.0), {}, (), parameters), values=[2.0, 3.0], jacobian=slopes, white=white)
    (one,) = values_found(fit, lambda parameter: parameter.name == "b")
    std = 1 / np.sqrt(400 * 1.25 * white.factor[0])
    assert (one.name, one.unit, one.value, one.std) == ("b", "N", 3.0, pytest.approx(std))
    wanted: Array = confidence_interval(np.array([3.0]), np.array([std]), freedom)[0]
    assert one.interval == pytest.approx(tuple(wanted), rel=1e-12)
    assert (one.interval[1] - 3.0) / std == pytest.approx({0.0: 1.962939, 0.98: 2.438}[correlation], rel=2e-3)


def with_channel(torque: float, position: float, *, free: tuple[FreeParameter, ...] = (), variance: Any = None) -> Any:
    """A fit of one joint and one position, which leaves these mean squares; it shares what the torque says already."""
    experiments = SimpleNamespace(
        channels=("q1",), blocks=lambda table: [(slice(0, 1), table[:, :1]), (slice(1, 2), table[:, 1:])]
    )
    model = SimpleNamespace(experiments=experiments, free_parameters=free)
    return SimpleNamespace(model=model, residual=residual(torque, position), shared_variance=variance)


def free(name: str, *, effect: int | None, is_shape: bool = False) -> FreeParameter:
    return FreeParameter(name, "N.m", PLANT, name, 1.0, 1.0, effect=effect, is_shape=is_shape)


@pytest.mark.parametrize(
    ("parameters", "once"),
    [
        ((free("ZZ1", effect=None), free("Fs1", effect=0), free("vs1", effect=0, is_shape=True)), 2.0),
        ((free("ZZ1", effect=None), free("kp", effect=None), free("kd", effect=None)), 8.0),  # no effect: the largest
    ],
)
def test_what_outputs_share_counts_once(parameters: tuple[FreeParameter, ...], once: float) -> None:
    before, after = with_channel(4.0, 9.0), with_channel(2.0, 3.0, free=parameters, variance=np.array([4.0, 2.0, 8.0]))
    wanted = 400 * (np.log(2) + np.log(3)) / once - np.log(800)
    assert bic_gain(before, after, 1.0, noise([1.0, 1.0])) == pytest.approx(wanted)


def test_the_gap_of_each_channel_is_in_units_of_its_own_noise() -> None:
    measured = SimpleNamespace(name="q2", values=np.sqrt(5.0) * 0.1 * SIGNS)
    experiment = SimpleNamespace(channels=[measured, SimpleNamespace(name="left out", values=SIGNS)])
    run = SimpleNamespace(channels=lambda: {"q2": np.zeros(SIGNS.size)})
    experiments: Any = {"fitted": experiment}
    model = SimpleNamespace(joint_count=1, experiments=type("Named", (dict,), {"channels": ("q1", "q2")})(experiments))
    fit: Any = SimpleNamespace(model=model, noise=noise([1.0, 9.0, 0.1]), simulation=lambda label: run)
    assert channel_gaps(fit) == {"fitted": {"q2": pytest.approx(2.0)}}

    def stops(label: str) -> Any:
        raise SimulationError("It diverges.", next_step="Change it.")

    fit.simulation = stops
    assert channel_gaps(fit) == {"fitted": {"q2": np.inf}}


def test_without_channels_only_the_torque_counts() -> None:
    before, after = (fit_of(TableModel(residual(*sizes), {}, ())) for sizes in ((4.0, 9.0), (2.0, 9.0)))
    assert bic_gain(before, after, 1.0, noise([1.0, 1.0])) == pytest.approx(400 * np.log(2) - np.log(800))
    assert explained_gap(before, after, noise([1.0, 1.0])) == explained(
        before.residual, after.residual, noise([1.0, 1.0])
    )


def test_ratios_of_held_out_data_belong_to_their_joint() -> None:
    """Joint 1 is left as it was, joint 2 falls to half; without held-out data there is none."""
    first, second = (fit_of(TableModel(residual(4.0, q), {"held": residual(4.0, q)}, ())) for q in (4.0, 1.0))
    found = dict(held_out_ratios(first, second, seed=1))
    assert list(found) == [1, 2]
    assert found[1].value == pytest.approx(1.0) and found[2].value == pytest.approx(0.5)
    alone = fit_of(TableModel(residual(4.0), {}, ()))
    assert held_out_ratios(alone, alone, seed=1) == []


@pytest.mark.parametrize(("there", "blocks"), [([1.0], 1.0), ([1.0, 1.0, 1.0], 3.0), ([2.0, 1.0], 25 / 17)])
def test_blocks_in_which_held_out_models_differ(there: list[float], blocks: float) -> None:
    """(sum d)^2 / sum d^2 of the squares by which they differ; of another joint and its noise, too."""
    before = fit_of(TableModel(residual(4.0, 4.0), {"held": residual(4.0, 4.0)}, ()), white=TWO)
    held, length = residual(4.0, 4.0), held_out_block(before)
    for place, size in enumerate(there):
        held[2 * place * length : (2 * place + 1) * length, place % 2] += size * TWO.deviation[place % 2]
    after = fit_of(TableModel(residual(4.0, 4.0), {"held": held}, ()), white=TWO)
    assert SIGNS.size % length == 0
    assert held_out_blocks(before, after) == pytest.approx(blocks)


def test_without_held_out_data_no_block_is_few() -> None:
    alone = fit_of(TableModel(residual(4.0), {}, ()))
    assert held_out_blocks(alone, alone) == np.inf
