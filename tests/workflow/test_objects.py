"""Arrays, controllers, robots, components and effects in memory, in the place of files."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import casadi as ca
import control
import numpy as np
import pytest

from fmu_didim import (
    Case,
    InputError,
    Log,
    Reference,
    RobotDescription,
    RobotModel,
    check,
    discover,
    identify,
    load_case,
    load_fmu,
    read_controller,
    read_robot,
    read_trajectory,
    simulate,
    to_control,
    trajectory,
    write_csv,
)
from fmu_didim.base.diagnostics import DiagnosedError
from fmu_didim.base.documents import validate
from fmu_didim.dynamics.effects import Parameter, TorqueEffect, effect_name
from fmu_didim.dynamics.effects.steps import direction, smoothing_velocity
from fmu_didim.export import build_fmu
from fmu_didim.workflow.case_files import case_files
from tests.workflow.three_experiments import three_experiments

CASE = "examples/scara/identify.yaml"
ROBOT, CONTROLLER = "fmus/scara/robot.yaml", "controllers/scara_pd.yaml"
KP, KD = np.array([3700.0, 62.0]), np.array([230.0, 4.0])


def law(q: Any, dq: Any, q_ref: Any, dq_ref: Any) -> Any:
    """The PD law of the example, its arguments in another order than the documentation has them."""
    return KP * (q_ref - q) + KD * (dq_ref - dq)


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case(CASE)


@pytest.fixture(scope="module")
def reference(case: Case) -> Reference:
    found = case.reference("estimation")
    q, dq, ddq = (found.select([f"{stem}1", f"{stem}2"]) for stem in ("q", "dq", "ddq"))
    return Reference(found.time, q, dq, ddq)


@pytest.fixture(scope="module")
def log() -> Log:
    found = read_trajectory("examples/scara/train_10hz.csv")
    return Log(found.time, found.select(["tau1", "tau2"]))


@pytest.mark.gate
def test_arrays_are_identified_as_the_files_are(case: Case, log: Log, reference: Reference) -> None:
    expected = identify(case)
    found = identify(CASE, log=log, reference=reference)
    assert found.values == expected.values
    alone = identify(robot=ROBOT, controller=CONTROLLER, log=log, reference=reference)
    for name, parameter in expected.parameters.items():
        assert abs(alone.values[name] - parameter.value) < 0.1 * parameter.std  # it starts elsewhere
    assert alone.document.name == "case in memory"


@pytest.mark.slow
def test_arrays_and_objects_are_hashed_into_the_provenance(log: Log, reference: Reference) -> None:
    def files(**changes: Any) -> dict[str, str]:
        given = {"robot": read_robot(ROBOT), "controller": law, "log": log, "reference": reference, **changes}
        found: dict[str, str] = identify(**given, loop={"rate_hz": 200}).document.provenance["files"]
        return found

    first = files()
    assert list(first) == ["<reference of estimation>", "<torque of estimation>", "<robot>", "<controller>"]
    assert files() == first
    other = files(
        log=Log(log.time, 1.01 * log.torque), controller=lambda q, dq, q_ref, dq_ref: law(q, dq, q_ref, dq_ref)
    )
    assert [name for name in first if first[name] != other[name]] == ["<torque of estimation>", "<controller>"]


def system() -> Any:
    return to_control(read_controller(CONTROLLER))


@pytest.mark.gate
@pytest.mark.parametrize(
    "controller",
    [
        law,
        system,
        pytest.param(lambda: read_controller(CONTROLLER), id="function that returns a block"),
        pytest.param("block", id="block"),
        pytest.param("system", id="python-control"),
        pytest.param("component", id="component"),
    ],
)
def test_controllers_of_every_kind_give_the_same_torque(controller: Any, reference: Reference) -> None:
    made: dict[str, Callable[[], Any]] = {
        "block": lambda: read_controller(CONTROLLER), "system": system,
        "component": lambda: load_fmu(build_fmu(read_controller(CONTROLLER))),
    }  # fmt: skip
    controller = made[controller]() if controller in made else controller
    expected = simulate(CASE)
    for given in ({"case": CASE}, {"robot": ROBOT, "reference": reference}):
        found = simulate(**given, controller=controller, loop={"rate_hz": 200})
        np.testing.assert_allclose(found.values, expected.values, rtol=1e-6, atol=1e-6)


def test_robot_and_plant_of_every_kind(reference: Reference) -> None:
    expected = simulate(CASE)
    robot = read_robot(ROBOT)
    for given in (robot, RobotModel(robot), robot.model_dump(by_alias=True)):
        np.testing.assert_array_equal(simulate(CASE, robot=given).values, expected.values)
    plant = load_fmu(build_fmu(RobotModel(robot).block()))
    np.testing.assert_allclose(simulate(CASE, plant=plant).values, expected.values, rtol=1e-6, atol=1e-6)
    with pytest.raises(InputError, match="no robot, controller"):
        simulate(reference=reference)


def test_units_of_arrays(case: Case, log: Log, reference: Reference) -> None:
    q, dq, ddq = (np.rad2deg(part) for part in (reference.position, reference.velocity, reference.acceleration))
    turned = Reference(reference.time, q, dq, ddq, unit="deg")
    found = case.with_(train={"torque": Log(log.time, 1000 * log.torque, unit="mN.m"), "reference": turned}).model
    np.testing.assert_allclose(found.measured, case.model.measured, rtol=1e-12)
    for label in ("q1", "dq2", "ddq2"):
        one, other = (m.experiments["estimation"].reference.column(label) for m in (found, case.model))
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


NAMED = {"identify": {"ZZ2": {"start": 0.06}, "Fv1": {}, "Fc1": {}}, "estimator": {"kind": "clie"}}
"""A plant without a regressor, as an FMU of another tool is."""


@pytest.mark.parametrize("plant", [{}, NAMED], ids=["robot", "named parameters"])
def test_angles_in_degrees_without_their_unit_are_reported(
    case: Case, reference: Reference, plant: dict[str, Any]
) -> None:
    given = case.with_(**plant)
    assert not [d for d in check(given).diagnostics if "unit" in d.code.name]
    found = check(given, reference=Reference(reference.time, np.rad2deg(reference.position)))
    (told,) = (d for d in found.diagnostics if "unit" in d.code.name)
    assert told.code.name == "reference-unit" and "unit='deg'" in told.advice


@pytest.mark.gate
@pytest.mark.parametrize(("degrees", "code"), [(False, []), (True, ["positions-unit"])])
def test_measured_positions_in_degrees_are_reported_in_arrays_and_in_files(
    case: Case, reference: Reference, tmp_path: Path, degrees: bool, code: list[str]
) -> None:
    rows = np.rad2deg(reference.position) if degrees else np.asarray(reference.position)
    write_csv(trajectory(reference.time, {"q1": rows[:, 0], "q2": rows[:, 1]}), tmp_path / "motion.csv")
    for positions in (Reference(reference.time, rows), {"file": str(tmp_path / "motion.csv")}):
        found = check(case.with_(train={"positions": positions}))
        assert [d.code.name for d in found.diagnostics if "unit" in d.code.name] == code


def test_derivatives_that_are_left_out_are_computed_and_told(log: Log, reference: Reference) -> None:
    found = check(CASE, log=log, reference=Reference(reference.time, reference.position))
    assert [d.place for d in found.diagnostics if d.code.name == "reference-derived"] == ["<reference of estimation>"]


def test_validation_in_memory_in_either_order(case: Case, log: Log, reference: Reference) -> None:
    for pair in ((log, reference), (reference, log)):
        model = load_case(CASE).with_(validation=pair).model
        np.testing.assert_array_equal(model.experiments.measured_in("validation"), case.model.measured)
    held_out = identify(CASE, validation=(log, reference)).validation("validation")
    assert held_out.role == "validation"
    np.testing.assert_array_equal(held_out.measured, np.asarray(log.torque))


def test_several_experiments_in_memory(log: Log, reference: Reference) -> None:
    entry = {"torque": log, "reference": reference}
    case = load_case(
        {"name": "two", "robot": ROBOT, "controller": CONTROLLER, "experiments": {"a": entry, "b": (log, reference)}}
    )
    assert list(case.model.experiments) == ["a", "b"]
    with pytest.raises(InputError, match="several experiments that may be meant") as caught:
        identify(case, log=log)
    assert "a, b" in str(caught.value)
    other = case.with_(experiments={"a": {"torque": Log(log.time, 2 * log.torque)}})
    np.testing.assert_array_equal(other.model.experiments.measured_in("a"), 2 * case.model.experiments.measured_in("b"))


def test_what_a_case_says_of_its_logger_holds_for_a_log_and_what_it_says_of_its_file_does_not(log: Log) -> None:
    torque = {"file": "nowhere.csv", "columns": {"tau1": "A"}, "time": "zeit", "rate_hz": 5}
    case = load_case(CASE, require_torque=False).with_(train={"torque": torque}).with_(train={"torque": log})
    assert case.content["train"]["torque"] == {"file": "<torque of estimation>", "rate_hz": 5}
    assert case.model.experiments["estimation"].rate_hz == pytest.approx(5)


def test_a_controller_replaces_the_former_one_with_all_that_was_said_of_it(case: Case) -> None:
    gains = case.with_(controller={"parameters": {"Kp1": 3000.0}})
    assert gains.with_(controller=law, loop={"rate_hz": 200}).content["controller"] == {
        "kind": "control", "source": "<controller>",
    }  # fmt: skip


@pytest.mark.slow
def test_gains_of_a_law_are_parameters_of_the_controller(log: Log, reference: Reference) -> None:
    def scaled(q_ref: Any, dq_ref: Any, q: Any, dq: Any, gain: float = 0.9) -> Any:
        return gain * law(q, dq, q_ref, dq_ref)

    case = load_case(
        {
            "name": "gain", "robot": ROBOT, "controller": scaled, "loop": {"rate_hz": 200},
            "train": {"torque": log, "reference": reference},
            "identify": {"gain": {"of": "controller", "start": 0.9}},
        }
    )  # fmt: skip
    found = identify(case).parameters["gain"]
    assert abs(found.value - 1) < 5 * found.std


T = np.arange(0.0, 10.0, 0.1)
TWO = np.zeros((100, 2))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Log(T, TWO.T), r"Transpose it: torque\.T"),
        (lambda: Log(T, TWO[:50]), "as many rows as the time has"),
        (lambda: Log(T[:, None], TWO), "The time is one column"),
        (lambda: Log(T[::-1], TWO), "Time does not increase"),
        (lambda: Log(T, np.full((100, 2), np.nan)), "not finite"),
        (lambda: Log(T, [["a"]] * 100), "no array of real numbers"),
        (lambda: Log(T * 1j, TWO), "no array of real numbers"),
        (lambda: Log(np.datetime64("2026-01-01") + (1000 * T).astype("timedelta64[ms]"), TWO), "dates, not seconds"),
        (lambda: Log(T, TWO, unit=["N.m"]).columns, "one for each"),
        (lambda: Reference(T, TWO, TWO[:, :1]), "different numbers of joints"),
        (lambda: Reference(T, TWO, TWO[:-1]), "Reference: velocity"),
    ],
)
def test_arrays_that_do_not_belong_together(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def moved(log: Log, **changes: Any) -> Log:
    return Log(**{"time": log.time, "torque": log.torque, **changes})


WRONG: list[tuple[str, Callable[[Log, Reference], dict[str, Any]]]] = [
    ("got:   1 columns", lambda log, ref: {"log": moved(log, torque=log.torque[:, 0])}),
    ("got:   3 columns", lambda log, ref: {"log": moved(log, torque=np.column_stack([log.torque, T]))}),
    ("got:   1 columns", lambda log, ref: {"reference": Reference(ref.time, ref.position[:, 0])}),
    ("reaches beyond its reference", lambda log, ref: {"log": moved(log, time=log.time + 1.7e9)}),
    ("seem to be in milliseconds", lambda log, ref: {"log": moved(log, time=1000 * log.time)}),
    ("seem to be in milliseconds", lambda log, ref: {"reference": Reference(1000 * ref.time, ref.position)}),
    ("not sampled at the control rate", lambda log, ref: {"reference": Reference(ref.time[::2], ref.position[::2])}),
    ("not sampled at the control rate", lambda log, ref: {"loop": {"rate_hz": 100}}),
    ("unit of tau1 is not one of its kind", lambda log, ref: {"log": moved(log, unit="deg")}),
    ("This is no torque", lambda log, ref: {"log": ref}),
    ("This is no reference", lambda log, ref: {"reference": (T, TWO)}),
    ("An experiment is a log and a reference", lambda log, ref: {"validation": (T, TWO)}),
    ("The control rate is unknown", lambda log, ref: {"controller": law}),
    ("nothing that runs in the loop", lambda log, ref: {"controller": 3}),
    ("passed by name, not by position", lambda log, ref: {"controller": lambda reference, position: 0}),
    ("one command for each joint", lambda log, ref: {"controller": lambda q: q[0]}),
    ("ZeroDivisionError", lambda log, ref: {"controller": lambda q: [1 / 0]}),
    (
        "rate of a component must be",
        lambda log, ref: {"controller": {"source": law, "rate_hz": 130}, "loop": {"rate_hz": 200}},
    ),
    ("Nothing gives 'u\\[0\\]'", lambda log, ref: {"controller": control.ss(*[np.eye(2)] * 4, 0.005)}),
    ("The control rate is unknown", lambda log, ref: {"controller": control.tf([1], [1, 1])}),
]  # fmt: skip


@pytest.mark.parametrize(("message", "changes"), WRONG, ids=[message for message, _ in WRONG])
def test_what_misleads_is_refused(
    message: str, changes: Callable[[Log, Reference], dict[str, Any]], log: Log, reference: Reference
) -> None:
    given: dict[str, Any] = {"robot": ROBOT, "controller": CONTROLLER, "log": log, "reference": reference}
    given |= changes(log, reference)
    with pytest.raises((InputError, DiagnosedError), match=message):
        identify(**given)


def test_a_law_that_remembers_is_refused() -> None:
    total = np.zeros(2)

    def integral(q_ref: Any, q: Any) -> Any:
        nonlocal total
        total = total + q_ref - q
        return total

    with pytest.raises(InputError, match="keeps something from call to call"):
        simulate(CASE, controller=integral)


def test_a_saved_case_names_what_was_in_memory(case: Case) -> None:
    content = case.with_(controller=law, loop={"rate_hz": 200}).content
    with pytest.raises(InputError, match="was in memory when it was saved") as caught:
        load_case(content, folder="examples/scara")
    assert "<controller>" in str(caught.value)


class RootFriction(TorqueEffect):
    """tau_e = Fr * tanh(dq/v0) * sqrt(|dq|)."""

    name = "root_friction"
    title = "Friction with the root of the speed"
    equation = "Fr*tanh(dq/v0)*sqrt(|dq|)"
    confounded_with = ("viscous",)
    signature = "Residual that rises steeply at low speed."
    experiment = "Constant speeds."
    source = "made up for this test"
    own_parameters = (Parameter("Fr", ("N.m.s0.5/rad0.5", "N.s0.5/m0.5"), "friction at unit speed", least=0.0),)
    own_shapes = (smoothing_velocity,)

    def columns(self, at: Any, shapes: Any) -> tuple[ca.SX, ...]:
        return (direction(at, shapes) * ca.sqrt(ca.fabs(at.dq) + 1e-6),)

    def damping(self, parameters: Any, shapes: Any, within: Any) -> ca.SX:
        return ca.fabs(parameters["Fr"]) / shapes["v0"]


def drive(*effects: Any, **values: float) -> RobotDescription:
    joint = {"type": "revolute", "effects": ["viscous", *effects], "parameters": {"ZZ": 0.1, **values}}
    return RobotDescription.model_validate({"name": "drive", "joints": [joint]})


def test_class_of_an_effect_in_a_robot_description() -> None:
    made = drive(RootFriction, Fr=0.4)
    assert [v.name for v in RobotModel(made).parameters if v.start] == ["ZZ1", "Fr1"]
    assert RobotDescription.model_validate(made.model_dump(by_alias=True)) == made


def test_a_class_that_is_defined_anew_is_another_effect() -> None:
    class RootFriction(TorqueEffect):
        """Likewise, but of another name of its parameter."""

        name, title, equation = "root_friction", "Another", "Fq*sqrt(dq)"
        signature = experiment = source = "made up"
        confounded_with = ()
        own_parameters = (Parameter("Fq", ("N.m", "N"), "friction"),)

        def columns(self, at: Any, shapes: Any) -> tuple[ca.SX, ...]:
            return (at.dq,)

        def damping(self, parameters: Any, shapes: Any, within: Any) -> ca.SX:
            return ca.fabs(parameters["Fq"])

    former, anew = drive(globals()["RootFriction"], Fr=0.4), drive(RootFriction, Fq=0.4)
    assert former.joints[0].effects != anew.joints[0].effects
    assert [v.name for v in RobotModel(former).parameters if v.start] == ["ZZ1", "Fr1"]
    assert [v.name for v in RobotModel(anew).parameters if v.start] == ["ZZ1", "Fq1"]


OWN_EFFECT = """
from fmu_didim.dynamics.effects.viscous import Viscous


