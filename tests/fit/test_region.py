"""Least squares over what machines can be: inside nothing changes, outside the answer is the best machine."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.data.signals import Array
from fmu_didim.fit.linear_problem import LinearProblem
from fmu_didim.fit.region import ACCURACY, SMALLEST, SMALLEST_OF_START, SOLVED, Region
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.loop_model import LoopModel
from tests.helpers import ROOT

CASES = ("scara/identify", "arm2r/discover")


@cache
def loop(name: str) -> LoopModel:
    return load_case(ROOT / f"examples/{name}.yaml", require_torque=False).model


def drawn(size: int, seed: int) -> Array:
    """A table (2 p, p) of well-conditioned columns."""
    return np.random.default_rng(seed).standard_normal((2 * size, size))


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_inside_nothing_changes(name: str, damping: float) -> None:
    """To the bit: the step of the unlimited problem."""
    model = loop(name)
    truth, region = model.start, Region.of(model)
    assert region.machines
    table = drawn(truth.size, 3) / np.maximum(np.abs(truth), 1e-3)
    equations = LinearProblem.of(1e3 * table[:, None, :], (1e3 * table @ (0.01 * truth))[:, None])
    free = Region(region.low, region.high)
    assert (equations.step(truth, region, damping)[0] == equations.step(truth, free, damping)[0]).all()


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("seed", range(20))
def test_whatever_the_data_say_the_answer_can_be_simulated(name: str, seed: int) -> None:
    """Targets from a thousandth to a thousand times the truth, signs drawn: the step leads to a machine."""
    model = loop(name)
    truth, region, rng = model.start, Region.of(model), np.random.default_rng(seed)
    wrong = truth * 10 ** rng.uniform(-3, 3, truth.size) * rng.choice([-1, 1], truth.size)
    table = drawn(truth.size, seed) / np.maximum(np.abs(wrong), 1e-3)
    equations = LinearProblem.of(1e3 * table[:, None, :], (1e3 * table @ wrong)[:, None])
    step, promised = equations.step(np.zeros(truth.size), region, 0.0)
    assert mass_matrix_problem(model, step) == ""
    friction = [i for i, name in enumerate(model.names) if name[:2] in ("Fv", "Fc")]
    assert (step[friction] >= 0).all()
    assert promised <= equations.promised(wrong) * (1 + 1e-9)


def test_friction_is_held_at_zero_and_the_others_make_up_for_it() -> None:
    """As a solver of another kind finds: with one limit in the way, least squares with that value known."""
    model = loop("scara/identify")
    truth, region = model.start, Region.of(model)
    wanted = truth.copy()
    held = model.names.index("Fv2")
    wanted[held] = -0.05
    table = 1e3 * drawn(truth.size, 5) / np.abs(truth)
    found = region.least_squares(table, table @ wanted).values
    assert found[held] == 0.0
    others = np.delete(np.arange(truth.size), held)
    expected = np.linalg.lstsq(table[:, others], table @ wanted, rcond=None)[0]
    assert found[others] == pytest.approx(expected, rel=1e-5)


def test_a_light_link_is_the_nearest_one_that_exists() -> None:
    """A second link whose first moment no mass of its inertia has: MX2^2 <= ZZ2 M2, and M2 is part of ZZ1R."""
    model = loop("scara/identify")
    region, base = Region.of(model), model.start
    wanted = base.copy()
    wanted[model.names.index("ZZ2")] = -0.1
    table = 1e3 * np.diag(1 / np.abs(base))
    found = region.least_squares(table, table @ wanted)
    assert mass_matrix_problem(model, found.values) == ""

    def cost(values: Array) -> float:
        return float(np.sum((table @ (values - wanted)) ** 2))

    def smallest(values: Array) -> float:
        machine = region.machines[0]
        matrices = machine.columns @ values + machine.known
        scale = np.sqrt(np.abs(np.einsum("kii->ki", matrices)))
        return float(np.linalg.eigvalsh(matrices / scale[:, :, None] / scale[:, None, :]).min())

    assert smallest(found.values) >= 0.999 * SMALLEST
    assert found.squares == pytest.approx(cost(found.values))
    # Along the way to what the data ask for, nothing nearer can be simulated.
    for part in (0.001, 0.01, 0.1):
        nearer = found.values + part * (wanted - found.values)
        assert smallest(nearer) < SMALLEST or mass_matrix_problem(model, nearer)


def test_a_start_is_far_from_stiff() -> None:
    model = loop("arm2r/discover")
    region = Region.of(model).of_start()
    wanted = model.start.copy()
    wanted[model.names.index("ZZ2")] *= 0.01
    table = 1e3 * np.diag(1 / np.abs(wanted))
    found = region.least_squares(table, table @ wanted).values
    machine = region.machines[0]
    matrices = machine.columns @ found + machine.known
    scale = np.sqrt(np.einsum("kii->ki", matrices))
    assert np.linalg.eigvalsh(matrices / scale[:, :, None] / scale[:, None, :]).min() >= 0.999 * SMALLEST_OF_START


def beside_a_limit(model: LoopModel) -> Region:
    """The region with one more parameter, that of an effect, at its lowest value."""
    region = Region.of(model)
    low, high = np.append(region.low, 0.0), np.append(region.high, 1.0)
    return Region(low, high, region.machines, np.append(region.base, False))


@pytest.mark.parametrize("damping", [0.0, 0.1])
@pytest.mark.parametrize("known", [False, True], ids=["no machine known yet", "a machine known"])
@pytest.mark.parametrize("at", [0.0, 1.0], ids=["lowest", "highest"])
def test_what_is_at_its_limit_stays_there_beside_the_nearest_machine(damping: float, known: bool, at: float) -> None:
    """As without its column, to the accuracy of the solver. A step that took it beyond promised what clipping then took
    back: fits of a measured TX40 stood still with 164 of chi-square promised, step after step."""
    model = loop("scara/identify")
    truth, region = model.start, beside_a_limit(model)
    table = 1e3 * drawn(truth.size, 5) / np.abs(truth)
    if known:
        Region.of(model).least_squares(table, table @ truth)
    wanted = truth.copy()
    wanted[model.names.index("ZZ2")] *= -1.0  # of no machine
    own = 1e3 * np.random.default_rng(6).standard_normal(len(table))
    out = 10.0 if at else -10.0
    target = (table @ (wanted - truth) + out * own)[:, None]
    equations = LinearProblem.of(np.column_stack([table, own])[:, None, :], target)
    step, promised = equations.step(np.append(truth, at), region, damping)
    assert step[-1] == 0.0
    without = LinearProblem.of(table[:, None, :], target)
    expected, gain = without.step(truth, Region.of(model), damping)
    # The solver goes to a part of the squares: how far apart the values are then depends on the processor.
    assert np.linalg.norm(table @ (step[:-1] - expected)) < np.sqrt(ACCURACY * gain)
    assert promised == pytest.approx(gain, rel=1e-6)
    assert promised > 0


def test_idle_parameters_stay() -> None:
    model = loop("scara/identify")
    table = drawn(model.start.size, 7)
    table[:, 2] = 0.0
    wanted = 0.1 * model.start
    wanted[model.names.index("ZZ2")] *= -1.0
    equations = LinearProblem.of(table[:, None, :], (table @ (wanted - model.start))[:, None])
    step = equations.step(model.start, Region.of(model), 0.0)[0]
    assert step[2] == 0.0
    assert mass_matrix_problem(model, model.start + step) == ""


@pytest.mark.parametrize("weight", [1e-3, 1e3])
def test_what_has_a_limit_of_its_own_is_held_there_without_the_solver(weight: float) -> None:
    """Friction that the data ask to be negative: the others are those of least squares beside it, to rounding."""
    model = loop("scara/identify")
    truth, region = model.start, Region.of(model)
    table = weight * drawn(truth.size, 5) / np.abs(truth)
    region.least_squares(table, table @ truth)  # a machine is known from now on
    held = model.names.index("Fv2")
    wanted = truth.copy()
    wanted[held] = -0.5 * truth[held]
    equations = LinearProblem.of(table[:, None, :], (table @ (wanted - truth))[:, None])
    step = equations.step(truth, region, 0.0)[0]
    assert step[held] == -truth[held]
    others = np.delete(np.arange(truth.size), held)
    expected = np.linalg.lstsq(table[:, others], table @ (wanted - truth) + table[:, held] * truth[held], rcond=None)[0]
    np.testing.assert_allclose(step[others] / truth[others], expected / truth[others], rtol=0, atol=1e-12)


def test_a_step_out_of_the_machines_is_seen_where_it_leads() -> None:
    """To an inertia of the second link that is negative; the other way there are machines."""
    model = loop("scara/identify")
    truth, region = model.start, Region.of(model)
    table = 1e3 * np.diag(1 / np.abs(truth))
    region.least_squares(table, table @ truth)
    change = np.zeros(truth.size)
    change[model.names.index("ZZ2")] = -2 * truth[model.names.index("ZZ2")]
    assert region.surely_holds(truth - change) and mass_matrix_problem(model, truth + change)
    equations = LinearProblem.of(table[:, None, :], (table @ change)[:, None])
    step = equations.step(truth, region, 0.0)[0]
    assert mass_matrix_problem(model, truth + step) == ""


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("target", [-0.1, 0.001, 0.01, 0.3, 1.0], ids=lambda part: f"{part} of an inertia")
def test_inertia_matrices_are_looked_at_where_they_decide(name: str, target: float) -> None:
    """Solved without them first, where they hold by themselves: never a worse answer than with all of them at once,
    and never one that they forbid; with those that decide where they do not, to the same answer as with all."""
    model = loop(name)
    truth, region = model.start, Region.of(model).of_start()
    wanted = truth.copy()
    wanted[model.names.index("ZZ2")] *= target
    table = 1e3 * drawn(truth.size, 3) / np.abs(truth)
    found, at_once = region.least_squares(table, table @ wanted), region._solved(table, table @ wanted)
    machine = region.machines[0]
    nowhere = machine.bounded_at(np.zeros(len(machine.known), dtype=np.bool_))
    anywhere = Region(region.low, region.high, (nowhere,), region.base).least_squares(table, table @ wanted)
    assert machine.inertia_holds(found.values, 0.999 * SMALLEST_OF_START)
    assert found.squares <= at_once.squares * (1 + 1e-4) + 1e-4
    if machine.inertia_holds(anywhere.values, SMALLEST_OF_START):
        assert (found.values == anywhere.values).all()
    else:
        apart = np.abs(table @ (found.values - at_once.values)).max()
        assert apart <= SOLVED * np.linalg.norm(table @ wanted)
        assert anywhere.squares < found.squares


@pytest.mark.parametrize("name", CASES)
def test_the_solver_goes_far_below_a_standard_deviation(name: str) -> None:
    """Of data that are twenty thousand deviations large, as those of a TX40 are."""
    model = loop(name)
    truth, region = model.start, Region.of(model)
    table = drawn(truth.size, 3) / np.abs(truth)
    table *= 2e4 / np.linalg.norm(table @ truth)
    found = region.least_squares(table, table @ truth).values
    assert np.linalg.norm(table @ (found - truth)) < 3e-6
