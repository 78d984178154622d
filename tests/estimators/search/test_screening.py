"""Which parameters matter: at the start, between their bounds, and what wakes those that do nothing."""

from __future__ import annotations

import json
import sys
from importlib.abc import MetaPathFinder
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import check, identify
from fmu_didim.base.errors import InputError, SimulationError
from fmu_didim.case import Case
from fmu_didim.cli.main import main
from fmu_didim.estimators.search import Crew, InThisProcess
from fmu_didim.estimators.search.crew import Stop, Task, go_on
from fmu_didim.estimators.search.screening import GlobalSensitivity, screened
from fmu_didim.fit.exploration.local import ridges_of
from tests.estimators.search.heaters import heater_case
from tests.estimators.search.rises import rise_case

STEPS = np.repeat([0.0, 1.0, 0.0, 2.0], 10)
"""[W] A heater that is switched."""
LEAKING = {
    "k": {"minimum": 0.5, "maximum": 8.0}, "tau": {"minimum": 1.0, "maximum": 20.0},
    "leak": {"minimum": 0.0, "maximum": 1e-5},
}  # fmt: skip


def made(case: Case, method: str, crew: Crew | None = None, **options: int) -> GlobalSensitivity:
    pytest.importorskip("SALib")
    crew = crew or InThisProcess(case.estimator, case.model)
    return screened(case.model, case.model.start, method, crew, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["morris", "sobol"])
def test_what_matters_comes_first_and_what_does_nothing_is_named(method: str) -> None:
    found = made(heater_case(STEPS, identify=LEAKING), method, samples=16)
    assert found.names == ("k", "tau", "leak")
    assert found.outputs == ("T",)
    assert found.units == ("K",)
    k, _, leak = found.total[:, 0]
    assert k == found.total.max()
    assert leak < 0.01 * k
    assert found.idle == ("leak",)
    assert found.simulations == 16 * (4 if method == "morris" else 5)


def test_shares_of_the_variance_are_those_of_a_known_function() -> None:
    """Of y = a^2, whose root is a, and b that does nothing: the first has all of the variance."""
    pytest.importorskip("SALib")

    class Known(Crew):
        def run(self, task: Task, items: list[np.ndarray], *, repeats: int = 1, stop: Stop = go_on):  # type: ignore[no-untyped-def, override]
            yield from ((k, np.array([values[0] ** 2])) for k, values in enumerate(items))

    found = made(heater_case(STEPS), "sobol", Known(), samples=64)
    assert found.main[:, 0] == pytest.approx([1.0, 0.0], abs=0.05)
    assert found.total[:, 0] == pytest.approx([1.0, 0.0], abs=0.05)


def test_it_is_the_same_again_with_the_same_seed() -> None:
    case = heater_case(STEPS)
    one, again, other = (made(case, "morris", samples=4, seed=seed) for seed in (1, 1, 2))
    assert (one.total == again.total).all()
    assert (one.total != other.total).any()


class Failing(Crew):
    """Every n-th simulation fails."""

    def __init__(self, crew: Crew, every: int) -> None:
        self.crew, self.every = crew, every

    def run(self, task: Task, items: list[np.ndarray], *, repeats: int = 1, stop: Stop = go_on):  # type: ignore[no-untyped-def, override]
        yield from ((k, None if k % self.every == 0 else found) for k, found in self.crew.run(task, items))


def test_what_fails_takes_its_trajectory_with_it_and_is_counted() -> None:
    case = heater_case(STEPS)
    whole = InThisProcess(case.estimator, case.model)
    found = made(case, "morris", Failing(whole, 12), samples=8)
    assert found.failed == 2
    assert np.isfinite(found.total).all()
    with pytest.raises(SimulationError, match="Hardly any values"):
        made(case, "morris", Failing(whole, 2), samples=8)


def test_without_bounds_it_asks_for_them() -> None:
    with pytest.raises(InputError, match="need bounds"):
        made(heater_case(STEPS, identify={"k": {}, "tau": {"minimum": 0.1}}), "morris")


