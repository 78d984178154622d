"""Several starts, and a global search, on a wave of unknown frequency: f = 1 Hz beside minima that are wrong."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.abc import MetaPathFinder
from typing import Any

import numpy as np
import pytest

from fmu_didim import check, identify
from fmu_didim.base.errors import InputError, SimulationError
from fmu_didim.case import Case
from fmu_didim.checks.exploration.search import search_diagnostics
from fmu_didim.components.fmu.isolation.process import NotCarriedError
from fmu_didim.estimators import IdimLs
from fmu_didim.estimators.search import (
    Crew,
    Ended,
    InThisProcess,
    Search,
    crew_of,
    processes,
    profiled,
    searched,
)
from fmu_didim.estimators.search.best import GLOBAL
from fmu_didim.estimators.search.box import Box
from fmu_didim.estimators.search.crew import Stop, Task, go_on, local_fit
from fmu_didim.estimators.search.places import Place, distinct
from fmu_didim.estimators.search.processes import Processes
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.minima import misfit, squares_of
from fmu_didim.fit.iteration import Iteration
from fmu_didim.model import loop_model
from fmu_didim.model.free_parameter import FreeParameter, FreeParameters, delay_parameter
from tests.estimators.search.waves import wave_case

NEAR_HZ = 0.01
"""[Hz] Six standard deviations; the next minimum is 0.25 Hz away."""


def needed(method: str) -> None:
    """Skip the test where the package of this method is not installed."""
    if method == "cmaes":
        pytest.importorskip("cmaes")


def answer(case: Case, search: Search, crew: Crew | None = None) -> tuple[Estimate, list[Iteration]]:
    said: list[Iteration] = []
    crew = crew or InThisProcess(case.estimator, case.model)
    return searched(case.estimator, case.model, search, crew, progress=said.append), said


def test_one_start_ends_in_the_wrong_minimum_and_many_find_the_best() -> None:
    case = wave_case()
    assert abs(case.estimator.estimate(case.model).value[0] - 1) > 0.2
    found, said = answer(case, Search(starts=12, seed=1))
    assert found.value[0] == pytest.approx(1.0, abs=NEAR_HZ)
    search = found.search
    assert search is not None
    assert [search.method, search.seed, search.starts, search.asked] == ["starts", 1, 12, 12]
    assert search.searched == ("f",)
    assert sum(one.starts for one in search.minima) + sum(search.failures.values()) == 12
    assert search.minima[0].worse == 0
    # Half of a sine of another frequency is left, 50 times the variance of the noise at 51 samples.
    assert min(one.worse for one in search.minima[1:]) > 100
    assert not search.alike
    assert [it.stage for it in said].count("start") == 12
    assert "12 of 12 starts" in [it for it in said if it.stage == "start"][-1].note


def test_it_does_not_depend_on_how_many_run_side_by_side() -> None:
    case = wave_case()
    alone, _ = answer(case, Search(starts=6), InThisProcess(case.estimator, replace(case.model, workers=1)))
    together, _ = answer(case, Search(starts=6), InThisProcess(case.estimator, replace(case.model, workers=3)))
    assert alone.search == together.search
    assert (alone.value == together.value).all()


@pytest.mark.parametrize("method", GLOBAL)
def test_a_global_search_finds_it_too_and_keeps_to_its_cap(method: Any) -> None:
    needed(method)
    found, said = answer(wave_case(), Search(method=method, evaluations=150, seed=2))
    search = found.search
    assert found.value[0] == pytest.approx(1.0, abs=NEAR_HZ)
    assert search is not None
    assert search.starts == 2  # from the best of the search, and from the start of the case
    assert 15 < search.evaluations <= 150
    assert any(it.stage == "search" and "of at most 150 simulations" in it.note for it in said)


@pytest.mark.parametrize("method", GLOBAL)
def test_a_global_search_whose_time_is_over_refines_what_it_has(method: Any) -> None:
    needed(method)
    case = wave_case()
    crew = InThisProcess(case.estimator, replace(case.model, workers=1))
    found, said = answer(case, Search(method=method, seed=2, time_s=1e-9), crew)
    search = found.search
    assert search is not None
    assert search.starts == 1
    assert [it.stage for it in said].count("search") == 1
    assert "its time of 1e-09 s was over" in search.stopped
    if method == "differential_evolution":  # its first generation has a point in the best valley
        assert found.value[0] == pytest.approx(1.0, abs=NEAR_HZ)


def test_a_global_search_that_ends_by_itself_says_so_and_starts_again_first() -> None:
    """CMA-ES ends where two restarts, each of a doubled population, find nothing lower."""
    needed("cmaes")
    found, said = answer(wave_case(), Search(method="cmaes", seed=0))
    search = found.search
    assert search is not None
    assert search.stopped == ""
    assert search.evaluations < 2000
    spent = [int(it.note.split()[0]) for it in said if it.stage == "search"]
    assert sorted(set(np.diff([0, *spent]))) == [4, 8, 16]
    assert found.value[0] == pytest.approx(1.0, abs=NEAR_HZ)


def test_without_the_package_of_cma_es_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    class Absent(MetaPathFinder):
        def find_spec(self, fullname: str, path: object, target: object = None) -> None:
            if fullname == "cmaes":
                raise ModuleNotFoundError("No module named 'cmaes'", name="cmaes")

    for name in [name for name in sys.modules if name.partition(".")[0] == "cmaes"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Absent(), *sys.meta_path])
    with pytest.raises(InputError, match="needs the package cmaes") as caught:
        answer(wave_case(), Search(method="cmaes"))
    assert "fmu_didim[cmaes]" in str(caught.value)
    assert "differential_evolution" in str(caught.value)


def test_without_bounds_nothing_is_searched_and_that_is_said() -> None:
    case = wave_case(identify={"f": {"start": 0.98}}, search={"starts": 5})
    result = identify(case)
    assert result.values["f"] == pytest.approx(1.0, abs=NEAR_HZ)
    assert result.document.search is not None
    assert result.document.search.searched == []
    assert "nothing-searched" not in [reason.code for reason in result.document.reasons]  # no doubt of the answer
    assert any("no parameter has both a minimum and a maximum" in remark for remark in result.document.remarks)
    assert "Nothing was searched" in result.summary()


def test_a_case_is_searched_and_its_result_page_and_provenance_say_so(tmp_path: object) -> None:
    result = identify(wave_case(search={"starts": 8, "seed": 4}), tmp_path / "out")  # type: ignore[operator]
    assert result.document.provenance["search"]["seed"] == 4
    search = result.document.search
    assert search is not None
    assert search.minima[0].value["f"] == pytest.approx(1.0, abs=NEAR_HZ)
    text = result.summary()
    assert "8 starts between the bounds of f (seed 4)" in text
    assert "best" in text
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")  # type: ignore[operator]
    assert "Search for other minima" in page
    assert "8 starts between the bounds of f" in page


def test_ends_are_told_apart_by_their_values_not_by_their_misfit() -> None:
    """Two places of one misfit, as a parameter that does nothing has everywhere."""
    case = wave_case(identify={"idle": {"start": 1.0, "minimum": 0.5, "maximum": 2.0}, "f": {"start": 1.0}})
    model = case.model
    start, end = {"idle": 1.0, "f": 1.0}, {"idle": 2.0, "f": 1.0}
    squares, deviation = squares_of(model, np.array([1.0, 1.0])), {"idle": 0.01, "f": 0.001}
    ends = [Ended(v, deviation, squares, 14.0, True) for v in (start, end, start)]
    found = distinct([Place.of(model, one) for one in ends], model.names)
    assert [one.starts for one in found] == [2, 1]
    assert [one.misfit for one in found] == [found[0].misfit] * 2


def test_another_minimum_within_the_noise_is_a_doubt() -> None:
    found, _ = answer(wave_case(), Search(starts=6, seed=1))
    assert found.search is not None
    best, *others = found.search.minima
    close = replace(found.search, minima=(best, replace(others[0], worse=3.0)), alike=1)
    codes = [d.code.name for d in search_diagnostics(replace(found, search=close))]
    assert codes[0] == "minima-alike"
    assert [d.code.name for d in search_diagnostics(replace(found, search=None))] == []


class Scripted(Crew):
    """Ends that are given."""

    def __init__(self, ends: Sequence[Ended]) -> None:
        self.ends, self.begun = ends, 0

    def run(
        self, task: Task, items: Sequence[Any], *, repeats: int = 1, stop: Stop = go_on
    ) -> Iterator[tuple[int, Any]]:
        for k, end in enumerate(self.ends):
            self.begun += 1
            yield k, end
            if stop():
                return


def test_failures_are_counted_by_their_reason_and_do_not_end_the_search() -> None:
    case = wave_case()
    good = local_fit(case.estimator, case.model, np.array([1.01]))
    assert good.settled
    found, said = answer(
        case, Search(starts=4), Scripted([Ended(problem="It diverged."), good, Ended(problem="It diverged.")])
    )
    assert found.search is not None
    assert found.search.failures == {"It diverged.": 2}
    assert found.search.minima[0].starts == 1
    assert next(it.note for it in said if it.stage == "start") == "It diverged."


def test_where_every_start_fails_the_usual_one_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    case = wave_case()
    called = []

    def estimate(*_: object, **__: object) -> Estimate:
        called.append(1)
        raise SimulationError("It diverged.", next_step="Start elsewhere.")

    monkeypatch.setattr(type(case.estimator), "estimate", estimate)
    with pytest.raises(SimulationError, match="It diverged"):
        answer(case, Search(starts=3))
    assert len(called) == 4


def test_after_its_time_no_further_start_begins() -> None:
    case = wave_case()
    good = local_fit(case.estimator, case.model, np.array([1.01]))
    crew = Scripted([good] * 9)
    found, _ = answer(case, Search(starts=9, time_s=1e-9), crew)
    assert crew.begun == 1
    assert found.search is not None
    assert found.search.starts == 1
    assert found.search.asked == 9
    assert "its time of 1e-09 s was over" in found.search.stopped


def test_an_estimator_without_minima_of_the_misfit_is_refused() -> None:
    case = wave_case()
    with pytest.raises(InputError, match="idim_ls is no minimum"):
        searched(IdimLs(), case.model, Search(), InThisProcess(IdimLs(), case.model), progress=print)


def parameter(name: str, low: float = -np.inf, high: float = np.inf, owner: str = "base") -> FreeParameter:
    return FreeParameter(name, "1", owner, name, 1.0, 1.0, lowest=low, highest=high)


def test_starts_fill_the_box_by_their_logarithm_where_it_spans_decades() -> None:
    free = FreeParameters(
        [parameter("a", 1e-3, 1e3), parameter("b", -1.0, 3.0), parameter("c", 0.0), delay_parameter(1.0)]
    )
    box = Box.of(free, np.array([1.0, 0.5, 7.0, 1.0]))
    assert box.place.tolist() == [0, 1]  # one bound is none, and those of a delay are nobody's
    drawn = np.array(box.drawn(40, seed=5))
    assert (drawn[:, 2:] == [7.0, 1.0]).all()
    # One in each fortieth of the range: of six decades, and of four units.
    assert sorted(np.floor(40 * (np.log10(drawn[:, 0]) + 3) / 6)) == list(range(40))
    assert sorted(np.floor(40 * (drawn[:, 1] + 1) / 4)) == list(range(40))
    assert (np.array(box.drawn(40, seed=5)) == drawn).all()
    assert (np.array(box.drawn(40, seed=6)) != drawn)[:, :2].all()


def test_the_misfit_is_that_of_stated_or_of_found_noise() -> None:
    case = wave_case(samples=21)
    model, values = case.model, np.array([1.0])
    squares = squares_of(model, values)
    assert misfit(model, squares, values) == pytest.approx(21 * np.log(squares[0] / 21))
    stated = replace(model, torque_deviation=np.array([0.1]))
    assert misfit(stated, squares, values) == pytest.approx(squares[0] / 0.01)


@pytest.mark.gate
def test_child_processes_find_what_this_one_finds() -> None:
    case = wave_case()
    alone = Processes(case.estimator, replace(case.model, workers=1), 2, InThisProcess(case.estimator, case.model))
    starts = [np.array([f]) for f in (0.75, 1.02, 1.25)]
    try:
        there = dict(alone._side_by_side(local_fit, starts, stop=go_on))
    finally:
        alone.close()
    here = dict(InThisProcess(case.estimator, case.model).fits(starts))
    assert {k: dict(end.values) for k, end in there.items()} == {k: dict(end.values) for k, end in here.items()}


@pytest.mark.gate
def test_child_processes_follow_profiles_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "PAYS_S", 0.0)
    case = wave_case(identify={"f": {"start": 1.02}})
    found = case.estimator.estimate(case.model)
    made = [
        profiled(case.estimator, found, (), lambda of, n=n: crew_of(case.estimator, of, n), progress=lambda _: None)
        for n in (1, 2)
    ]
    assert isinstance(crew_of(case.estimator, case.model, 2), Processes)
    assert made[0].profiles[0].interval == made[1].profiles[0].interval


def test_what_cannot_be_sent_is_run_here(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(*_: object, **__: object) -> object:
        return NotCarriedError("This cannot be sent to another process.", next_step="")

    monkeypatch.setattr(processes, "PAYS_S", 0.0)
    monkeypatch.setattr(Processes, "_asked", absent)
    case = wave_case()
    found, _ = answer(case, Search(starts=4, seed=1), crew_of(case.estimator, case.model, 2))
    assert found.search is not None
    assert found.search.failures == {}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["starts", *GLOBAL])
def test_the_best_minimum_is_found_in_nearly_all_draws(method: Any) -> None:
    """95 of 100 draws of noise and of the search."""
    needed(method)
    found = []
    for seed in range(100):
        case = wave_case(seed)
        one, _ = answer(case, Search(method=method, starts=10, seed=seed))
        found.append(abs(one.value[0] - 1) < NEAR_HZ)
    assert sum(found) >= 95


@pytest.mark.parametrize(("long_run", "serves"), [(1, InThisProcess), (10**9, Processes)])
def test_threads_serve_compiled_loops_that_are_long(
    monkeypatch: pytest.MonkeyPatch, long_run: int, serves: type
) -> None:
    monkeypatch.setattr(loop_model, "LONG_RUN", long_run)
    monkeypatch.setenv("FMU_DIDIM_WORKERS", "2")
    case = wave_case()
    assert isinstance(crew_of(case.estimator, replace(case.model, workers=2)), serves)


def test_check_says_before_any_fit_that_nothing_can_be_searched() -> None:
    without = check(wave_case(identify={"f": {"start": 1.02}}, search={"starts": 5}))
    assert "nothing-searched" in {d.code.name for d in without.diagnostics}
    assert "nothing-searched" not in {d.code.name for d in check(wave_case(search={"starts": 5})).diagnostics}
