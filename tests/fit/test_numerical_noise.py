"""Fits of loops whose torque jitters: values and deviations as without jitter, or told where they cannot be.

The torque of the loop is another one in each piece of a width, for each of three parameters, two of whose columns are
the same to 0.3 %. Their standard deviations are about 0.017, that of the noise is 1e-3. Where a fit ends depends on
which jitter it meets, so that what holds is a share of many draws.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.optimize import least_squares

from fmu_didim.case import load_case
from fmu_didim.checks.identification import JITTER, SECOND_STEP
from fmu_didim.components.fmu import load_fmu
from fmu_didim.components.fmu.description import CO_SIMULATION, MODEL_EXCHANGE, OWN_TOOL
from fmu_didim.data.signals import Array
from fmu_didim.export import build_fmu
from fmu_didim.fit.derivatives.differences import Step
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.linear_step import LinearStep
from fmu_didim.fit.solver.numerical_noise import roughness, smoother_advice, smoother_after_step
from fmu_didim.fit.solver.termination import Stopping, Termination
from tests.awkward.build import awkward_fmu
from tests.campaigns.helpers import sledge_case
from tests.cosim.test_exchange import lag
from tests.fit.test_differences import COUNT, deviations, law_model, slopes, smooth
from tests.model.law_model import LawModel

SIGMA = 1e-3
NOISE = Noise(np.array([SIGMA]), np.zeros(1), "residual")
START = np.array([0.8, 1.3, 0.9])


def fitted(size: float, width: float, seed: int = 5) -> tuple[Fit, Array]:
    """A fit of noisy data, and what SciPy finds for the same loop without jitter."""
    measured = smooth(dict.fromkeys("abc", 1.0)) + SIGMA * np.random.default_rng(seed).normal(size=COUNT)
    model = replace(law_model(size, width), data={"one": measured[:, None]}).with_values(START)
    ideal = least_squares(
        lambda v: (measured - smooth(dict(zip("abc", v, strict=True)))) / SIGMA, START, xtol=1e-12, ftol=1e-14
    )
    stopping = Stopping(20, tolerance=1e-6, updates=None, check_all=False, exact=True)
    return minimise(model, NOISE, stopping=stopping), ideal.x  # type: ignore[arg-type]


@dataclass(frozen=True)
class Drawn:
    """What became of the fit of one draw of noise.

    Attributes:
        away: farthest value from that without jitter, in standard deviations; wrong: largest relative error of a
            standard deviation; told: whether a result would name it as rough; covers: whether 1.96 standard deviations
            reach from each value to the true one.
    """

    settled: bool
    away: float
    wrong: float
    told: bool
    covers: Array

    def holds(self, away: float, wrong: float) -> bool:
        """Whether values and deviations are those without jitter, and said to be."""
        return self.settled and not self.told and self.away <= away and self.wrong <= wrong


def drawn(size: float, width: float, seed: int) -> Drawn:
    fit, ideal = fitted(size, width, seed)
    sigma, own = SIGMA * deviations(slopes(ideal)), np.sqrt(np.diag(fit.covariance))
    found = roughness(fit)
    assert found is not None
    told = found.change > SECOND_STEP or found.jitter > JITTER
    away, wrong = np.max(np.abs(fit.values - ideal) / sigma), np.max(np.abs(own / sigma - 1))
    return Drawn(fit.settled, float(away), float(wrong), told, np.abs(fit.values - 1) <= 1.96 * own)


@pytest.mark.parametrize(("size", "width"), [(0.0, 1.0), (1e-7, 1e-9), (1e-6, 2e-8), (1e-5, 1e-9)])
def test_values_and_deviations_are_those_without_jitter(size: float, width: float) -> None:
    """Of 10 draws at least 9; of 100 all did."""
    assert sum(drawn(size, width, seed).holds(0.5, 0.05) for seed in range(10)) >= 9


@pytest.mark.slow
@pytest.mark.parametrize("width", [1e-12, 1e-9, 2e-8, 1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("size", [1e-7, 1e-6, 3e-6, 1e-5])
def test_of_100_draws_at_least_99_are_as_without_jitter(size: float, width: float) -> None:
    assert sum(drawn(size, width, seed).holds(0.5, 0.05) for seed in range(100)) >= 99


@pytest.mark.slow
@pytest.mark.parametrize("width", [1e-9, 2e-8, 1e-4])
def test_where_it_ends_intervals_still_hold(width: float) -> None:
    """With a jitter of 3 % of the noise the columns err by two fifths of their smallest singular value: values scatter
    by a third of a deviation, and a few fits do not settle."""
    found = [drawn(3e-5, width, seed) for seed in range(100)]
    assert sum(one.holds(1.5, SECOND_STEP) for one in found) >= 90
    settled = np.array([one.covers for one in found if one.settled])
    assert (settled.mean(axis=0) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / len(settled))).all()


@pytest.mark.slow
@pytest.mark.parametrize("size", [1e-6, 1e-5])
def test_pieces_half_as_wide_as_a_deviation_leave_a_few_fits_unsettled(size: float) -> None:
    found = [drawn(size, 1e-2, seed) for seed in range(100)]
    assert sum(one.holds(0.5, 0.05) for one in found) >= 93
    assert sum(one.settled and not one.told and one.away > 0.6 for one in found) <= 1


def test_beyond_that_it_is_told() -> None:
    assert all(drawn(1e-4, 2e-8, seed).told for seed in range(5))


@pytest.mark.slow
@pytest.mark.parametrize("width", [1e-12, 2e-8, 1e-5, 1e-2])
@pytest.mark.parametrize("size", [1e-4, 3e-4, 1e-3])
def test_beyond_that_each_of_100_draws_is_told(size: float, width: float) -> None:
    assert all(drawn(size, width, seed).told for seed in range(100))


def test_jitter_is_measured_in_deviations_of_the_residual() -> None:
    """Three parameters move at once in a step, one in a column: that is a jitter of 1e-4, a tenth of the noise."""
    found = roughness(fitted(1e-4, 1e-9)[0])
    assert found is not None and 0.05 <= found.jitter <= 0.2


@pytest.mark.parametrize(
    ("jitter", "promised", "nothing"),
    [
        ((), 1e-9, False),  # nothing jitters: the steps go on
        ((1e-3,), 0.113, True),  # two costs of 400 differ by 2 * 0.001 * 20 * sqrt(2 * 4)
        ((1e-3,), 0.114, False),
        ((1e-2,), 0.24, True),  # at most half a deviation
        ((1e-2,), 0.26, False),
        ((0.5,), 0.25 * 18.4, True),  # 99.9 % of chi-square with four degrees of freedom are below 18.47
        ((0.5,), 0.25 * 18.5, False),
    ],
)
def test_steps_that_jitter_alone_asks_for_are_none(jitter: tuple[float, ...], promised: float, nothing: bool) -> None:
    steps = {("one", 0): Step(8, 0.01, tuple(2 * j for j in jitter)), ("one", 1): Step(5, 1e-6)}
    scale = np.full(4, 1.0)
    step = LinearStep(None, np.ones(4), np.array([2.0]), 400.0, promised, scale, scale, 1.0)  # type: ignore[arg-type]
    assert Termination(Stopping(), steps).is_nothing(step) is nothing


def test_deviations_that_depend_on_the_step_are_told() -> None:
    """Jitter as large as the noise: no step tells the two columns from each other."""
    fit, _ = fitted(1e-3, 1e-9)
    found = roughness(fit)
    assert found is not None and found.change > 0.1 and found.parameter in "ac" and found.jitter > 0.5


def test_a_slope_that_holds_for_tiny_changes_alone_is_told() -> None:
    """A wave as long as a deviation, whose slope short steps see: over a deviation it is another one."""

    def law(v: Mapping[str, float], label: str) -> Array:
        wave = 2e-4 * np.sin((v["a"] - 1) / 2e-5)
        return np.asarray(smooth(v) + wave * np.cos(np.linspace(0, 9, COUNT)))[:, None]

    model = replace(law_model(), law=law)
    fit = minimise(model, NOISE, stopping=Stopping(0, exact=True))  # type: ignore[arg-type]
    found = roughness(fit)
    assert found is not None and found.change > 0.1


def test_a_loop_without_central_differences_has_no_roughness() -> None:
    smooth_loop: LawModel = replace(law_model(), can_refine=True)
    fit = minimise(smooth_loop, NOISE, stopping=Stopping(0))  # type: ignore[arg-type]
    assert roughness(fit) is None


@pytest.mark.parametrize(
    ("macros", "after_step", "name"),
    [
        (("ROUGH_BETWEEN_STEPS",), False, "controller"),
        *(
            pytest.param(*one, marks=pytest.mark.gate)
            for one in ((("ROUGH_BETWEEN_STEPS",), True, ""), ((), False, ""))
        ),
    ],
)
def test_whose_outputs_are_better_taken_after_its_step(
    macros: tuple[str, ...], after_step: bool, name: str, tmp_path: Path
) -> None:
    content = sledge_case(str(awkward_fmu(tmp_path, *macros)))
    content["controller"] |= {"outputs_after_step": after_step, "isolated": False}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(content["robot"]), encoding="utf-8")
    content["robot"] = "robot.yaml"
    np.savetxt(
        tmp_path / "none.csv", [[0.02 * k, 0.0] for k in range(200)], delimiter=",", header="t,tau1", comments=""
    )
    assert smoother_after_step(load_case(content, folder=tmp_path).model) == name


@pytest.mark.parametrize(
    ("tool", "kinds", "told", "not_told"),
    [
        (
            "other",
            (CO_SIMULATION, MODEL_EXCHANGE),
            "Run the model with our integrator (model: {interface: ",
            "offers no",
        ),
        ("other", (CO_SIMULATION,), "offers no model exchange", "with our integrator"),
        (OWN_TOOL, (CO_SIMULATION,), "", "model"),
    ],
)
def test_only_what_an_fmu_offers_is_advised(tool: str, kinds: tuple[str, ...], told: str, not_told: str) -> None:
    """Else its user looks for a model exchange that the FMU does not have."""
    component = load_fmu(build_fmu(lag()))
    offered = tuple(one for one in component.fmu.interfaces if one.kind in kinds)
    foreign = replace(component, fmu=replace(component.fmu, tool=tool, interfaces=offered), block=None)
    system = SimpleNamespace(components={"model": foreign})
    model: Any = SimpleNamespace(first="a", loop=SimpleNamespace(systems={"a": system}))
    assert told in smoother_advice(model) and not_told not in smoother_advice(model)