def test_without_salib_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    class Absent(MetaPathFinder):
        def find_spec(self, fullname: str, path: object, target: object = None) -> None:
            if fullname == "SALib":
                raise ModuleNotFoundError("No module named 'SALib'", name="SALib")

    for name in [name for name in sys.modules if name.partition(".")[0] == "SALib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Absent(), *sys.meta_path])
    case = heater_case(STEPS)
    with pytest.raises(InputError, match="need SALib") as caught:
        screened(case.model, case.model.start, "morris", InThisProcess(case.estimator, case.model))
    assert "fmu_didim[sensitivity]" in str(caught.value)


def test_check_shows_effects_at_the_start_and_between_the_bounds(tmp_path: Path) -> None:
    pytest.importorskip("SALib")
    found = check(heater_case(STEPS, identify=LEAKING), sensitivity="morris", samples=8)
    text = found.summary()
    assert "moves T by (K)" in text
    assert "8 trajectories of Morris, 32 simulations" in text
    assert text.index("\nk ") < text.index("\nleak")
    assert "parameter-without-influence" in text
    assert found.saved()["sensitivity"]["outputs"] == {"T": "K"}
    found.plot().savefig(tmp_path / "effects.svg")
    assert "leak" in (tmp_path / "effects.svg").read_text(encoding="utf-8")
    with pytest.raises(InputError, match="no sensitivities to draw"):
        check(heater_case(STEPS)).plot()


def test_a_gain_of_a_heater_that_is_off_is_named() -> None:
    found = check(heater_case(np.zeros(40))).diagnostics
    assert any(d.code.name == "parameter-idle" and "k" in d.text for d in found)


def test_the_page_tells_what_each_parameter_does(tmp_path: Path) -> None:
    result = identify(heater_case(STEPS), tmp_path / "out")
    saved = result.document.sensitivity
    assert saved is not None
    # By one per cent of k the stationary part of T moves by one per cent; T is some volts.
    assert 0.001 < saved.change["k"][0] < 0.05
    assert "What each parameter does" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_parameters_that_make_up_for_each_other_are_a_ridge() -> None:
    result = identify(rise_case(0.6))
    assert result.document.sensitivity is not None
    (ridge,) = result.document.sensitivity.ridges
    assert set(ridge.parts) == {"K", "T"}
    assert "times that" in ridge.text
    assert ridge.std > 0.1


def test_a_ridge_is_one_of_several_parameters_that_is_less_known_than_each() -> None:
    names, size = ("a", "b"), np.array([1.0, 10.0])
    along = np.array([0.5, -5.0])
    open_ = np.outer(along, along) + np.diag([1e-4, 1e-2])
    (ridge,) = ridges_of(names, size, open_)
    assert ridge.std == pytest.approx(0.5, rel=0.01)
    assert ridge.text == "a may move by 50 %, b by -1 times that, relative to themselves, and the outputs hardly change"
    assert ridges_of(names, size, np.diag([0.25, 25.0])) == ()  # each alone is as little known
    assert ridges_of(names, size, 1e-4 * open_) == ()  # all are known well


def test_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("SALib")
    (tmp_path / "rise.py").write_text("from tests.estimators.search.rises import rise as model\n", encoding="utf-8")
    t = np.linspace(0, 2, 21)
    rows = "\n".join(f"{a:.6g},{b:.6g}" for a, b in zip(t, 2 * (1 - np.exp(-t)), strict=True))
    (tmp_path / "rise.csv").write_text(f"t,y\n{rows}\n", encoding="utf-8")
    case = tmp_path / "rise.yaml"
    case.write_text(
        "schema: 1\nname: rise\nmodel: {kind: control, source: 'rise.py:model'}\nmeasured: rise.csv\n"
        "identify: {K: {minimum: 1, maximum: 4}, T: {minimum: 0.3, maximum: 3}}\n", encoding="utf-8",
    )  # fmt: skip
    figure = tmp_path / "effects.png"
    options = ["--sensitivity", "sobol", "--samples", "8", "--figure", str(figure), "--json"]
    main(["check", str(case), *options])
    found = json.loads(capsys.readouterr().out)
    assert found["sensitivity"]["method"] == "sobol"
    assert figure.stat().st_size > 1000
    assert main(["check", str(case), "--figure", str(figure)]) == 1
    assert "--figure draws what --sensitivity finds" in capsys.readouterr().err
