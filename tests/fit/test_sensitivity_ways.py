"""The ways to a sensitivity, on torques that are formulas: which is taken, with which step, for which experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import DivergedError, SimulationError
from fmu_didim.components.derivatives import derivative_name
from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives import repetition as periods
from fmu_didim.fit.derivatives import sensitivity as ways
from fmu_didim.fit.derivatives.sensitivity import parameter_sizes, sensitivity
from fmu_didim.model.external_torque import EXTERNAL_TORQUE
from fmu_didim.model.free_parameter import BASE, DELAY, LOG, PLANT
from tests.model.law_model import LawExperiments, LawLoop, LawModel, LawSimulation, free

T = np.linspace(0, 1, 5)[:, None]


def cubes(values: Mapping[str, float], label: str) -> Array:
    """a^3 and b^2 t, so that steps show in the differences."""
    return np.hstack([values["a"] ** 3 + 0 * T, values["b"] ** 2 * T])


def model(*owners: str, **more: Any) -> LawModel:
    owners = owners or (PLANT, PLANT)
    parameters = tuple(
        free(name, value, owner=owner, scale=scale)
        for name, value, scale, owner in zip("ab", (2.0, 3.0), (10.0, 100.0), owners, strict=True)
    )
    return LawModel(more.pop("law", cubes), {"one": np.zeros((5, 2))}, more.pop("parameters", parameters), **more)


def found(one: LawModel, **more: Any) -> Array:
    torque = one.torque(one.start)
    del one.calls[:]
    return sensitivity(one, one.start, torque, **more)


def steps(one: LawModel) -> list[tuple[float, float]]:
    return [(values[0] - 2.0, values[1] - 3.0) for values, _ in one.calls]


def test_forward_differences_of_a_search() -> None:
    one = model()
    table = found(one, exact=False)
    assert steps(one) == [(pytest.approx(1e-3), 0.0), (0.0, pytest.approx(1e-2))]
    np.testing.assert_allclose(table[:, 0, 0], (2.001**3 - 8) / 1e-3, rtol=1e-9)
    np.testing.assert_allclose(table[:, 1, 1:], (3.01**2 - 9) / 1e-2 * T, rtol=1e-9)
    assert not table[:, 1, 0].any() and not table[:, 0, 1].any()


def test_only_some_parameters() -> None:
    one = model()
    assert found(one, only=[1], exact=False).shape == (5, 2, 1)
    assert len(one.calls) == 1


@pytest.mark.parametrize("owner", [DELAY, LOG, EXTERNAL_TORQUE, BASE])
def test_times_and_base_parameters_of_a_smooth_loop_by_forward_differences(owner: str) -> None:
    one = model(owner, owner)
    table = found(one)
    assert steps(one) == [(pytest.approx(1e-3), 0.0), (0.0, pytest.approx(1e-2))]
    assert table.shape == (5, 2, 2)


def test_exact_forward_differences_take_steps_by_the_size() -> None:
    one = model(BASE, DELAY)
    found(one, sizes=np.array([4.0]))
    assert steps(one) == [(pytest.approx(1.2e-6), 0.0), (0.0, pytest.approx(1e-2))]
    del one.calls[:]
    found(one, sizes=np.array([4.0]), exact=False)
    assert steps(one) == [(pytest.approx(1e-3), 0.0), (0.0, pytest.approx(1e-2))]


def test_central_differences_elsewhere() -> None:
    one = model()
    table = found(one, sizes=np.array([4.0]))
    # Steps of the size of the first, and of the scale of the second: 1e-4 of each, to both sides.
    assert steps(one) == [
        (pytest.approx(4e-4), 0.0), (pytest.approx(-4e-4), 0.0), (0.0, pytest.approx(1e-2)), (0.0, pytest.approx(-1e-2))
    ]  # fmt: skip
    np.testing.assert_allclose(table[:, 0, 0], 12 + 1.6e-7, rtol=1e-9)


@pytest.mark.parametrize(("owner", "count"), [(PLANT, 2), (BASE, 2), (DELAY, 1), (LOG, 1), (EXTERNAL_TORQUE, 1)])
@pytest.mark.parametrize("exact", [True, False])
def test_a_rough_loop_is_differentiated_to_both_sides(owner: str, count: int, exact: bool) -> None:
    one = model(owner, owner, can_refine=False)
    found(one, exact=exact)
    assert len(one.calls) == 2 * count


def test_a_plant_of_known_equations_is_smooth(monkeypatch: pytest.MonkeyPatch) -> None:
    one = model(BASE, BASE, can_refine=False)
    known = SimpleNamespace(parameters=(), equations=lambda: "known")
    monkeypatch.setattr(ways, "with_derivatives", lambda *_: None)
    found(replace(one, plant=known))
    assert len(one.calls) == 2


@pytest.mark.parametrize(
    ("low", "high", "broken", "tried"),
    [
        (-9.0, 2.0005, 9.0, [-1e-3]),
        (1.9995, 2.0005, 9.0, [1e-3 / 30]),
        (2.0, 2.00001, 9.0, []),
        (-9.0, 2.0 + 1e-4 * 10.0, 9.0, [1e-3]),
        (2.0 - 1e-4 * 10.0, 2.0, 9.0, [-1e-3]),
        (-9.0, 9.0, 2.0001, [1e-3, -1e-3]),
        (1.9999, 9.0, 2.0001, [1e-3, 1e-3 / 30]),
    ],
)
def test_forward_differences_at_limits_and_edges(low: float, high: float, broken: float, tried: list[float]) -> None:
    def law(values: Mapping[str, float], label: str) -> Array:
        if values["a"] > broken:
            raise SimulationError("It diverges.", next_step="Change it.")
        return cubes({**values, "b": 3.0}, label)

    one = model(law=law, parameters=(free("a", 2.0, low, high, scale=10.0),))
    table = found(one, exact=False)
    assert [values[0] - 2.0 for values, _ in one.calls] == pytest.approx(tried, abs=1e-12)
    if tried:
        np.testing.assert_allclose(table[:, 0, 0], 12.0, rtol=1e-3)
    else:
        assert not table.any()


def test_each_experiment_moves_what_acts_there() -> None:
    def law(values: Mapping[str, float], label: str) -> Array:
        return np.hstack([(values["a"] + (5 * values["b"] if label == "two" else 0)) * T])

    one = LawModel(
        law, {"one": np.zeros((5, 1)), "two": np.zeros((5, 1))},
        (free("a", 2.0, scale=10.0), free("b", 3.0, scale=10.0, experiment="two")),
    )  # fmt: skip
    table = found(one, exact=False)
    assert [label for _, label in one.calls] == ["one", "two", "two"]
    np.testing.assert_allclose(table[:5, 0, 0], T[:, 0], rtol=1e-9)
    np.testing.assert_allclose(table[5:, 0], np.hstack([T, 5 * T]), rtol=1e-9)
    assert not table[:5, 0, 1].any()


def test_columns_are_told_apart_in_units_of_each_joint(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of torques of 8, of 9 t, of nothing and of a quarter."""
    seen: list[Array] = []
    monkeypatch.setattr(ways, "smallest_singular_value", lambda table: seen.append(table) or 1.0)

    def law(values: Mapping[str, float], label: str) -> Array:
        return np.hstack([cubes(values, label), 0 * T, values["b"] / 12 + 0 * T])

    one = LawModel(law, {"one": np.zeros((5, 4))}, model().free_parameters)
    table = found(one)
    size = np.array([8.0, 9 * float(np.sqrt(np.mean(T**2))), 1.0, 0.25])
    np.testing.assert_allclose(seen[0], table / size[:, None])


