"""Controllers that have been running when a log begins: their states are found, counted in the deviations, reported,
forbidden or given by the same means as positions and velocities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

from fmu_didim import Log, Result, identify
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case import load_case
from fmu_didim.components import load_fmu, wrap_control
from fmu_didim.controllers import read_controller
from fmu_didim.cosim import sample_operator
from fmu_didim.discovery.base_model import prepare
from fmu_didim.estimators.didim import Didim
from fmu_didim.estimators.initial_states import start_parameters
from fmu_didim.export import build_fmu
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.experiment import InitialState, StartKind
from fmu_didim.model.free_parameter import PLANT
from fmu_didim.model.loop_model import LoopModel
from tests.helpers import ROOT, with_component, with_torque

NOISE = np.array([0.35, 0.012])
SPREAD = {"q1": 0.03, "q2": 0.03, "dq1": 0.1, "dq2": 0.1, "integral1": 2e-3, "integral2": 3e-3}
SEEDS = range(100, 130)
PID = ROOT / "controllers/scara_pid.yaml"
CASE = ROOT / "examples/scara/identify.yaml"


def with_pid(**changes: Any) -> LoopModel:
    """The SCARA with a PID controller, logged at 50 Hz: at 10 Hz positions and integrals could not be told apart."""
    given: dict[str, Any] = {"controller": {"kind": "model", "source": str(PID)}, **changes}
    for part in ("train", "validation"):
        given[part] = {"torque": {"file": f"{part}_200hz.csv", "rate_hz": 50}, **given.get(part, {})}
    return load_case(CASE).with_(**given).model


@pytest.fixture(scope="module")
def model() -> LoopModel:
    return with_pid()


def logged(
    model: LoopModel, seed: int, off: Mapping[str, float], kind: StartKind = "detected"
) -> tuple[LoopModel, dict[str, dict[str, float]]]:
    """The model with noisy logs of loops that start off by drawn amounts of these sizes; and the true starts."""
    rng, truth = np.random.default_rng(seed), dict[str, dict[str, float]]()
    for label in model.experiments:
        experiment = model.experiments[label]
        row = dict(zip(experiment.reference.names, experiment.reference.values[0], strict=True))
        values = {name: float(row.get(name, 0.0) + size * rng.standard_normal()) for name, size in off.items()}
        true = replace(experiment, initial_state=InitialState("given", values))
        torque = model.with_experiment(label, true).torque(model.start, label)
        model = with_torque(model, torque + NOISE * rng.standard_normal(torque.shape), label)
        truth[label] = values
    return of_kind(model, kind), truth


def of_kind(model: LoopModel, kind: StartKind, values: Mapping[str, float] | None = None) -> LoopModel:
    for label in model.experiments:
        state = InitialState(kind, values or {})
        model = model.with_experiment(label, replace(model.experiments[label], initial_state=state))
    return model


def at_rest(model: LoopModel) -> LoopModel:
    """The same motions, from standing still on; the references' first second moves smoothly into them."""
    for label in model.experiments:
        experiment = model.experiments[label]
        reference, values = experiment.reference, experiment.reference.values.copy()
        t = reference.time - reference.time[0]
        s = np.clip(t, 0, 1)
        blend, rate = 10 * s**3 - 15 * s**4 + 6 * s**5, 30 * s**2 - 60 * s**3 + 30 * s**4
        curve = 60 * s - 180 * s**2 + 120 * s**3
        for j in (1, 2):
            q, dq, ddq = (values[:, reference.names.index(f"{n}{j}")].copy() for n in ("q", "dq", "ddq"))
            values[:, reference.names.index(f"q{j}")] = q[0] + blend * (q - q[0])
            values[:, reference.names.index(f"dq{j}")] = rate * (q - q[0]) + blend * dq
            values[:, reference.names.index(f"ddq{j}")] = curve * (q - q[0]) + 2 * rate * dq + blend * ddq
        moved = replace(experiment, reference=replace(reference, values=values))
        model = model.with_experiment(label, moved)
    return model


def errors(model: LoopModel, estimate: Estimate) -> np.ndarray:
    count = model.linear_count
    return np.asarray((estimate.value[:count] - model.start) / estimate.standard_deviation[:count])


