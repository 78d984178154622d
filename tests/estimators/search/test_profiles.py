"""Profiles: the linear interval where the model is straight, the right one where it is bent, open where it is flat."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from fmu_didim import identify
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.checks.exploration.profiles import profile_diagnostics
from fmu_didim.estimators import IdimLs
from fmu_didim.estimators.search import InThisProcess, profiled
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration import profile as profile_module
from fmu_didim.fit.exploration.profile import Profile, followed, sides_of
from tests.estimators.search.rises import K, T, rise_case
from tests.estimators.search.waves import wave_case
from tests.helpers import ROOT

LONG, MIDDLE, SHORT = 4.0, 0.8, 0.45
"""[s] Records that show the end of the rise, half of it, and only its beginning."""


def with_profiles(case: object, *names: str, **changes: object) -> Estimate:
    estimator, model = case.estimator, replace(case.model, **changes)  # type: ignore[attr-defined]
    found = estimator.estimate(model)
    return profiled(estimator, found, names, lambda of: InThisProcess(estimator, of), progress=lambda _: None)


def test_a_straight_model_has_the_linear_interval() -> None:
    found = with_profiles(wave_case(identify={"f": {"start": 1.02}}))
    (one,) = found.profiles
    half = (one.linear[1] - one.linear[0]) / 2
    assert one.interval == pytest.approx(one.linear, abs=0.02 * half)
    assert one.how == ("reached", "reached")
    assert not one.is_bent
    assert profile_diagnostics(found) == []


def test_the_height_takes_the_colour_of_the_noise_as_the_intervals_do() -> None:
    """Noise with a memory of five samples: intervals are three times as wide as by white noise, so is the profile."""
    case = wave_case(samples=401, noise=0.0, identify={"f": {"start": 1.01}})
    rng, noise = np.random.default_rng(1), np.zeros(401)
    for k in range(1, 401):
        noise[k] = 0.8 * noise[k - 1] + 0.06 * rng.normal()
    one = case.model.experiments[case.model.first]
    model = case.model.with_experiment(case.model.first, replace(one, torque=one.torque + noise[:, None]))
    found = case.estimator.estimate(model)
    assert found.colours[0].inflation > 2
    found = profiled(case.estimator, found, (), lambda of: InThisProcess(case.estimator, of), progress=lambda _: None)
    (made,) = found.profiles
    half = (made.linear[1] - made.linear[0]) / 2
    assert made.interval == pytest.approx(made.linear, abs=0.05 * half)


def by_scipy(case: object) -> tuple[float, float]:
    """The interval of T by the profile of the closed solution, the noise stated."""
    model = case.model  # type: ignore[attr-defined]
    experiment = model.experiments[model.first]
    t, y, std = experiment.time, experiment.torque[:, 0], float(model.torque_deviation[0])

    def cost(tau: float) -> float:
        shape = 1 - np.exp(-t / tau)
        return float(np.sum((y - shape * (shape @ y) / (shape @ shape)) ** 2) / std**2)

    best = minimize_scalar(cost, bounds=(0.3, 3.0), method="bounded", options={"xatol": 1e-10})
    # 39 degrees of freedom with a stated noise: Student's t of them, as of all intervals here.
    height = 2.0227**2
    low = brentq(lambda tau: cost(tau) - best.fun - height, 0.2, best.x)
    return low, brentq(lambda tau: cost(tau) - best.fun - height, best.x, 40.0)


def test_a_bent_model_has_that_of_an_independent_profile() -> None:
    case = rise_case(MIDDLE, noise=0.05)
    found = with_profiles(case, "T")
    (one,) = found.profiles
    assert one.interval == pytest.approx(by_scipy(case), rel=2e-3)
    assert one.interval[1] - found.value[1] > 1.3 * (found.value[1] - one.interval[0])  # longer upwards
    assert one.is_bent
    assert [d.code.name for d in profile_diagnostics(found)] == ["interval-not-linear"]


def test_a_flat_direction_is_open_and_says_what_makes_up_for_it() -> None:
    found = with_profiles(rise_case(SHORT, noise=0.05), "K")
    (one,) = found.profiles
    assert one.how == ("reached", "open")
    assert one.interval[0] > 0.5
    assert np.isnan(one.interval[1])
    (told,) = profile_diagnostics(found)
    assert told.code.name == "profile-open"
    assert "T makes up for it" in told.text
    ratio = one.values[:, 0] / one.values[:, 1]
    assert np.ptp(ratio) < 0.5 * K / T  # K / T is what the data know, while K goes far


def test_a_limit_ends_a_side_and_the_interval() -> None:
    case = rise_case(MIDDLE, identify={"K": {}, "T": {"minimum": 0.5, "maximum": 1.2}})
    (one,) = with_profiles(case, "T").profiles
    assert one.how[1] == "limit"
    assert one.interval[1] == 1.2


def test_a_lower_minimum_on_the_way_is_a_doubt_with_its_values() -> None:
    case = wave_case(samples=101, identify={"f": {"start": 0.75}})
    found = with_profiles(case)
    (one,) = found.profiles
    # Far up its flank, at a standard deviation as large as the wrong residual, the wave comes into step.
    assert "lower" in one.how
    (told,) = profile_diagnostics(found)
    assert told.code.name == "lower-minimum"
    assert one.lowest[0] > found.value[0]


def test_where_nothing_can_be_fitted_the_side_ends_there(monkeypatch: pytest.MonkeyPatch) -> None:
    case = rise_case(LONG)
    found = case.estimator.estimate(case.model)
    assert found.minimum is not None
    side = sides_of(found.minimum, found.standard_deviation, found.freedom, [0])[1]
    monkeypatch.setattr(profile_module._Walk, "_fitted", lambda *_: False)
    half = followed(found.minimum.model, side)
    assert half.how == "failed"
    assert np.isnan(half.end)
    assert half.difference.size == 0


def test_what_cannot_be_profiled_is_refused() -> None:
    case = rise_case(LONG)
    with pytest.raises(UnknownNameError, match="'X'"):
        with_profiles(case, "X")
    with pytest.raises(UnknownNameError, match="'X'"):
        identify(case, profile=["X"])  # before any fit
    found = case.estimator.estimate(case.model)
    with pytest.raises(InputError, match="idim_ls is no minimum"):
        profiled(IdimLs(), found, (), lambda of: InThisProcess(case.estimator, of), progress=lambda _: None)


def test_the_command_that_repeats_it_asks_for_it() -> None:
    result = identify(ROOT / "examples/scara/identify.yaml", profile=["ZZ1R"])
    assert result.document.provenance["command"].split()[-1] == "--profile"


def test_result_terminal_and_page_show_it(tmp_path: Path) -> None:
    result = identify(rise_case(MIDDLE), tmp_path / "out", profile=["T"])
    saved = result.document.profiles["T"]
    assert saved.is_bent
    assert saved.interval[1] is not None
    assert len(saved.value) == len(saved.chi_square) == len(saved.others["K"])
    text = result.summary()
    assert "! by its profile" in text
    assert "Profiles" in text
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Profile of T" in page
    assert "What makes up for it" in page


def test_a_case_asks_for_it_and_python_may_not() -> None:
    case = rise_case(LONG, profile=True)
    assert set(identify(case).document.profiles) == {"K", "T"}
    assert identify(case, profile=False).document.profiles == {}


def bent(interval: tuple[float, float], how: tuple[str, str] = ("reached", "reached")) -> bool:
    return Profile(0, np.zeros((1, 1)), np.zeros(1), interval, how, (-3.0, 3.0), 4.0).is_bent  # type: ignore[arg-type]


def test_from_a_third_of_the_half_width_on_it_is_another_interval() -> None:
    assert not bent((-3.9, 3.9))
    assert bent((-4.1, 3.0))
    assert bent((-3.0, 1.9))
    assert bent((-3.0, np.nan), ("reached", "open"))
    assert not bent((-1.0, 3.0), ("limit", "reached"))  # a limit is where it is
    assert bent((-9.0, 3.0), ("limit", "reached"))


@pytest.mark.gate
def test_a_robot_is_profiled_too() -> None:
    result = identify(ROOT / "examples/scara/identify.yaml", profile=["ZZ1R", "Fv1"])
    of_inertia, of_friction = (result.document.profiles[name] for name in ("ZZ1R", "Fv1"))
    half = (of_inertia.linear[1] - of_inertia.linear[0]) / 2
    assert of_inertia.interval == pytest.approx(of_inertia.linear, abs=0.05 * half)
    assert of_friction.ends[0] == "limit"  # friction is not negative
    assert of_friction.interval[0] == 0