def test_tasks_run_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []
    monkeypatch.setattr(
        ways, "side_by_side", lambda tasks, workers: asked.append((len(tasks), workers)) or [t() for t in tasks]
    )
    found(model(workers=3), exact=False)
    found(model(workers=3), only=[0], exact=False)
    assert asked == [(2, 3), (1, 1)]


# ---- one run with its derivatives


class Varied:
    """A loop with derivatives, and what it was asked for.

    Args:
        compiled: whether it ran as compiled code; absent: whether nothing could be differentiated; diverges: whether
            the derivatives grow beyond all bounds, while the loop itself does not.
    """

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, *, compiled: bool = True, absent: bool = False, diverges: bool = False
    ) -> None:
        self.places: list[Any] = []

        def with_derivatives(system: Any, places: list[Any], observed: list[str]) -> Any:
            self.places = places
            return None if absent else "varied"

        def record(run: Any, *, system: Any, ticks: Any, signals: Any) -> Any:
            if diverges:
                raise DivergedError("The closed loop diverged.", time=0.5, next_step="Lower the gains.")
            lanes = range(len(self.places))
            inputs = {
                derivative_name(n, k): np.full(7, 10.0 * k + j)
                for k in lanes
                for j, n in enumerate(("drive.u1", "drive.u2"))
            }
            return SimpleNamespace(compiled=compiled, inputs=inputs)

        monkeypatch.setattr(ways, "with_derivatives", with_derivatives)
        monkeypatch.setattr(LawSimulation, "record", record)
        monkeypatch.setattr(LawLoop, "logged", ("drive.u1", "drive.u2"), raising=False)
        monkeypatch.setattr(LawSimulation, "operator", SimpleNamespace(ticks=range(7), apply=lambda table: table[:5]))
        monkeypatch.setattr(LawExperiments, "compared", lambda _, table, label: table + 0.5, raising=False)