def freed(estimate: Estimate) -> dict[str, tuple[float, float]]:
    """State -> value and deviation of the starts that are free."""
    found = zip(estimate.model.free_parameters, estimate.value, estimate.standard_deviation, strict=True)
    return {k.key.replace("_start", ""): (float(v), float(s)) for k, v, s in found if k.is_start}


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.3, pytest.param(1.0, marks=pytest.mark.slow)])
def test_values_and_deviations_hold_with_states_of_controllers_off(model: LoopModel, size: float) -> None:
    off = {name: size * value for name, value in SPREAD.items()}
    z, starts, held = [], [], []
    for seed in SEEDS:
        found, truth = logged(model, seed, off)
        estimate = Didim(start="torque").estimate(found)
        z.append(errors(model, estimate))
        starts += [(v - truth["estimation"][name]) / s for name, (v, s) in freed(estimate).items()]
        held.append(estimate.model.experiments["validation"].initial_state.values)
    assert 0.8 <= np.sqrt(np.mean(np.square(z))) <= 1.2
    assert 0.8 <= np.sqrt(np.mean(np.square(starts))) <= 1.2
    assert max(np.abs(z).max(), np.abs(starts).max()) < 4.5
    assert len(starts) >= 0.9 * len(SEEDS) * len(SPREAD)
    assert np.mean(["integral1" in values for values in held]) >= 0.9


@pytest.mark.slow
def test_a_load_that_a_controller_holds_at_rest_is_found_and_nothing_else_is_freed(model: LoopModel) -> None:
    rest = at_rest(model)
    for seed in SEEDS:
        right = Didim(start="torque").estimate(logged(rest, seed, {})[0])
        assert not freed(right)
        assert not [r for r in right.remarks if "start" in r]
    found = [Didim(start="torque").estimate(logged(rest, s, {"integral1": 2e-3, "integral2": 3e-3})[0]) for s in SEEDS]
    assert all(set(freed(estimate)) <= {"integral1", "integral2"} for estimate in found)
    assert np.mean([bool(freed(estimate)) for estimate in found]) >= 0.9
    assert 0.8 <= np.sqrt(np.mean([errors(rest, estimate) ** 2 for estimate in found])) <= 1.2


def test_an_integral_that_is_not_free_bends_the_values_and_one_that_is_does_not(model: LoopModel) -> None:
    off, truth = logged(model, 3, SPREAD)
    forbidden = Didim(start="torque").estimate(of_kind(off, "reference"))
    assert not freed(forbidden)
    residual = forbidden.residual[:, 0]
    assert np.linalg.norm(residual[:2]) > 10 * np.linalg.norm(residual[20:]) / np.sqrt(residual[20:].size / 2)
    estimate = Didim(start="torque").estimate(off)
    assert np.abs(errors(model, estimate)).max() < 4
    assert (
        np.abs(errors(model, estimate)).max()
        < np.abs((forbidden.value - model.start) / estimate.standard_deviation[: model.linear_count]).max()
    )
    found = freed(estimate)
    assert set(found) == set(SPREAD)
    assert max(abs(v - truth["estimation"][name]) / s for name, (v, s) in found.items()) < 3.5
    assert any("integral1 = " in remark and "instead of 0" in remark for remark in estimate.remarks)


def test_a_log_cut_out_of_the_middle_of_a_motion(model: LoopModel) -> None:
    """The integrals there are the sums of the errors of the whole motion before, which no one knows."""
    label, first_s = model.first, 3.0
    experiment = model.experiments[label]
    run, reference = model.simulation(model.start, label), experiment.reference
    place = int(np.searchsorted(reference.time, first_s - 1e-9))
    positions = run.record(ticks=np.arange(reference.time.size)).table(["plant.q1", "plant.q2"])
    integral = run.step_size * (reference.select(["q1", "q2"]) - positions)[:place].sum(axis=0)
    rows = experiment.time >= first_s - 1e-9
    late = replace(reference, time=reference.time[place:], values=reference.values[place:])
    noisy = run.torque()[rows] + 0.1 * NOISE * np.random.default_rng(1).standard_normal((rows.sum(), 2))
    operator = sample_operator(
        experiment.time[rows], start=float(late.time[0]), step=run.step_size, tick_count=late.time.size
    )
    cut = replace(experiment, reference=late, time=experiment.time[rows], torque=noisy, operator=operator, stamps=None)
    estimate = Didim(start="torque").estimate(model.with_experiment(label, cut).on(label))
    found = freed(estimate)
    for name, true in {"integral1": integral[0], "integral2": integral[1]}.items():
        assert abs(found[name][0] - true) < 4 * found[name][1]
    assert np.abs(errors(model, estimate)).max() < 4.5


