"""Which weight, hung where, and moved how: the prediction for two runs, the ranking, and what may mislead."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import Case, InputError, excite, load_case, simulate
from fmu_didim.base.diagnostics import PROBLEM
from fmu_didim.checks.data.expected_accuracy import ExpectedAccuracy
from fmu_didim.cli.main import main
from fmu_didim.discovery.excitation.optimum import Problem
from fmu_didim.discovery.excitation.runs import Runs
from fmu_didim.discovery.excitation.series import Series
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.workflow.excitation.planned import Plan, predict
from fmu_didim.workflow.excitation.weigh import _finalists
from fmu_didim.workflow.excitation.weighed import Offer, Tried, Weighing
from tests.loads import SCARA, planned

NOISE = (0.13, 0.025)
LIMITS = {
    "position": [[-1.0, 1.2], [-1.3, 1.0]], "velocity": [1.5, 2.5], "acceleration": [3.0, 5.0], "torque": [25.0, 3.0],
}  # fmt: skip
PLACE = (0.12, -0.03, 0.0)
QUICK: dict[str, Any] = {
    "limits": LIMITS, "torque_std": NOISE, "starts": 1, "period_s": 5.0, "periods": 1, "weigh": [2.0], "at": [PLACE],
}  # fmt: skip
HORIZONTAL: dict[str, Any] = {
    "limits": {"position": [[-0.3, 0.3]], "velocity": [2.0], "acceleration": [8.0], "torque": [20.0]},
    "torque_std": [0.1], "starts": 2, "period_s": 4.0,
}  # fmt: skip


def arm(folder: Path, load: dict[str, Any]) -> Case:
    """One joint with a horizontal axis, whose link is horizontal at zero; no log exists."""
    effects = {"effects": ["motor_inertia", "viscous", "coulomb"]}
    robot = {
        "schema": 1, "name": "arm", "gravity": [0, -9.81, 0],
        "joints": [{"type": "revolute", **effects,
                    "parameters": {"ZZ": 0.3, "MX": 0.5, "MY": 0.02, "Fv": 0.4, "Fc": 1.0, "v0": 0.02}}],
    }  # fmt: skip
    (folder / "arm.yaml").write_text(yaml.safe_dump(robot), encoding="utf-8")
    log = {"torque": {"file": "later.csv", "rate_hz": 100}, "positions": {"file": "later.csv"}}
    content = {
        "schema": 1, "name": "arm", "robot": "arm.yaml", "controller": {"kind": "tracking"}, "loop": {"rate_hz": 500},
        "identify": {"gain1": {"of": "drive", "joint": 1, "start": 2.0}},
        "experiments": {"empty": log, "loaded": {**log, "load": load}},
    }  # fmt: skip
    return load_case(content, folder=folder, require_torque=False, require_positions=False)


# ---- the prediction ----------------------------------------------------------------------------------


def pair(case: Case) -> tuple[Plan, Any, Series]:
    """A plan of both runs with gains and a load, its model, and a family of motions."""
    basis = Series(0.2, 1, 2)
    plan = Plan(case, "empty", 50.0, np.array(NOISE), np.zeros(0), ("loaded",))
    still = basis.excitation(np.zeros((basis.count, 2))).trajectory(1 / case.step_size)
    model = plan.model_on(still)
    values = model.start
    values[[model.names.index(f"load_{k}[loaded]") for k in ("M", "MX", "MY", "ZZ")]] = [2.0, 0.24, -0.06, 0.04]
    return plan.at(values, model), model, basis


def test_what_two_logs_change_with_is_the_slope_of_torque_over_gain() -> None:
    plan, model, basis = pair(planned())
    robot = plan.case.parameters
    assert isinstance(robot, RobotParameters)
    time = np.arange(40) / 8
    rng = np.random.default_rng(2)
    z = 0.2 * rng.normal(size=(basis.count, 2))

    def logs(values: Any) -> Any:
        of = Runs.of(model, values, plan.labels)
        one = Problem(robot.model, robot.base, of, plan.deviation, basis, time, (0,))
        gains = np.array([of.gain(0), of.gain(1)] * 2)
        return one, one.torque(z, time) / gains / np.tile(plan.deviation, 2)

    one, _ = logs(plan.values)
    for i in range(plan.values.size):
        step = np.zeros(plan.values.size)
        step[i] = 1e-4
        slope = (logs(plan.values + step)[1] - logs(plan.values - step)[1]) / 2e-4
        np.testing.assert_allclose(one.rows(z)[i].reshape(time.size, 4), slope, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("tracking", [False, True], ids=["controller known", "nobody knows it"])
def test_the_design_and_the_simulated_loop_predict_alike(tracking: bool) -> None:
    case = planned(tracking=tracking)
    found = excite(case, **QUICK)
    own = found.prediction.prospect
    assert own is not None and found.ok and found.weighing is not None
    plan, model, basis = pair(case)
    plan = plan.at(own.values, model)
    robot = case.parameters
    assert isinstance(robot, RobotParameters)
    motion = found.excitation
    times = plan.times(motion.trajectory(1 / case.step_size))
    runs = Runs.of(model, own.values, plan.labels)
    one = Problem(robot.model, robot.base, runs, plan.deviation, basis, times, (0,))
    q, dq, ddq = motion.motion(times)
    rows = one._rows.map(times.size)(q.T, dq.T, ddq.T).full().reshape(runs.count, -1, order="F")
    assert runs.prior is not None
    table = np.hstack([rows * np.sqrt(200 / 50 if tracking else 1), runs.prior.T])
    deviation = np.sqrt(np.diag(np.linalg.inv(table @ table.T)))
    gains = [i for i, name in enumerate(own.names) if name.startswith("gain")]
    np.testing.assert_allclose(own.deviation[gains], deviation[gains], rtol=0.15)
    # No gain is known better than the mass.
    assert (own.deviation[gains] / own.values[gains] > 0.01 / 2.0).all()


def test_torques_are_those_of_the_joint_whatever_the_unit_of_the_log() -> None:
    """Limits are in N.m: the log of a drive that gives 1.3 N.m for an ampere is not what is compared with them."""
    plan, model, basis = pair(planned())
    motion = basis.excitation(0.2 * np.random.default_rng(0).normal(size=(basis.count, 2)))
    reference = motion.trajectory(1 / plan.case.step_size)
    loop = predict(plan, reference, model.names).loop
    robot, count = plan.case.parameters, loop.time.size // 2
    for label, rows in (("empty", slice(0, count)), ("loaded", slice(count, None))):
        q, dq, ddq = (loop.select([f"{name}1", f"{name}2"])[rows] for name in ("q", "dq", "ddq"))
        torque = robot.regressor(q, dq, ddq)[0] @ model.theta(plan.values, label)
        np.testing.assert_allclose(loop.select(["tau1", "tau2"])[rows], torque, atol=1e-6 * np.abs(torque).max())


# ---- the ranking and what is said ---------------------------------------------------------------------


NAMES = ("gain1", "gain2", "Fc1", "load_M[loaded]", "load_MX[loaded]")


def tried(mass: float, deviations: tuple[float, ...] | None, *, problem: str = "", x: float = 0.1) -> Tried:
    """A row: relative deviations of two gains of 2, a friction of 1, and a load."""
    offer = Offer(mass, (x, 0.0, 0.0), {"mass": mass})
    prospect = None
    if deviations is not None:
        values = np.array([2.0, 2.0, 1.0, mass, mass * x])
        prospect = ExpectedAccuracy(NAMES, ("1",) * 5, values, np.array(deviations) * np.abs(values), (("", 0.0),) * 5)
    return Tried(offer, prospect, np.array([5.0, 9.0]), np.array([10.0, np.inf]), problem)


def weighing(*rows: Tried, mass_std: float | None = 0.01, only: tuple[str, ...] = NAMES) -> Weighing:
    one = Weighing("empty", "loaded", rows, 0, NAMES[:2], NAMES[2:3], NAMES[3:], only, "all", mass_std)
    return replace(one, best=one.order[0] if len(rows) == 1 else min(range(len(rows)), key=one.key))


GOOD, POOR, LOP = (0.02,) * 5, (0.05,) * 5, (0.01, 0.2, 0.01, 0.01, 0.01)


@pytest.mark.parametrize(
    ("rows", "best", "codes"),
    [
        ((tried(1, POOR), tried(2, GOOD)), 1, set()),
        ((tried(1, GOOD), tried(2, GOOD)), 0, set()),  # the lighter, which was offered first
        ((tried(1, POOR), tried(20, GOOD, problem="Too much torque.")), 0, {"weight-beyond-limits"}),
        ((tried(1, None, problem="Not told apart."), tried(2, POOR)), 1, {"weight-beyond-limits"}),
        ((tried(4, LOP), tried(2, POOR)), 0, {"drive-gain-unknown"}),  # 4.8 % in the mean, and one gain of 20 %
        ((tried(1, None), tried(2, None)), 0, set()),
        ((tried(0.25, (0.05,) * 5, x=0.0),), 0, {"weight-mass-uncertain"}),  # 4 % of 5 % are the mass
    ],
)
def test_the_smallest_mean_is_taken_of_those_that_can_be_run(
    rows: tuple[Tried, ...], best: int, codes: set[str]
) -> None:
    found = weighing(*rows)
    assert found.best == best and found.order[0] == best
    assert {d.code.name for d in found.diagnostics(with_shapes=False)} == codes
    assert len(found.lines()) > len(rows) and len(found.document()["tried"]) == len(rows)


def test_the_parameters_asked_for_rank_the_weights() -> None:
    rows = tried(1, LOP), tried(2, (0.03, 0.03, 0.5, 0.5, 0.5))
    assert weighing(*rows).best == 0 and weighing(*rows, only=NAMES[:2]).best == 1


@pytest.mark.parametrize(
    ("told", "options"),
    [
        ("weight-taken-exact", {"mass_std": None}),
        ("weight-without-shape", {"with_shapes": True}),
        ("weight-gain-assumed", {"assumed": ["gain2"]}),
    ],
)
def test_what_the_prediction_rests_on_is_told(told: str, options: dict[str, Any]) -> None:
    one = weighing(tried(2, GOOD), mass_std=options.pop("mass_std", 0.01))
    assert {d.code.name for d in one.diagnostics(**{"with_shapes": False, **options})} == {told}


def test_deviations_of_a_load_are_relative_to_its_size_not_to_a_coordinate_of_zero() -> None:
    offer = Offer(2.0, (0.3, 0.0, 0.0), {})
    sizes = {stem: offer.size_of(stem) for stem in ("M", "MX", "MY", "XX", "XY")}
    assert sizes == pytest.approx({"M": 2.0, "MX": 0.6, "MY": 0.6, "XX": 0.18, "XY": 0.18})


# ---- whole designs ------------------------------------------------------------------------------------


def test_a_weight_on_the_axis_tells_nothing_of_the_drive_and_another_place_is_taken(tmp_path: Path) -> None:
    case = arm(tmp_path, {"mass": 1.0, "centre": [0.3, 0, 0]})
    found = excite(case, **HORIZONTAL, weigh=[1.0], at=[(0, 0, 0), (0.3, 0, 0)])
    assert found.ok and found.weighing is not None and found.weighing.chosen.offer.place == (0.3, 0, 0)
    on_axis = found.weighing.tried[0]
    assert on_axis.problem and "gain1" in on_axis.problem
    assert found.weighing.chosen.offer.load == {"mass": 1.0, "centre": [0.3, 0.0, 0.0]}
    alone = excite(case, **HORIZONTAL, weigh=[1.0], at=[(0, 0, 0)])
    assert not alone.ok and alone.exit_code == 1 and alone.save(tmp_path / "out")[0].name == "excite.json"


def test_a_weight_beyond_the_torque_is_told_and_left_out(tmp_path: Path) -> None:
    case = arm(tmp_path, {"mass": 1.0, "centre": [0.3, 0, 0]})
    found = excite(case, **HORIZONTAL, weigh=[1.0, 2.0, 9.0])  # at 0.3 m of the case
    assert found.ok and found.weighing is not None and found.weighing.chosen.offer.mass == 2.0
    told = [d for d in found.diagnostics if d.code.name == "weight-beyond-limits"]
    assert len(told) == 1 and "9 kg" in told[0].text and "needs more torque than the limit" in told[0].text
    assert not any(d.code.severity is PROBLEM for d in found.diagnostics)
    torque = np.abs(found.prediction.loop.column("tau1")).max()
    assert 9.81 * (0.5 + 2 * 0.3) * 0.9 < torque <= 20.0 * 1.001  # that of the arm with the weight, in N.m
    shown = found.summary()
    assert "No place was given: it is the centre: of the case's load." in shown
    assert "Hang 2 kg at (0.3, 0, 0) m" in shown and "9 kg" in shown and max(map(len, shown.splitlines())) <= 100
    with pytest.raises(InputError, match="hardly moves needs more torque"):
        excite(case, **HORIZONTAL, weigh=[9.0, 12.0])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"weigh": [1.0, -1.0]}, "mass above zero"),
        ({"weigh": [float("nan")]}, "mass above zero"),
        ({"at": [(0.1, 0.0)]}, "takes three numbers"),
        ({"at": [(0.1, 0.0, float("inf"))]}, "takes three numbers"),
        ({"at": []}, "Where the weight hangs is not known"),
        ({"weigh": []}, "A place is for a weight"),
        ({"weigh": np.arange(1, 12), "at": [(0.1 * k, 0, 0) for k in range(3)]}, "too many weights and places"),
        ({"experiment": "empty"}, "No run carries a load"),
        ({"experiment": "elsewhere"}, "elsewhere"),
        ({"only": ["ZZ9"]}, "ZZ9"),
        ({"torque_std": None}, "noise of the torque log is not known"),
    ],
)
def test_what_cannot_be_weighed_is_refused_before_any_design(
    changes: dict[str, Any], text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Problem, "solved", None)
    with pytest.raises(InputError, match=text):
        excite(planned(), **{**QUICK, **changes})


def test_a_case_needs_a_run_with_a_load() -> None:
    with pytest.raises(InputError, match="No run carries a load"):
        excite(SCARA, **QUICK)


def test_a_single_run_of_a_case_with_loads_says_what_to_do() -> None:
    options = {key: value for key, value in QUICK.items() if key not in ("weigh", "at")}
    found = excite(planned(), **options)
    assert not found.ok and any("--weigh" in d.advice for d in found.diagnostics)


@pytest.mark.gate
def test_without_a_place_it_is_the_end_of_the_last_link_whose_shape_is_known() -> None:
    capsules = [{"link": 1, "from": [0, 0, 0], "to": [0.5, 0, 0], "radius": 0.05},
                {"link": 2, "from": [0.02, 0, 0], "to": [0.35, 0, 0], "radius": 0.04}]  # fmt: skip
    limits = {**LIMITS, "capsules": capsules, "boxes": [[[0.9, 1.2], [-1, 1], [-1, 1]]]}
    found = excite(planned(), **{**QUICK, "limits": limits, "at": []})
    assert found.weighing is not None and found.weighing.chosen.offer.place == (0.35, 0, 0)
    assert "it is the far end of the shape of the last link." in " ".join(found.summary().split())
    assert "weight-without-shape" in {d.code.name for d in found.diagnostics}
    assert found.saved()["space"]["nearest"][0]["time_s"] <= found.prediction.length_s  # of either run


def test_a_load_without_gains_is_weighed_too() -> None:
    """Nothing is known of the load, and nothing of its form is added: it is identified whole."""
    case = planned(gains=None, load={})
    found = excite(case, **QUICK)
    assert found.ok and found.weighing is not None and found.weighing.chosen.offer.load == {}
    assert found.weighing.gains == () and found.weighing.said == "friction and load"


def test_a_motion_is_planned_where_nobody_knows_the_controller_and_nothing_was_measured() -> None:
    case = planned(tracking=True)
    with pytest.raises(InputError, match="not there yet"):
        simulate(case)
    with pytest.raises(InputError, match="length of the motion is not known"):
        excite(case, **{**QUICK, "period_s": None})
    with pytest.raises(InputError, match="limits of the motion are not given"):
        excite(case, **{**QUICK, "limits": None})
    one = case.with_(identify=None, experiments={"loaded": None})
    options = {key: value for key, value in QUICK.items() if key not in ("weigh", "at")}
    found = excite(one, **options)
    assert found.ok and "excitation-controller-unknown" in {d.code.name for d in found.diagnostics}
    assert (found.prediction.lag(2) < 0.01).all()  # the virtual controller follows


def test_the_command_names_the_weight_and_writes_the_load(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = arm(tmp_path, {"mass": 1.0, "mass_std": 0.005, "centre": None})
    content = case.content
    content["identify"]["gain1"].pop("start")
    content["experiments"]["loaded"]["load"] = {"mass": 1.0, "centre": [0.3, 0, 0]}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    (tmp_path / "limits.yaml").write_text(yaml.safe_dump(HORIZONTAL["limits"]), encoding="utf-8")
    base = ["excite", str(tmp_path / "case.yaml"), "--limits", str(tmp_path / "limits.yaml"), "--out",
            str(tmp_path / "out"), "--torque-std", "0.1", "--period", "4", "--starts", "1"]  # fmt: skip
    assert main([*base, "--weigh", "2", "--at=-0.3,0,0", "--json"]) == 4  # the gain is taken for one, which is told
    printed = json.loads(capsys.readouterr().out)
    assert printed["weighing"]["hang"] == {"mass_kg": 2.0, "at_m": [-0.3, 0.0, 0.0]}
    assert "weight-gain-assumed" in {d["code"] for d in printed["diagnostics"]}
    written = yaml.safe_load((tmp_path / "out/reference.yaml").read_text(encoding="utf-8"))
    assert written["load"] == {"mass": 2.0, "centre": [-0.3, 0.0, 0.0]} and written["reference"]["kind"] == "fourier"
    for wrong, word in (("--at=0.1,0", "x,y,z in m"), ("--at=0.1,0,b", "x,y,z in m"), ("--weigh=-1", "above 0")):
        with pytest.raises(SystemExit) as stopped:
            main([*base, wrong])
        assert stopped.value.code == 2 and word in capsys.readouterr().err


def test_an_earlier_result_stands_for_the_run_without_the_weight(tmp_path: Path) -> None:
    """One run is designed then, with what that result knows of the robot."""
    case = planned(gains=None, load={})
    names = case.parameters.names
    joints = case.robot.joints if case.robot is not None else ()
    own = case.parameters.nominal()
    links = [{key: getattr(joint, key) for key in ("type", "alpha", "a", "theta", "d")} for joint in joints]
    result = {
        "parameters": {name: {"value": float(value)} for name, value in zip(names, own, strict=True)},
        "covariance": np.diag((0.01 * np.abs(own)) ** 2).tolist(), "verdict": "valid", "reasons": [],
        "geometry": {"links": links}, "provenance": {"files": {}},
    }  # fmt: skip
    (tmp_path / "result.json").write_text(json.dumps(result), encoding="utf-8")
    case = case.with_(prior={"result": str(tmp_path / "result.json")}, experiments={"empty": None})
    found = excite(case, **QUICK)
    assert found.ok and found.weighing is not None and found.weighing.empty is None
    assert "Without it: the earlier result; with it: loaded." in found.summary()
    own_percent = found.weighing.chosen.percent(("load_M[loaded]",))["load_M[loaded]"]
    assert 0 < own_percent < 30 and "load_M[loaded]" not in found.unseen


@pytest.mark.parametrize(
    ("rows", "places"),
    [
        ((tried(1, POOR), tried(2, GOOD), tried(3, (0.021,) * 5)), [1, 2]),
        ((tried(1, POOR), tried(2, GOOD), tried(3, (0.03,) * 5)), [1]),
        ((tried(1, (0.021,) * 5, problem="Too much."), tried(2, GOOD), tried(3, POOR)), [1]),
        ((tried(1, None, problem="No."), tried(2, None, problem="No.")), [0]),
    ],
)
def test_the_best_that_are_close_are_designed_from_all_starts(rows: tuple[Tried, ...], places: list[int]) -> None:
    assert _finalists(weighing(*rows)) == places