def test_derivatives_of_one_run_where_the_equations_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    varied, one = Varied(monkeypatch), model("controller", PLANT)
    table = found(one)
    assert varied.places == [("controller", "a"), ("plant", "b")]
    assert one.calls == []
    assert table[3].tolist() == [[0.5, 10.5], [1.5, 11.5]]


def test_base_parameters_have_their_names_in_the_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    varied, one = Varied(monkeypatch), model(BASE, BASE)
    known = SimpleNamespace(names=("b", "a"), plant_names=("inertia", "mass"))
    monkeypatch.setattr(LawModel, "parameters", property(lambda self: known))
    found(one)
    assert varied.places == [("plant", "mass"), ("plant", "inertia")]


def test_what_is_no_parameter_of_a_component_is_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    varied, one = Varied(monkeypatch), model(PLANT, DELAY)
    table = found(one)
    assert varied.places == [("plant", "a")]
    assert table[:, 0, 0].tolist() == 5 * [0.5]
    assert steps(one) == [(0.0, pytest.approx(1e-2))]
    np.testing.assert_allclose(table[:, 1, 1], 6.01 * T[:, 0])


def test_a_search_does_not_ask_for_derivatives(monkeypatch: pytest.MonkeyPatch) -> None:
    varied = Varied(monkeypatch)
    found(model(), exact=False)
    assert varied.places == []


@pytest.mark.parametrize(("steps", "is_asked"), [(ways.LONG / 8, False), (ways.LONG / 8 + 1, True)])
def test_a_long_search_asks_for_derivatives(monkeypatch: pytest.MonkeyPatch, steps: float, is_asked: bool) -> None:
    """Two columns of two joints: 2 * 2^2 times the steps of the integration."""
    varied = Varied(monkeypatch)
    monkeypatch.setattr(LawSimulation, "integration_steps", steps)
    found(model(), exact=False)
    assert bool(varied.places) == is_asked


@pytest.mark.parametrize("how", [{"compiled": False}, {"absent": True}, {"diverges": True}])
def test_loops_that_cannot_be_differentiated_are_moved(monkeypatch: pytest.MonkeyPatch, how: dict[str, bool]) -> None:
    Varied(monkeypatch, **how)
    one = model()
    found(one)
    assert len(one.calls) == 4


# ---- the first period alone