def test_discovery_frees_a_state_that_is_asked_for_and_tells_of_one_that_is_not(model: LoopModel) -> None:
    told, free = (prepare(logged(model, 1, SPREAD, kind)[0]) for kind in ("detected", "free"))
    assert not any(k.is_start for k in told.fit.model.free_parameters)
    assert any("Write initial_state: free" in note for note in told.notes)
    assert {"integral_start1", "integral_start2"} <= {k.key for k in free.fit.model.free_parameters if k.is_start}
    assert any("integral1 = " in note for note in free.notes)


def test_states_that_are_given_are_used(model: LoopModel) -> None:
    given = {"integral1": 2e-3, "q1": 0.97}
    log = of_kind(model, "given", given)
    true = with_torque(log, log.torque(log.start, log.first), log.first)
    estimate = Didim(start="torque").estimate(true)
    assert not freed(estimate)
    np.testing.assert_allclose(estimate.value, model.start, rtol=1e-4)
    assert np.abs(model.torque(model.start, model.first) - true.measured)[:, 0].max() > 10


def test_the_result_says_where_each_experiment_starts(tmp_path: Path, model: LoopModel) -> None:
    """Free starts are parameters; those that are held, by the case or by the first part of a held-out log, stand with
    the experiment, in the file too."""
    off, truth = logged(model, 3, {k: v * (1 if "integral" in k else 0.05) for k, v in SPREAD.items()})
    train, validation = (
        {"torque": Log(off.experiments[label].time, off.experiments[label].torque)} for label in off.experiments
    )
    case = load_case(CASE).with_(
        controller={"kind": "model", "source": str(PID)}, plant={"kind": "model"}, estimator={"start": "torque"}
    )
    free = identify(case.with_(train=train, validation=validation))
    free.save(tmp_path)
    states = {label: e.initial_state for label, e in Result.load(tmp_path).document.experiments.items()}
    assert (states["estimation"].kind, states["estimation"].values) == ("free", {})
    assert states["validation"].kind == "found"
    assert states["validation"].values["integral1"] == pytest.approx(truth["validation"]["integral1"], abs=1e-3)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "found: q1 = " in page
    given = identify(case.with_(train={**train, "initial_state": truth["estimation"]}, validation=None))
    (state,) = [e.initial_state for e in given.document.experiments.values()]
    assert (state.kind, dict(state.values)) == ("given", truth["estimation"])


@pytest.mark.parametrize("name", ["integral3", "Ki1", "controller.Ki1"])
def test_a_state_that_does_not_exist_is_refused_with_those_that_do(name: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        with_pid(train={"initial_state": {name: 1.0}})
    assert name in str(caught.value)
    for valid in ("q1", "dq2", "integral1", "integral2"):
        assert valid in str(caught.value)
    assert "estimation.initial_state" in str(caught.value)


@pytest.mark.parametrize("kind", ["fmu", "control"])
def test_every_kind_of_component_offers_the_integral(model: LoopModel, kind: str) -> None:
    other = with_pid(controller={"kind": kind, "source": str(PID)})
    given = {"integral1": 2e-3, "integral2": -1e-3}
    a, b = (of_kind(m, "given", given).torque(m.start, m.first) for m in (model, other))
    np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-7)
    free = [k for k in start_parameters(other, other.first) if k.owner != PLANT]
    assert [k.name for k in free] == ["integral_start1[estimation]", "integral_start2[estimation]"]


def test_an_exported_controller_offers_it_by_its_file_alone(tmp_path: Path) -> None:
    fmu = load_fmu(build_fmu(read_controller(PID)))
    assert fmu.start_parameters == ("integral_start1", "integral_start2")
    assert set(fmu.start_parameters) <= fmu.fixed
    foreign = replace(fmu, fmu=replace(fmu.fmu, tool="Another tool"))
    assert foreign.start_parameters == ()  # what a name means there is not known
    assert {"integral_start1", "Kp1"} <= set(foreign.start_candidates)


