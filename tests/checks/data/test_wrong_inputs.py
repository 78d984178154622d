"""Right data give nothing; each wrong input its code, among the first two."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.diagnostics import REMARK, Code, Diagnostic
from fmu_didim.checks import data
from fmu_didim.checks.data import linear_fit
from fmu_didim.checks.data.checks import data_diagnostics, drive_gains
from fmu_didim.checks.data.linear_fit import Ticks, fitted_motion
from fmu_didim.checks.data.log import on_ticks
from fmu_didim.checks.data.robot import length_unit_diagnostics
from fmu_didim.checks.data.timing import SAMPLING_KIND, _clock, _Near, _of_clock
from fmu_didim.checks.judgement import MATTERS
from fmu_didim.checks.sampling_kind import sampled_as
from fmu_didim.components import ModelComponent
from fmu_didim.cosim import SampleOperator
from fmu_didim.data.filters import LowPass
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters
from tests.checks.data.right import case_of, loaded, motion, right, with_columns, with_experiment, with_log
from tests.helpers import with_component
from tests.tools.verdict.run import answer

Array = np.ndarray
ROBOTS = ("scara", "arm", "tx40")
SEEDS = {"scara": (1, 2, 3), "arm": (1, 2, 3), "tx40": (1,)}
RUNS = [
    pytest.param(robot, seed, marks=[pytest.mark.slow] if seed > 1 or robot == "tx40" else [], id=f"{robot}-{seed}")
    for robot in ROBOTS
    for seed in SEEDS[robot]
]
"""One seed of the robots of two joints takes seconds, the others minutes."""
FRAMES_UNCLEAR = ("arm", 3)
"""Robot and seed on whose motion frames in the other convention are not told before the verdict."""


def degrees(model: LoopModel) -> LoopModel:
    return with_columns(model, lambda name, column: np.degrees(column))


def velocity(change: Callable[[Array], Array]) -> Callable[[LoopModel], LoopModel]:
    return lambda model: with_columns(model, lambda name, c: change(c) if name == "dq1" else c)


def foreign(model: LoopModel) -> LoopModel:
    """The log of one motion with the reference of another."""
    robot = {2: "arm" if "MX1" in model.names else "scara", 6: "tx40"}[model.joint_count]
    other = motion(robot, seed=99)
    return with_experiment(model, reference=other)


def turned(*joints: int) -> Callable[[LoopModel], LoopModel]:
    def change(torque: Array) -> Array:
        torque[:, [j - 1 for j in joints]] *= -1
        return torque

    return lambda model: with_log(model, change)


def swapped(torque: Array) -> Array:
    return torque[:, [1, 0, *range(2, torque.shape[1])]]


def spikes(torque: Array) -> Array:
    rng = np.random.default_rng(5)
    at = rng.choice(torque.shape[0] - 10, size=torque.shape[0] // 100, replace=False) + 5
    torque[at, 0] += 4 * np.ptp(torque[:, 0]) * rng.choice([-1, 1], size=at.size)
    return torque


def far_off(torque: Array) -> Array:
    """One sample, by more than all others together."""
    torque[torque.shape[0] // 3, 0] += 40 * np.ptp(torque[:, 0])
    return torque


def stuck(torque: Array) -> Array:
    """The logger repeats its last row."""
    torque[int(0.7 * torque.shape[0]) :] = torque[int(0.7 * torque.shape[0])]
    return torque


def constant(torque: Array) -> Array:
    torque[:, 1] = 0.3
    return torque


def clipped(torque: Array) -> Array:
    limit = 0.6 * np.abs(torque[:, 0]).max()
    torque[:, 0] = torque[:, 0].clip(-limit, limit)
    return torque


def dead(torque: Array) -> Array:
    torque[:, 0] = 0.0
    return torque


def copied(torque: Array) -> Array:
    torque[:, 1] = torque[:, 0]
    return torque


def in_millis(torque: Array) -> Array:
    torque[:, 1] *= 1000
    return torque


def coarse(torque: Array) -> Array:
    step = np.ptp(torque, axis=0) / 12
    return np.rint(torque / step) * step


def behind_a_filter(torque: Array) -> Array:
    return LowPass(0.3).apply(torque, 1.0)  # of the rate, half of which is the most


def held(torque: Array) -> Array:
    return np.repeat(torque[::5], 5, axis=0)[: torque.shape[0]]


def interpolated(torque: Array) -> Array:
    n = torque.shape[0]
    known = np.arange(0, n + 4, 4)
    columns = [np.interp(np.arange(n), known, np.resize(c[::4], known.size)) for c in torque.T]
    return np.column_stack(columns)


def jittered(model: LoopModel) -> LoopModel:
    stamps = model.experiments["estimation"].time
    step = stamps[1] - stamps[0]
    return with_experiment(model, stamps=stamps + step * np.random.default_rng(3).uniform(-0.3, 0.3, stamps.size))


def slowing(model: LoopModel) -> LoopModel:
    """The loop runs at its rate at first and 15 % slower at the end, and stamps each of its rows."""
    step = model.simulation(model.start, "estimation").step_size
    periods = step * (1 + 0.15 * np.linspace(0, 1, 3000) ** 2)
    return with_experiment(model, stamps=np.concatenate([[0.0], np.cumsum(periods)]))


def slowing_logger(model: LoopModel) -> LoopModel:
    """The logger writes every fourth control period, and slows down."""
    step = 4 * model.simulation(model.start, "estimation").step_size
    periods = step * (1 + 0.15 * np.linspace(0, 1, 3000) ** 2)
    return with_experiment(model, stamps=np.concatenate([[0.0], np.cumsum(periods)]))


def too_fast(model: LoopModel) -> LoopModel:
    return with_experiment(model, stamps=model.experiments["estimation"].time[::4])


def validated_by_itself(model: LoopModel) -> LoopModel:
    own = model.experiments["estimation"]
    return with_experiment(
        model, "validation", reference=own.reference, time=own.time, torque=own.torque, operator=own.operator
    )


def validated_by_its_repetition(model: LoopModel) -> LoopModel:
    """The log of the estimation with 0.1 % of noise."""
    rng = np.random.default_rng(8)
    return with_log(
        validated_by_itself(model), lambda torque: torque * (1 + 1e-3 * rng.normal(size=torque.shape)), "validation"
    )


WRONG: list[tuple[str, Callable[[LoopModel], LoopModel], str]] = [
    ("velocity zero", velocity(np.zeros_like), "reference-derivative"),
    ("velocity in degrees", velocity(np.degrees), "reference-derivative"),
    ("velocity turned round", velocity(np.negative), "reference-derivative"),
    ("reference in degrees", degrees, "reference-unit"),
    ("reference of another run", foreign, "reference-foreign"),
    ("torque of joint 1 turned round", turned(1), "torque-sign"),
    ("all torques turned round", turned(1, 2), "torque-sign"),
    ("joints swapped", lambda m: with_log(m, swapped), "joint-order"),
    ("torque in mN.m", lambda m: with_log(m, lambda torque: 1000 * torque), "torque-unit"),
    ("torque in kN.m", lambda m: with_log(m, lambda torque: torque / 1000), "torque-unit"),
    ("spikes", lambda m: with_log(m, spikes), "log-outliers"),
    ("one sample far off", lambda m: with_log(m, far_off), "log-outliers"),
    ("a tail that stands still", lambda m: with_log(m, stuck), "log-constant"),
    ("all columns constant", lambda m: with_log(m, lambda torque: np.full_like(torque, 0.3)), "log-constant"),
    ("column constant", lambda m: with_log(m, constant), "log-constant"),
    ("a dead channel, zero throughout", lambda m: with_log(m, dead), "log-constant"),
    ("one column twice", lambda m: with_log(m, copied), "log-copied"),
    ("joint 2 in mN.m", lambda m: with_log(m, in_millis), "torque-unit"),
    ("clipped at 60 %", lambda m: with_log(m, clipped), "log-saturated"),
    ("12 steps in the range", lambda m: with_log(m, coarse), "log-coarse"),
    ("each sample held five times", lambda m: with_log(m, held), "log-upsampled"),
    ("every fourth sample interpolated", lambda m: with_log(m, interpolated), "log-upsampled"),
    ("a log behind a filter, stated as instants", lambda m: with_log(m, behind_a_filter), "log-filtered"),
    ("jittered stamps", jittered, "stamps-jitter"),
    ("a loop that slows down", slowing, "period-changes"),
    ("a logger that slows down", slowing_logger, "log-rate-changes"),
    ("rate_hz above the log's", too_fast, "rate-above-log"),
    ("validation is the estimation", validated_by_itself, "validation-copied"),
    ("validation is the estimation but for noise", validated_by_its_repetition, "validation-repeats-motion"),
]


@pytest.mark.parametrize(
    ("period", "steps", "rounded", "least", "most"),
    [
        (0.002, [5, 5, 6], 6, 1.0, 1.0),  # a logger of every fifth tick or sixth
        (0.002, [5, 5.5, 5, 6, 5, 5, 6, 5, 5, 6, 5, 5], 6, 0.9, 0.95),  # here and there rounded
        (0.002, None, 3, 0.4, 0.6),  # late by chance, rounded to 1 ms
        (0.002, None, 9, 0.0, 0.05),
        (0.001, [10, 11, 12], 6, 0.0, 0.0),  # as stamps in whole ms are anyhow
        (0.0008, [10, 11, 12], 6, 1.0, 1.0),
    ],
)
def test_uneven_stamps_are_ticks_where_they_are_whole_control_periods_apart(
    period: float, steps: list[float] | None, rounded: int, least: float, most: float
) -> None:
    rng = np.random.default_rng(1)
    waits = 5.3 + rng.uniform(-0.5, 0.5, 600) if steps is None else np.resize(steps, 600)
    assert least <= on_ticks(np.round(7.3 + period * np.cumsum(waits), rounded), period) <= most


def late(seconds: float) -> Callable[[LoopModel], LoopModel]:
    """The stamps of the log are late by so much."""

    def change(model: LoopModel) -> LoopModel:
        own, step = model.experiments[model.first], model.loop.systems[model.first].step_size
        count = own.reference.time.size
        return with_experiment(model, model.first, operator=own.operator.stamped_later(seconds / step, count))

    return change


def averaged(window: str) -> Callable[[LoopModel], LoopModel]:
    """The logger averages over its sample period."""
    return lambda model: with_experiment(
        model,
        model.first,
        operator=sampled_as(model.simulation(model.start), "average", window),  # type: ignore[arg-type]
    )


def delayed(samples: float) -> Callable[[LoopModel], LoopModel]:
    """The command acts later than the model says."""
    return lambda model: model.with_delay(samples)


def described(model: LoopModel) -> dict[str, Any]:
    assert isinstance(model.parameters, RobotParameters)
    return model.parameters.model.description.model_dump(mode="json", exclude_defaults=True)


def with_description(robot: str, model: LoopModel, **entries: Any) -> LoopModel:
    """The loop of a description with other entries, with the logs of the right one."""
    other = case_of(robot).with_(robot={**described(model), **entries, "identified": "computed"}).model
    for label in model.experiments:
        other = other.with_experiment(label, model.experiments[label])
    return other


def without_gravity(robot: str, model: LoopModel) -> LoopModel:
    return with_description(robot, model, gravity=[0, 0, 0])


def classical_table(robot: str, model: LoopModel) -> LoopModel:
    """The table of frames as a textbook in the classical convention has it: alpha and a one row higher."""
    joints = described(model)["joints"]
    rows = [{key: joint.get(key, 0.0) for key in ("alpha", "a")} for joint in joints[1:]]
    rows.append({"alpha": 0.0, "a": 0.0})
    return with_description(robot, model, joints=[joint | row for joint, row in zip(joints, rows, strict=True)])


def longer(model: LoopModel) -> LoopModel:
    """The longest link of the real robot is a quarter longer than the description says."""
    parameters = model.parameters
    assert isinstance(parameters, RobotParameters)
    robot = parameters.model.description
    longest = max(joint.a for joint in robot.joints)
    joints = tuple(
        joint.model_copy(update={"a": (1.25 if joint.a == longest else 1) * joint.a}) for joint in robot.joints
    )
    return with_component(
        model, "plant", ModelComponent(RobotModel(robot.model_copy(update={"joints": joints})).block())
    )


TIMING: list[tuple[str, Callable[[LoopModel], LoopModel], str]] = [
    ("clock 5 ms late", late(0.005), "clock-late"),
    ("clock 30 ms late", late(0.030), "clock-late"),
    ("clock 30 ms early", late(-0.030), "clock-early"),
    ("averages before the stamp", averaged("preceding"), "sampling-kind"),
    ("one sample of delay", delayed(1), "command-delay"),
]


ELSEWHERE = {
    "few-outliers", "log-quantised", "samples-missing",  # test_decisions.py
    "plant-holds",  # test_plant.py
    "resonance-above-log", "parameters-not-significant",  # test_expected_accuracy.py, tests/workflow/test_check.py
    "validation-without-torque",  # tests/case/test_file_checks.py
    "positions-unit",  # tests/workflow/test_objects.py
    "outliers-left-out",  # tests/workflow/test_outliers.py
    "log-wrapped",  # test_wrapped.py
    "stamps-on-ticks",  # above
    "log-unsigned", "signs-given",  # tests/estimators/starts/test_signs.py
    "clock-slightly-off", "timing-slightly-off",  # below
    "drive-gain", "frames-brought", "frames-convention", "gravity", "length-unit", "link-length",  # below
    "reference-unit-doubtful", "torque-scale",  # below
}  # fmt: skip
"""Codes that are provoked in other tests."""


def test_each_code_of_the_data_is_provoked() -> None:
    modules = [importlib.import_module(f"{data.__name__}.{m.name}") for m in pkgutil.iter_modules(data.__path__)]
    every = {code.name for module in modules for code in vars(module).values() if isinstance(code, Code)}
    assert len(every) > 20
    assert every - ELSEWHERE == {code for *_, code in WRONG + TIMING}, "a new code needs a row in WRONG"


def codes(model: LoopModel) -> list[str]:
    return [d.code.name for d in data_diagnostics(model)]


@pytest.mark.parametrize(
    ("robot", "seed"),
    [
        pytest.param(
            r,
            s,
            id=f"{r}-{s}",
            marks=[pytest.mark.slow] if s > (1 if r == "tx40" else 3) else [pytest.mark.gate] if r == "tx40" else [],
        )
        for r in ROBOTS
        for s in range(1, 3 if r == "tx40" else 9)
    ],
)
def test_right_data_give_nothing(robot: str, seed: int) -> None:
    assert codes(right(robot, seed)) == []


@pytest.mark.gate
@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 200.0])
def test_right_data_at_other_rates_give_nothing(rate_hz: float) -> None:
    for robot in ("scara", "arm"):
        assert codes(right(robot, 1, rate_hz=rate_hz)) == []


@pytest.mark.gate
@pytest.mark.parametrize(
    ("seed", "rate_hz", "noise"),
    [
        (1, 20.0, 0.002),
        pytest.param(4, 20.0, 0.01, marks=pytest.mark.slow),
        *(pytest.param(s, r, 0.002, marks=pytest.mark.slow) for s in (2, 4) for r in (20.0, 100.0)),
    ],
)
def test_a_motion_that_needs_many_steps_gives_nothing(seed: int, rate_hz: float, noise: float) -> None:
    """Here a clock that is off by less than a tick, or another scale, would take the credit for steps it lacks."""
    assert codes(right("tx40_5khz", seed, rate_hz=rate_hz, noise=noise)) == []


@pytest.mark.slow
def test_a_clock_gains_nothing_by_steps_that_the_motion_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linear_fit, "DIDIM_STEPS", 5)
    fitted = fitted_motion(right("tx40_5khz", 4, rate_hz=20.0, noise=0.01).on("estimation"))
    assert fitted is not None
    (found,) = _clock(fitted)
    assert found.misfit < 1 and found.gain < 0


@pytest.mark.gate
@pytest.mark.parametrize(("robot", "seed"), RUNS)
@pytest.mark.parametrize(("change", "code"), [row[1:] for row in WRONG], ids=[row[0] for row in WRONG])
def test_wrong_input_is_told(robot: str, seed: int, change: Callable[[LoopModel], LoopModel], code: str) -> None:
    found = data_diagnostics(change(right(robot, seed)))
    assert code in [d.code.name for d in found[:2]], [f"{d.code.name}: {d}" for d in found]
    assert found[0].code.name == code or code not in ("log-constant", "log-outliers"), (
        "no other thing is suspected first"
    )
    assert all(d.advice for d in found if d.code.severity is not REMARK)


@pytest.mark.gate
@pytest.mark.parametrize(("robot", "seed"), RUNS)
@pytest.mark.parametrize(("change", "code"), [row[1:] for row in TIMING], ids=[row[0] for row in TIMING])
def test_wrong_timing_is_told(robot: str, seed: int, change: Callable[[LoopModel], LoopModel], code: str) -> None:
    if robot == "tx40" and code == "command-delay":
        pytest.skip("its gains do not allow a sample of delay: the loop diverges")
    found = data_diagnostics(right(robot, seed, change=change))
    assert code in [d.code.name for d in found[:2]], [f"{d.code.name}: {d}" for d in found]
    assert {d.code.name for d in found} <= {"clock-late", "clock-early", "sampling-kind", "command-delay"}


@pytest.mark.gate
@pytest.mark.parametrize("seed", SEEDS["scara"])
def test_longer_links_without_gravity_are_nothing_wrong(seed: int) -> None:
    """MX2 and MY2 absorb the length."""
    assert data_diagnostics(right("scara", seed, change=longer)) == []


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["arm", pytest.param("tx40", marks=pytest.mark.slow)])
def test_longer_links_are_reported_with_their_length(robot: str) -> None:
    """In each of three motions with their noise; the length is right in the middle one."""
    factors = []
    for seed in (1, 2, 3):
        found = data_diagnostics(right(robot, seed, change=longer))
        assert "link-length" in [d.code.name for d in found[:2]], [f"{d.code.name}: {d}" for d in found]
        told = next(d for d in found if d.code.name == "link-length")
        assert told.value is not None and told.bound is not None
        factors.append(told.value / told.bound)
    assert np.median(factors) == pytest.approx(1.25, abs=0.05)


@pytest.mark.gate
@pytest.mark.parametrize(("robot", "seed"), [run for run in RUNS if run.values[0] != "scara"])
def test_gravity_that_the_description_lacks_is_told(robot: str, seed: int) -> None:
    model = right(robot, seed)
    assert isinstance(model.parameters, RobotParameters)
    true = model.parameters.model.description.gravity
    found = data_diagnostics(without_gravity(robot, model))
    assert found[0].code.name == "gravity", [f"{d.code.name}: {d}" for d in found]
    assert f"seems to be ({', '.join(f'{value:.3g}' for value in true)}) m/s2" in found[0].text


@pytest.mark.gate
@pytest.mark.parametrize(("robot", "seed"), [run for run in RUNS if run.values != FRAMES_UNCLEAR])
def test_a_table_in_the_classical_convention_that_is_read_as_modified_is_told(robot: str, seed: int) -> None:
    found = data_diagnostics(classical_table(robot, right(robot, seed)))
    assert "frames-convention" in [d.code.name for d in found[:2]], [f"{d.code.name}: {d}" for d in found]


@pytest.mark.slow
def test_frames_of_which_the_data_say_too_little_are_not_called_valid() -> None:
    """Along the motion that the wrong frames give, the right ones leave 58 % of the mean square, and 50 % is asked."""
    model = classical_table("arm", right(*FRAMES_UNCLEAR))
    assert data_diagnostics(model) == []
    assert answer(model, {}).verdict == "doubtful"


def test_names_in_other_frames_than_the_description_are_told() -> None:
    model = right("arm", 1)
    joints = described(model)["joints"]
    classical = [{key: value for key, value in joint.items() if key != "parameters"} for joint in joints]
    classical = [one | {"a": other.get("a", 0.0)} for one, other in zip(classical, [*joints[1:], {}], strict=True)]
    found = data_diagnostics(with_description("arm", model, joints=classical, frames="standard"))
    assert [d.code.name for d in found] == ["frames-brought"]  # and nothing else: it is the same robot


@pytest.mark.gate
@pytest.mark.parametrize(("robot", "seed"), [run for run in RUNS if run.values[0] != "scara"])
@pytest.mark.parametrize("factor", [2.0, 0.5, 1.3])
def test_a_torque_that_is_scaled_against_the_others_is_told(robot: str, seed: int, factor: float) -> None:
    def scaled(torque: Array) -> Array:
        torque[:, 1] *= factor
        return torque

    found = data_diagnostics(with_log(right(robot, seed), scaled))
    assert "torque-scale" in [d.code.name for d in found[:2]], [f"{d.code.name}: {d}" for d in found]
    told = next(d for d in found if d.code.name == "torque-scale")
    assert told.value is not None
    expected = factor if told.place.endswith("joint 2") else 1 / factor  # of two joints either may be the wrong one
    assert told.value == pytest.approx(expected, rel=0.1)


@pytest.mark.gate
@pytest.mark.parametrize("late_s", [0.012, -0.03])
def test_interval_of_the_clock_holds_the_truth(late_s: float) -> None:
    for robot in ("scara", "arm"):
        found = data_diagnostics(right(robot, 1, change=late(late_s)))
        clock = next(d for d in found if d.code.name.startswith("clock"))
        assert clock.value is not None and clock.bound is not None
        assert abs(clock.value - 1000 * late_s) < abs(clock.bound) < abs(1000 * late_s)


@pytest.mark.parametrize(
    ("robot", "late_s", "told"), [("scara", 2e-5, "clock-slightly-off"), ("arm", 2e-3, "clock-late")]
)
def test_a_clock_that_moves_no_value_is_no_doubt(robot: str, late_s: float, told: str) -> None:
    """What it moves the values by, in their deviations, is that of two fits by least squares."""
    model = right(robot, 1)
    fitted = fitted_motion(model.on("estimation"))
    assert fitted is not None
    own = fitted.experiment
    shifted = own.operator.stamped_later(late_s / fitted.run.step_size, own.reference.time.size, between=True)
    aligned = replace(fitted, run=fitted.run.on(replace(own, operator=shifted)))
    found = _of_clock(fitted, aligned, late_s, 1e-6, 4e-6).diagnostic
    assert found.code.name == told
    scale = np.repeat(1 / aligned.size[None], own.time.size, axis=0).ravel()

    def fit(operator: SampleOperator) -> tuple[Array, Array]:
        columns, known = (operator.apply(values) for values in fitted.rows(operator.ticks))
        flat = columns.reshape(scale.size, -1) * scale[:, None]
        values = np.linalg.lstsq(flat, (own.torque - known).ravel() * scale, rcond=None)[0]
        return values, np.sqrt(np.diag(np.linalg.inv(flat.T @ flat)) * scale.size / aligned.samples)

    (values, deviation), (others, _) = fit(shifted), fit(own.operator)
    moved = np.abs(others - values) / deviation
    np.testing.assert_allclose(aligned.moved_by(own.operator), moved, rtol=1e-3)
    assert (moved.max() > MATTERS) == (told == "clock-late")
    if told == "clock-slightly-off":
        assert found.value == pytest.approx(moved.max(), rel=1e-3)


def test_the_misfit_of_a_scale_is_that_of_rows_that_are_scaled() -> None:
    """Of one joint against the other one, with a torque beside the base parameters."""
    fitted = fitted_motion(right("scara", 1, noise=0.01).on("estimation"))
    assert fitted is not None
    along = fitted.along
    fitted = replace(fitted, changed=lambda ticks: (along(ticks)[0], along(ticks)[1] + 0.3))
    misfit, n = fitted.misfit_by_scales(), fitted.run.model.joint_count
    assert misfit(np.ones(n)) == pytest.approx(fitted.misfit(), rel=1e-7)
    for scale in (np.array([1.0, 1.3]), np.array([0.8, 1.0])):

        def scaled(ticks: Ticks, scale: np.ndarray = scale) -> tuple[Array, Array]:
            columns, known = along(ticks)
            return columns * scale[:, None], (known + 0.3) * scale

        expected = fitted.misfit_of(replace(fitted, changed=scaled))
        assert misfit(scale) == pytest.approx(expected, rel=1e-7)
        assert abs(expected / fitted.misfit() - 1) > 0.01


@pytest.mark.parametrize(("late_s", "told"), [(2e-5, "timing-slightly-off"), (5e-3, "sampling-kind")])
def test_another_timing_that_moves_no_value_is_no_doubt(late_s: float, told: str) -> None:
    fitted = fitted_motion(right("scara", 1).on("estimation"))
    assert fitted is not None
    own, step = fitted.experiment, fitted.run.step_size
    operator = own.operator.stamped_later(late_s / step, own.reference.time.size, between=True)
    other = replace(fitted, run=fitted.run.on(replace(own, operator=operator)))
    doubt = Diagnostic(SAMPLING_KIND, "The log shows averages.", "estimation", 0.5, 0.9, "1")
    (found,) = _Near(other, 0.5).explanations(fitted, doubt)
    assert found.diagnostic.code.name == told
    assert (fitted.apart(other).max() > MATTERS) == (told == "sampling-kind")
    assert found.gain == fitted.gain(0.5, 0.0)
    assert not [*_Near(other, 0.98).explanations(fitted, doubt)], "what leaves as much explains nothing"


@pytest.mark.parametrize("change", [lambda y, g: y / g, lambda y, g: y * g], ids=["current", "twice"])
def test_gains_of_the_drives(change: Callable[[Array, Array], Array]) -> None:
    model = right("tx40", 1)
    gains = drive_gains(model)
    assert gains.tolist() == [35.24, 32.04, 23.94, 9.05, 15.5, 6.56]
    assert codes(with_log(model, lambda torque: change(torque, gains)))[0] == "drive-gain"


@pytest.mark.parametrize(("scale", "told"), [(0.02, "reference-unit-doubtful"), (1.0, "reference-unit")])
def test_degrees_are_a_doubt_where_a_machine_has_the_range(scale: float, told: str) -> None:
    model = with_columns(loaded("scara"), lambda _, column: scale * column)
    model = with_log(model, lambda _: model.torque(model.start, "estimation"))
    assert codes(model) == []
    assert codes(degrees(model))[0] == told


def test_lengths_in_millimetres() -> None:
    model = loaded("scara")
    assert isinstance(model.parameters, RobotParameters)
    robot = model.parameters.model.description
    joints = tuple(joint.model_copy(update={"a": 1000 * joint.a}) for joint in robot.joints)
    wrong = replace(model.parameters, model=RobotModel(robot.model_copy(update={"joints": joints})))
    (found,) = length_unit_diagnostics(replace(model, loop=replace(model.loop, parameters=wrong)))
    assert (found.code.name, found.value) == ("length-unit", 500.0)
    assert length_unit_diagnostics(model) == []