class Own(Viscous):
    name = "own"

    def columns(self, at, shapes):
        return (at.dq * {factor},)
"""


def digests(*effects: Any, folder: Path, further: tuple[str, ...] = ()) -> dict[str, str]:
    """The digests of all that is read by a case whose robot has these effects on its first joint."""
    robot = read_robot(ROBOT).model_dump(by_alias=True)
    robot["joints"][0]["effects"] = ("motor_inertia", "coulomb", *effects)
    case = load_case(
        {**load_case(CASE).content, "robot": validate(RobotDescription, robot, where="", folder=folder)},
        folder=Path(CASE).parent,
    )
    return case_files(case, effects=further)


def test_source_of_own_effects_is_hashed_into_the_provenance(tmp_path: Path) -> None:
    file = tmp_path / "own.py"
    file.write_text(OWN_EFFECT.format(factor=1), encoding="utf-8")
    found = digests("own.py:Own", folder=tmp_path, further=("stribeck", effect_name(RootFriction)))
    assert found[f"{file}:Own"] == sha256(file.read_bytes()).hexdigest()
    assert found[f"{__name__}:RootFriction"] == sha256(Path(__file__).read_bytes()).hexdigest()
    assert "stribeck" not in found and "coulomb" not in found


def test_source_of_an_effect_in_no_file_is_that_of_its_class(tmp_path: Path) -> None:
    def made(factor: float) -> str:
        cell: dict[str, Any] = {"__name__": "a_notebook"}
        exec(OWN_EFFECT.format(factor=factor), cell)  # as a cell of a notebook
        name = effect_name(cell["Own"])
        assert name.startswith("a_notebook:Own")
        return digests(cell["Own"], folder=tmp_path)[name]

    first = made(1)
    assert len(first) == 64
    assert made(1) == first != made(2)


@pytest.mark.parametrize("wrong", [RootFriction(), int, 3])
def test_what_is_no_class_of_an_effect_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match="This is no effect"):
        drive(wrong)
    with pytest.raises(InputError, match="This is no effect"):
        discover(CASE, effects=[wrong])


def test_start_of_another_result(case: Case, log: Log) -> None:
    first = identify(case)
    again = identify(CASE, log=log, start=first)
    assert again.document.provenance["estimator"]["start"] == first.values
    assert again.document.history[0].parameters == pytest.approx(first.values)
    for name, parameter in first.parameters.items():
        assert abs(again.values[name] - parameter.value) < 0.1 * parameter.std


@pytest.mark.gate
def test_start_leaves_out_what_has_no_place_and_refuses_what_does_not_belong(case: Case, reference: Reference) -> None:
    three = identify(three_experiments())
    one = identify(case, start=three)  # own values of an experiment that the case does not have
    assert set(one.document.provenance["estimator"]["start"]) == set(one.values)
    gain = identify(case.with_(identify={"Kp1": {"of": "controller", "start": 3000.0}}))
    with pytest.raises(InputError, match="parameters that this case does not have"):
        identify(case, start=gain)
    with pytest.raises(InputError, match="This is no result to start from"):
        identify(case, start=one.values)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="takes no start values"):
        identify(case.with_(estimator={"kind": "idim_ls"}, train={"positions": reference}, validation=None), start=one)