def integrating(initial: tuple[float, ...] = ()) -> Any:
    """PID of joint 1 and 2 as a discrete StateSpace, with integrals as its states."""
    step, kp, ki = 0.005, np.array([3700.0, 62.0]), np.array([9000.0, 150.0])
    kd, one = np.array([230.0, 4.0]), np.eye(2)
    inputs = [f"{n}{j}" for n in ("q_ref", "dq_ref", "q", "dq") for j in (1, 2)]
    system = control.ss(
        one, step * np.hstack([one, 0 * one, -one, 0 * one]), np.diag(ki),
        np.hstack([np.diag(kp), np.diag(kd), -np.diag(kp), -np.diag(kd)]), step,
        inputs=inputs, outputs=["command1", "command2"],
    )  # fmt: skip
    return wrap_control(system, initial_state=initial)


def test_a_python_control_system_offers_its_states() -> None:
    model = with_pid(controller=integrating((0.001, 0.0)))
    assert [k.name for k in model.loop.starts if k.owner != PLANT] == ["x1", "x2"]
    assert [k.value for k in model.loop.starts if k.owner != PLANT] == [0.001, 0.0]
    off, truth = logged(model, 3, {"q1": 0.01, "x1": 2e-3, "x2": 3e-3})
    found = freed(Didim(start="torque").estimate(off))
    assert {"x1", "x2"} <= set(found)
    for name in ("x1", "x2"):
        assert abs(found[name][0] - truth["estimation"][name]) < 4 * found[name][1]


def test_the_start_of_a_python_control_system_is_no_parameter_of_its_functions() -> None:
    seen = set[str]()

    def update(t: float, x: np.ndarray, u: np.ndarray, params: Mapping[str, float]) -> np.ndarray:
        seen.update(params)
        return x + u

    system = control.nlsys(update, lambda t, x, u, p: x, inputs=1, outputs=1, states=1, dt=0.1, params={"gain": 2.0})
    made = wrap_control(system, initial_state=(3.0,))
    assert [v.name for v in made.parameters] == ["gain", "x_start1"]
    assert made.with_parameters({"x_start1": 5.0}).initial_state == (5.0,)
    instance = made.instantiate()
    instance.begin_initialisation(0.0)
    instance.end_initialisation()
    instance.step(0.0, 0.1)
    assert seen == {"gain"}


def test_an_fmu_of_another_tool_is_told_where_it_may_have_been_running(model: LoopModel) -> None:
    """Its states cannot be free: what its parameters mean is not known. The user can name one."""
    own = next(iter(with_pid(controller={"kind": "fmu", "source": str(PID)}).loop.systems.values()))
    part: Any = own.components["controller"]
    foreign = with_component(model, "controller", replace(part, fmu=replace(part.fmu, tool="Another tool"), block=None))
    off = {"integral1": 4e-3, "integral2": 6e-3}
    told = {}
    for name, size in (("moving", off), ("rest", {k: v / 4 for k, v in off.items()}), ("right", {})):
        base = model if name == "moving" else at_rest(model)
        log = logged(base, 3, size)[0].experiments[base.first]
        estimate = Didim(start="description").estimate(foreign.with_experiment(base.first, log).on(base.first))
        assert not {"integral1", "integral2"} & set(freed(estimate))
        told[name] = [remark for remark in estimate.remarks if "in which controller starts are not known" in remark]
    assert "may stand for states of controller" in told["moving"][0]
    assert "its first samples stand out" in told["rest"][0]
    assert not told["right"]
    with pytest.raises(InputError, match=r"controller\.Kp1"):
        foreign.loop.start_named("integral1")
    given = of_kind(foreign, "given", {"controller.integral_start1": 2e-3})
    own_given = of_kind(model, "given", {"integral1": 2e-3})
    a, b = (other.torque(model.start, model.first) for other in (given, own_given))
    np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-7)


def test_states_of_one_name_are_told_apart_by_their_component(model: LoopModel) -> None:
    (system,) = model.on(model.first).loop.systems.values()
    both = {**system.components, "axis2": system.components["controller"]}
    system = replace(system, components=both, order=(*system.order, "axis2"))
    loop = model.with_loop(systems={model.first: system}).loop
    names = [start.name for start in loop.starts if start.owner != PLANT]
    assert names == ["integral1", "integral2", "axis2.integral1", "axis2.integral2"]
    assert loop.start_named("axis2.integral2").label == "axis2.integral_start2"
    assert loop.start_named("controller.integral1").owner == "controller"
