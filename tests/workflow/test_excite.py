"""The motion that tells most: it keeps its limits, tells more than random ones, and what may mislead is said."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import InputError, check, excite, load_case
from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.cli.main import main
from fmu_didim.discovery.excitation import optimum
from fmu_didim.discovery.excitation.basis import Basis
from fmu_didim.discovery.excitation.limits import Bounds, Limits
from fmu_didim.discovery.excitation.optimum import Problem
from fmu_didim.discovery.excitation.points import Points
from fmu_didim.discovery.excitation.series import Series
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.workflow.excitation.excited import Excited
from fmu_didim.workflow.excitation.findings import BEYOND_LIMITS, findings
from fmu_didim.workflow.excitation.planned import Peaks, Plan
from tests.helpers import ROOT

SCARA = ROOT / "examples/scara/identify.yaml"
NOISE = (0.17, 0.0065)
LIMITS = {
    "position": [[-1.0, 1.2], [-1.3, 1.0]], "velocity": [1.5, 2.5], "acceleration": [3.0, 5.0], "torque": [15.0, 1.2],
}  # fmt: skip
LATER = "measured_tomorrow.csv"
QUICK: dict[str, Any] = {"limits": LIMITS, "torque_std": NOISE, "starts": 1, "period_s": 5.0, "periods": 1}


@pytest.fixture(scope="module")
def made() -> Excited:
    case = load_case(SCARA, require_torque=False)
    return excite(case.with_(train={"torque": {"file": LATER, "rate_hz": 10}}, validation=None), **QUICK)


def test_log_that_is_not_there_yet_need_not_be(made: Excited) -> None:
    assert made.ok and "scara" in str(made.provenance["files"]) and LATER not in made.provenance["files"]


BASES = (Series(0.2, 2, 2), Points(0.2, 2, 2, moves=5), Points(0.2, 2, 2, moves=4, dwell_s=0.3))


def problem(basis: Basis) -> Problem:
    own = load_case(SCARA, require_torque=False).parameters
    assert isinstance(own, RobotParameters)
    instants = np.arange(50) / 10
    return Problem(own.model, own.base, own.nominal(), np.array(NOISE), basis, instants, range(own.count))


def bounds(start: list[float] | None = None) -> Bounds:
    low, high = np.array(LIMITS["position"]).T
    limits = Limits(low, high, np.array(LIMITS["velocity"]), np.array(LIMITS["acceleration"]))
    return Bounds(limits, np.array(LIMITS["torque"]), None if start is None else np.array(start))


def test_reference_begins_and_ends_at_rest_within_limits(made: Excited) -> None:
    n, peaks = 2, Peaks.of(made.reference, 2)
    for name in ("dq", "ddq"):
        table = made.reference.select([f"{name}{j + 1}" for j in range(n)])
        np.testing.assert_allclose(table[[0, -1]], 0.0, atol=1e-9)
    q = made.reference.select(["q1", "q2"])
    np.testing.assert_allclose(q[0], q[-1], atol=1e-9)
    low, high = np.array(LIMITS["position"]).T
    assert (peaks.low >= low).all() and (peaks.high <= high).all()
    assert (peaks.speed <= LIMITS["velocity"]).all() and (peaks.acceleration <= LIMITS["acceleration"]).all()
    loop = Peaks.of(made.prediction.loop, n)
    assert loop.excess(made.bounds) <= 1e-3 and made.ok  # the simulated loop keeps position, speed and torque


def test_prediction_is_that_of_check_on_a_log_of_the_motion(made: Excited, tmp_path: Path) -> None:
    """The reference that is written goes into a case, whose simulated log is what ``check`` predicts from."""
    made.save(tmp_path)
    written = yaml.safe_load((tmp_path / "reference.yaml").read_text(encoding="utf-8"))
    torque = made.prediction.loop.select(["tau1", "tau2"])[::20][:-1]
    log = "t,tau1,tau2\n" + "\n".join(f"{k / 10!r},{a!r},{b!r}" for k, (a, b) in enumerate(torque.tolist()))
    (tmp_path / "log.csv").write_text(log + "\n", encoding="utf-8")
    case = load_case(SCARA, require_torque=False).with_(
        train={**written, "torque": {"file": str(tmp_path / "log.csv")}}, validation=None, torque_std=list(NOISE),
        estimator={"kind": "didim", "start": "description"},
    )  # fmt: skip
    found, own = check(case).prospect, made.prediction.prospect
    assert found is not None and own is not None
    assert found.names == own.names
    np.testing.assert_allclose(found.deviation, own.deviation, rtol=0.02)


@pytest.mark.gate
@pytest.mark.parametrize("basis", [Series(0.2, 1, 2), Points(0.2, 1, 2, moves=5)], ids=["fourier", "moves"])
def test_optimum_tells_more_than_random_motions(basis: Basis) -> None:
    one, limits = problem(basis), bounds()
    drawn = [one.random(np.random.default_rng([7, i]), limits) for i in range(20)]
    assert all(one._broken(z, limits) <= 0 for z in drawn)
    best = max(map(one.criterion, drawn))
    found = one.solved(drawn[0], limits)
    # Eight parameters: a determinant larger by e^8 is a variance smaller by e on average.
    assert found.is_settled and found.criterion > best + 1.0
    assert one._broken(found.coefficients, limits) <= 1e-6


@pytest.mark.gate
def test_the_torque_keeps_its_limit_where_the_best_motion_without_one_would_not() -> None:
    basis, wide = Series(0.2, 1, 2), bounds()
    one, tight = problem(basis), replace(wide, torque=np.array([4.0, 0.5]))
    start = one.random(np.random.default_rng([7, 0]), tight)
    free, held = one.solved(start, wide), one.solved(start, tight)
    assert one._broken(free.coefficients, tight) > 0.1 and one._broken(held.coefficients, tight) <= 1e-6
    assert one.criterion(start) < held.criterion < free.criterion and held.is_settled


@pytest.mark.gate
@pytest.mark.parametrize("basis", [Series(0.2, 1, 2, harmonics=8), Points(0.2, 1, 2, moves=8)])
def test_a_variable_of_the_optimiser_is_as_large_as_the_limits_in_any_direction(basis: Basis) -> None:
    one, limits = problem(basis), bounds().limits
    for joint, unit in enumerate(one._units(bounds())):
        size = (limits.high - limits.low)[joint] / 2, limits.speed[joint], limits.acceleration[joint]
        moved = [table @ unit / own for table, own in zip(basis.tables(basis.grid()), size, strict=True)]
        mean_square = sum(part.T @ part for part in moved) / basis.grid().size
        np.testing.assert_allclose(mean_square, np.eye(basis.count), atol=1e-9)


@pytest.mark.gate
def test_loop_that_does_not_follow_is_told_and_no_reference_beyond_limits_is_written(tmp_path: Path) -> None:
    weak = yaml.safe_load((ROOT / "controllers/scara_pd.yaml").read_text(encoding="utf-8"))
    (tmp_path / "weak.yaml").write_text(yaml.safe_dump({**weak, "Kp": [40, 0.6], "Kd": [10, 0.15]}), encoding="utf-8")
    case = load_case(SCARA, require_torque=False)
    case = case.with_(controller={"kind": "model", "source": str(tmp_path / "weak.yaml")})
    found = excite(case, tmp_path / "out", **QUICK)
    codes = {d.code.name for d in found.diagnostics}
    assert "excitation-not-followed" in codes
    is_beyond = Peaks.of(found.prediction.loop, 2).excess(found.bounds) > 1e-3
    assert is_beyond == ("excitation-beyond-limits" in codes) == (found.exit_code == 1)
    assert (tmp_path / "out" / "reference.yaml").exists() == (not is_beyond)
    beyond = replace(found, bounds=found.bounds, diagnostics=(Diagnostic(BEYOND_LIMITS, "Too far."),))
    beyond.save(tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["excite.json"]


def test_parameters_that_are_not_excited_are_named_and_no_reference_is_written(made: Excited, tmp_path: Path) -> None:
    plan = Plan(load_case(SCARA, require_torque=False), "estimation", 10.0, np.array(NOISE), np.zeros(8))
    none = replace(made.prediction, prospect=None, unexcited=("MX1", "MY1"), condition=np.inf)
    told = findings(
        plan, Series(0.2, 1, 2, harmonics=5), made.bounds, none, None, made.asked, failed=1, starts=3, settled=False
    )  # fmt: skip
    texts = {d.code.name: d.text for d in told}
    assert texts["excitation-unexcited"] == "The motion does not excite MX1, MY1."
    assert texts["excitation-starts-failed"] == "From 1 of 3 starts the optimisation failed."
    assert "excitation-not-settled" in texts
    refused = replace(made, prediction=none, diagnostics=tuple(told))
    assert not refused.ok and refused.exit_code == 1 and "PROBLEM excitation-unexcited" in refused.summary()
    assert [path.name for path in refused.save(tmp_path)] == ["excite.json"]
    assert json.loads((tmp_path / "excite.json").read_text(encoding="utf-8"))["parameters"] is None


def test_start_from_which_ipopt_fails_is_skipped_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    solved, calls = Problem.solved, []

    def failing(self: Problem, start: Any, limits: Bounds, **options: Any) -> Any:
        calls.append(start)
        if len(calls) == 1:
            raise RuntimeError("Restoration_Failed")
        return solved(self, start, limits, **options)

    monkeypatch.setattr(Problem, "solved", failing)
    found = excite(SCARA, **{**QUICK, "starts": 2})
    assert found.trials[0].status == "skipped: Restoration_Failed" and found.trials[1].criterion is not None
    assert "excitation-starts-failed" in {d.code.name for d in found.diagnostics}
    calls.clear()
    with pytest.raises(InputError, match="failed from each start"):
        excite(SCARA, **QUICK)


def test_motions_of_other_lengths_are_compared_in_the_same_time(made: Excited) -> None:
    twice = made.prediction.criterion_in(2 * made.prediction.length_s, 8)
    assert twice == pytest.approx(made.prediction.criterion + 8 * np.log(2))  # twice the information on each of eight
    mean = replace(made.prediction, kind="mean").criterion_in(4 * made.prediction.length_s, 8)
    assert mean == pytest.approx(made.prediction.criterion + np.log(2))  # half of the deviation
    assert "The reference of the case lasts 10 s." in made.summary()


def test_criterion_of_some_parameters_is_the_inverse_of_their_covariance() -> None:
    basis = Series(0.2, 1, 2, harmonics=5)
    own = problem(basis)
    some = Problem(own.model, own.base, own.theta, np.array(NOISE), basis, np.arange(50) / 10, (3, 4))
    z = own.random(np.random.default_rng(1), bounds())
    table = own.rows(z)
    covariance = np.linalg.inv(table @ table.T)[np.ix_((3, 4), (3, 4))]
    assert some.criterion(z) == pytest.approx(-np.linalg.slogdet(covariance)[1], abs=1e-6)


@pytest.mark.gate
def test_mean_deviation_is_made_smaller_than_by_the_determinant() -> None:
    basis = Series(0.2, 1, 2, harmonics=4)
    own, limits = problem(basis), bounds()
    mean = Problem(own.model, own.base, own.theta, np.array(NOISE), basis, np.arange(50) / 10, range(8), "mean")
    start = own.random(np.random.default_rng(3), limits)
    table = own.rows(start)
    deviation = np.sqrt(np.diag(np.linalg.inv(table @ table.T)))
    assert mean.criterion(start) == pytest.approx(-np.log(np.mean(deviation / own.theta)), abs=1e-9)
    found = mean.solved(own.solved(start, limits).coefficients, limits)
    assert found.criterion > found.begun > mean.criterion(start)


@pytest.mark.parametrize("start", [None, np.array([0.3, -0.2])], ids=["anywhere", "start"])
@pytest.mark.parametrize("basis", BASES, ids=["fourier", "moves", "rests"])
def test_motion_of_coefficients_is_linear_in_them_and_keeps_its_limits(basis: Basis, start: Any) -> None:
    basis = replace(basis, start=start)
    limits = bounds().limits
    z = basis.drawn(np.random.default_rng(1), limits)
    made = basis.excitation(z)
    assert z.shape == (basis.count, 2) and made.length_s == pytest.approx(basis.duration_s)
    time = np.linspace(0, basis.duration_s, 701)
    for order, (own, table) in enumerate(zip(made.motion(time), basis.tables(time), strict=True)):
        np.testing.assert_allclose(own, table @ z + (basis.constant() if order == 0 else 0.0), atol=1e-12)
    assert limits.keeps(made.trajectory(200))
    small = basis.excitation(basis.smaller(z, 0.5)).motion(time)[1]
    np.testing.assert_allclose(small, 0.5 * made.motion(time)[1], atol=1e-12)
    # Some limit of each joint is reached, at an instant of the coarse grid of moves.
    q, dq, ddq = made.motion(basis.grid(400))
    used = [np.abs(dq).max(axis=0) / limits.speed, np.abs(ddq).max(axis=0) / limits.acceleration]
    used += [q.max(axis=0) / limits.high, q.min(axis=0) / limits.low]
    assert (np.max(used, axis=0) > 0.99).all() or start is None
    if isinstance(basis, Points):
        assert np.abs(made.motion(basis.grid())[2]).max() == pytest.approx(np.abs(ddq).max())


@pytest.mark.parametrize("criterion", ["mean", "determinant"])
def test_values_too_small_to_be_shown_are_left_out_of_the_mean_and_told(criterion: Any) -> None:
    """A relative deviation of 10^8 % would be all that the mean sees, and all that is designed for."""
    tiny = {"MY2": 1e-12}
    found = excite(SCARA, **QUICK, criterion=criterion, parameters=tiny)
    assert "MY2" in found.asked and set(found.asked) - set(found.in_mean) == {"MY2"}
    assert found.mean_percent < 100 and "without MY2: zero, or so small" in found.summary()
    assert found.saved()["in_mean"] == list(found.in_mean)
    if criterion == "mean":
        assert found.prediction.criterion == pytest.approx(-np.log(found.mean_percent / 100))
    with pytest.raises(InputError, match="have no relative deviation"):
        excite(SCARA, **QUICK, criterion="mean", parameters=tiny, only=["MY2"])


def test_postures_of_moves_are_shown_and_how_they_are_to_be_run(tmp_path: Path) -> None:
    found = excite(SCARA, tmp_path, **QUICK, kind="point_to_point", moves=4, dwell_s=0.2)
    assert found.ok and Peaks.of(found.prediction.loop, 2).excess(found.bounds) <= 1e-3
    source = yaml.safe_load((tmp_path / "reference.yaml").read_text(encoding="utf-8"))["reference"]
    assert source["kind"] == "point_to_point" and len(source["points"]) == 5
    assert source["move_s"] == pytest.approx(5 / 4 - 0.2)
    shown = found.summary()
    assert "4 moves from point to point of 1.05 s and 0.2 s of rest each, 5 s" in shown
    assert "play reference.csv back" in shown and "posture" in shown and found.exit_code == 0
    assert (
        "play reference.csv back"
        not in replace(found, excitation=Series(0.2, 1, 2).excitation(np.ones((9, 2)))).summary()
    )


def test_motion_begins_where_it_is_asked_to() -> None:
    basis = Series(0.2, 1, 2, np.array([0.3, -0.2]), harmonics=4)
    one, limits = problem(basis), bounds([0.3, -0.2])
    found = one.solved(one.random(np.random.default_rng(2), limits), limits)
    q = basis.excitation(found.coefficients).trajectory(200).select(["q1", "q2"])
    np.testing.assert_allclose(q[[0, -1]], [[0.3, -0.2]] * 2, atol=1e-9)
    with pytest.raises(InputError, match="begin outside the limits"):
        bounds([0.3, -2.0])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"torque_std": None}, "noise of the torque log is not known"),
        ({"torque_std": [0.1]}, "positive value for each joint"),
        ({"limits": {"velocity": [1.0]}}, "One entry is needed for each joint"),
        ({"limits": {"velocity": [1.0, -1.0]}}, "velocity"),
        ({"limits": {**LIMITS, "torque": [0.001, 1.2]}}, "Even a motion that hardly moves"),
        ({"limits": {**LIMITS, "start": [0.0, 2.0]}}, "begin outside the limits"),
        ({"limits": {**LIMITS, "position": [[1.0, -1.0], [-1.0, 1.0]]}}, "leave no room"),
        ({"only": ["ZZ9"]}, "ZZ9"),
        ({"harmonics": 1}, "needs two harmonics"),
        ({"rate_hz": 400.0}, "faster than the controller"),
        ({"kind": "chirp"}, "chirp"),
        ({"moves": 4}, "moves belongs to another kind of motion"),
        ({"dwell_s": 0.1}, "dwell_s belongs to another kind of motion"),
        ({"kind": "point_to_point", "harmonics": 4}, "harmonics belongs to another kind of motion"),
        ({"kind": "point_to_point", "moves": 1}, "needs two moves"),
        ({"kind": "point_to_point", "moves": 5, "dwell_s": 1.0}, "rests leave no time for the moves"),
        ({"kind": "point_to_point", "moves": 600}, "cannot show motions that fast"),
        ({"period_s": 0.05}, "cannot show motions that fast"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        excite(SCARA, **{**QUICK, **changes})


def test_case_without_robot_is_refused() -> None:
    with pytest.raises(InputError, match="equations of a robot"):
        excite(ROOT / "examples/house/identify.yaml", **QUICK)


@pytest.mark.gate
def test_command_writes_the_reference_and_says_what_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    limits = tmp_path / "limits.yaml"
    limits.write_text(yaml.safe_dump(LIMITS), encoding="utf-8")
    out = tmp_path / "out"
    # The highest harmonic, at 1 Hz, is above what 1.8 Hz show.
    arguments = ["--torque-std", "0.17,0.0065", "--limits", str(limits), "--period", "5", "--rate", "1.8"]
    arguments += ["--periods", "2", "--starts", "1", "--out", str(out)]
    assert main(["excite", str(SCARA), *arguments]) == 4
    printed = capsys.readouterr().out
    assert "DOUBT excitation-above-log" in printed and "highest harmonic is at 1 Hz" in printed
    found = json.loads((out / "excite.json").read_text(encoding="utf-8"))
    assert found["ready"] and found["limits"]["from"] == dict.fromkeys(found["limits"]["from"], "given")
    assert found["provenance"]["files"] and found["starts"][0]["status"] in optimum.AT_OPTIMUM
    case = load_case(SCARA, require_torque=False)
    source = yaml.safe_load((out / "reference.yaml").read_text(encoding="utf-8"))["reference"]
    np.testing.assert_allclose(
        case.with_(train={"reference": source}).reference("estimation").select(["q1", "q2"]),
        np.loadtxt(out / "reference.csv", delimiter=",", skiprows=1)[:, [1, 4]], atol=1e-9,
    )  # fmt: skip


@pytest.mark.gate
def test_a_torque_that_is_beyond_between_the_instants_costs_a_little_of_the_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where friction turns, a lower limit at the instants moves the peak on, round after round: no start is lost."""
    tight = replace(bounds(), torque=np.array([4.0, 0.5]))
    one = problem(Series(0.2, 1, 2))
    start = one.random(np.random.default_rng([7, 0]), tight)
    ended = one.solved(start, tight)
    monkeypatch.setattr(optimum, "TORQUE_ROUNDS", 2)
    monkeypatch.setattr(optimum, "TORQUE_WITHIN", 1.02)  # the limit at the instants is too high
    found = one.solved(start, tight)
    assert one._broken(found.coefficients, tight) <= 1e-6
    larger = np.exp((ended.criterion - found.criterion) / (2 * one.theta.size))  # deviations, in the geometric mean
    assert larger < 1.2  # 1.01 and 1.09 were seen: which optimum IPOPT comes to depends on the processor, too