class Beginning:
    """A log that repeats: its first part is continued unless it does not repeat."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, repeats: bool = True, absent: bool = False) -> None:
        self.asked: list[Any] = []
        operator = SimpleNamespace(count=2)

        def continued(change: Array, *, tolerance: float = 0.0) -> Array | None:
            return np.vstack([change, change[:1], change[:1], change[:1]]) if repeats else None

        def repetition(experiment: Any, operator_: Any, step: float, torque: Array) -> Any:
            self.asked.append((experiment.operator, step, torque.shape))
            return None if absent else SimpleNamespace(operator=operator, continued=continued)

        monkeypatch.setattr(periods, "repetition", repetition)
        monkeypatch.setattr(periods, "replace", lambda experiment, operator: operator)
        monkeypatch.setattr(
            LawModel, "with_experiment", lambda m, label, operator: replace(m, law=shortened), raising=False
        )
        monkeypatch.setattr(LawLoop, "systems", {"one": SimpleNamespace(step_size=0.25)}, raising=False)


def shortened(values: Mapping[str, float], label: str) -> Array:
    return cubes(values, label)[:2]


EXPERIMENT = {
    "one": SimpleNamespace(
        operator="all", channels=(), scale=None, reference=SimpleNamespace(names=(), time=np.arange(3.0))
    )
}


def repeating(*owners: str, **more: Any) -> LawModel:
    return model(*owners, logs=EXPERIMENT, low_pass=None, **more)


def test_base_parameters_are_moved_for_the_first_period_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    beginning, one = Beginning(monkeypatch), repeating()
    table = found(one, exact=False, whole=False)
    assert beginning.asked == [("all", 0.25, (5, 2))]
    np.testing.assert_allclose(table[:, 1, 1], 6.01 * np.array([0, 0.25, 0, 0, 0]))


@pytest.mark.parametrize("how", [{"repeats": False}, {"absent": True}])
def test_what_does_not_repeat_is_simulated_to_its_end(monkeypatch: pytest.MonkeyPatch, how: dict[str, bool]) -> None:
    Beginning(monkeypatch, **how)
    np.testing.assert_allclose(found(repeating(), exact=False, whole=False)[:, 1, 1], 6.01 * T[:, 0])


def test_exact_sensitivities_are_not_continued(monkeypatch: pytest.MonkeyPatch) -> None:
    beginning = Beginning(monkeypatch)
    found(repeating(BASE, BASE))
    assert beginning.asked == []


def test_filtered_logs_and_plants_with_a_clock_are_not_continued(monkeypatch: pytest.MonkeyPatch) -> None:
    beginning = Beginning(monkeypatch)
    found(replace(repeating(), low_pass="filter"), exact=False, whole=False)
    clock = SimpleNamespace(parameters=(SimpleNamespace(name="t_start"),), equations=lambda: None)
    found(replace(repeating(), plant=clock), exact=False, whole=False)
    assert beginning.asked == []


@pytest.mark.parametrize("more", [{"effect": 0}, {"owner": EXTERNAL_TORQUE}])
def test_what_may_begin_late_is_not_continued(monkeypatch: pytest.MonkeyPatch, more: dict[str, Any]) -> None:
    Beginning(monkeypatch)
    parameters = (free("a", 2.0), free("b", 3.0, scale=100.0, **more))
    np.testing.assert_allclose(
        found(repeating(parameters=parameters), exact=False, whole=False)[:, 1, 1], 6.01 * T[:, 0]
    )


# ---- sizes


def test_sizes_by_the_regressor() -> None:
    regressor = np.zeros((5, 2, 3))
    regressor[:, 0, 0], regressor[:, :, 1] = 2.0, 1.0
    prediction = SimpleNamespace(torque=np.full((5, 2), 3.0), regressor=regressor)
    sizes = parameter_sizes(model(), np.zeros(2), prediction)
    assert sizes.tolist() == [pytest.approx(np.sqrt(90 / 20)), pytest.approx(3.0), 0.0]


def test_sizes_by_a_small_regressor() -> None:
    """Of length sqrt(10)/10, and a torque of length sqrt(10)."""
    prediction = SimpleNamespace(torque=np.ones((5, 2)), regressor=np.full((5, 2, 1), 0.1))
    assert parameter_sizes(model(), np.zeros(2), prediction).tolist() == pytest.approx([10.0])


def test_sizes_without_a_regressor() -> None:
    prediction = SimpleNamespace(torque=np.ones((5, 2)), regressor=None)
    one = model()
    assert parameter_sizes(one, np.array([-5.0, 1.0]), prediction).tolist() == [5.0, 3.0]
    zero = one.with_values(np.zeros(2))
    assert parameter_sizes(zero, np.zeros(2), prediction).tolist() == [1.0, 1.0]
