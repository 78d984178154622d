"""Outputs of a model that are any variable of its FMU, and where its states start."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.case import load_case
from fmu_didim.case.calibration.model import with_outputs, with_starts
from fmu_didim.checks.plant.influence import check_parameter_influence
from fmu_didim.components.fmu import FmuComponent, load_fmu
from fmu_didim.components.fmu.chosen import states_of, visible
from fmu_didim.components.variable_names import unknown
from fmu_didim.data.signals import trajectory
from tests.awkward.build import ARRAYS, DEFAULTS, EVENTS, SLAVE, awkward_fmu, library, pack
from tests.awkward.versions import SLAVE_1, STAND_ALONE, fmi_1
from tests.case.calibration.models import case_of, noisy, steps_of_lag
from tests.components.fmu.helpers import ONES, H, slave_outputs
from tests.helpers import drive

TIME = np.arange(200) * H


def shown(path: Path, *names: str, **options: Any) -> FmuComponent:
    """An FMU with further outputs."""
    made = with_outputs(load_fmu(path, si_units=False, **options), dict.fromkeys(names, "here"))
    assert isinstance(made, FmuComponent)
    return made


def test_a_local_variable_of_fmi_2(tmp_path: Path) -> None:
    made = shown(awkward_fmu(tmp_path), "internal", "y", "internal")
    assert [v.name for v in made.outputs] == ["y", "internal"]
    got = drive(made, ONES, H)
    np.testing.assert_allclose(got[:, 0], slave_outputs(ONES)[:, 0], rtol=1e-13)
    assert made.feedthrough() == {("y", "u"), ("internal", "u")}  # what is not said may follow the inputs at once


def test_a_local_variable_of_fmi_1(tmp_path: Path) -> None:
    fmi_1(tmp_path)  # its library
    text = SLAVE_1.format(u_unit="", implementation=STAND_ALONE)
    old = 'name="minus_y" valueReference="1" causality="output"'
    assert old in text
    path = pack(tmp_path / "local.fmu", text.replace(old, old.replace("output", "internal")), library("slave1"))
    made = load_fmu(path, si_units=False)
    assert [v.name for v in made.outputs] == ["y", "steps"]
    got = drive(shown(path, "minus_y"), ONES, H)
    np.testing.assert_allclose(got[:, 2], -slave_outputs(ONES)[:, 0], rtol=1e-13)


def test_elements_of_a_local_array_of_fmi_3(tmp_path: Path) -> None:
    text = ARRAYS.replace('name="y" valueReference="1" causality="output"', 'name="y" valueReference="1"')
    path = pack(tmp_path / "arrays.fmu", text.replace('<Output valueReference="1"/>', ""), library("arrays"))
    made = shown(path, "y[2]")
    assert [v.name for v in made.outputs] == ["z", "y[1]", "y[2]"]
    inputs = np.array([[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(drive(made.with_parameters({"A[2,1]": 10.0}), inputs, H)[:, 2], [12.0, 34.0])
    with pytest.raises(InputError, match=r"is an array[\s\S]*y\[1\], y\[2\]"):
        shown(path, "y")


@pytest.mark.parametrize(
    ("name", "said"),
    [("u", "an input of the type Real"), ("a", "a parameter of the type Real"), ("label", "of the type String"),
     ("intrnal", "Did you mean 'internal'"), ("nothing like it", "Take one that the model has")],
)  # fmt: skip
def test_what_cannot_have_been_measured(tmp_path: Path, name: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as error:
        shown(awkward_fmu(tmp_path), name)
    assert error.value.where == "here"


def test_the_nearest_of_many_names_and_how_many_there_are() -> None:
    names = [f"room{i}.T" for i in range(40)] + [f"wall{i}.Q" for i in range(40)] + ["boiler.power"]
    error = unknown("variable of the model", "Boiler.Powr", names, where="measured")
    assert error.valid == "boiler.power; 81 in all"
    assert "Did you mean 'boiler.power'? fmu-didim fmu info" in error.next_step
    assert unknown("variable", "T", names, where="").valid.startswith("room0.T, room1.T")  # the last part of a name


def test_columns_of_a_file_are_found_among_all_variables(tmp_path: Path) -> None:
    awkward_fmu(tmp_path)
    rows = trajectory(TIME, {"internal": np.cos(TIME), "y": np.sin(TIME), "u": TIME})
    case = load_case(
        {"schema": 1, "name": "slave", "model": "plain.fmu", "measured": "log", "identify": {"a": {}}},
        folder=tmp_path, signals={"log": rows},
    )  # fmt: skip
    assert case.model.loop.output_signals == ("model.y", "model.internal")  # the input is none of them


# ---- where states start


def test_a_start_value_that_acts_in_co_simulation(tmp_path: Path) -> None:
    made = with_starts(load_fmu(awkward_fmu(tmp_path), si_units=False), {"internal.start": "identify"})
    values = {v.name: v.start for v in made.parameters}
    assert values["internal.start"] == 0.0
    got = drive(made.with_parameters({"internal.start": 0.7, "a": 1.0}), ONES, H)
    free = 0.7 * (1 - H) ** np.arange(10)[:, None]
    np.testing.assert_allclose(got, slave_outputs(ONES, a=1.0) + free, rtol=1e-13)


@pytest.mark.gate
def test_start_values_that_do_not_act_are_refused_with_the_reason(tmp_path: Path) -> None:
    overwritten = load_fmu(awkward_fmu(tmp_path, "ENTER_OVERWRITES"), si_units=False)
    with pytest.raises(InputError, match=r"start of 'internal' cannot be chosen[\s\S]*did not take") as error:
        with_starts(overwritten, {"internal.start": "identify.internal.start"})
    assert "Identify the parameter that sets it" in error.value.next_step
    text = SLAVE.format(**DEFAULTS).replace(' initial="exact"><Real start="0"/>', "><Real/>")
    silent = load_fmu(pack(tmp_path / "silent.fmu", text, library("slave")), si_units=False)
    with pytest.raises(InputError, match="it has no start value that can be set"):
        with_starts(silent, {"internal.start": "identify"})
    with pytest.raises(InputError, match=r"no variable of the model named 'intern'[\s\S]*'internal'"):
        with_starts(silent, {"intern.start": "identify"})


def test_a_start_value_that_is_calculated_and_acts_is_found_out(tmp_path: Path) -> None:
    text = SLAVE.format(**DEFAULTS).replace('initial="exact"><Real start="0"/>', 'initial="approx"><Real start="0"/>')
    made = load_fmu(pack(tmp_path / "approx.fmu", text, library("slave")), si_units=False)
    assert not made.start_values
    started = with_starts(made, {"internal.start": "identify"}).with_parameters({"internal.start": 0.5})
    np.testing.assert_allclose(drive(started, 0 * ONES, H)[1, 0], 0.5 * (1 - 2 * H), rtol=1e-13)


def test_a_state_in_model_exchange_starts_where_it_is_put(tmp_path: Path) -> None:
    """Its FMU has no start value at all for it."""
    path = pack(tmp_path / "events.fmu", EVENTS, library("events"))
    plain = load_fmu(path, si_units=False, substeps=4)
    assert states_of(plain) == {"x": 0}
    assert "x" in visible(plain)
    made = with_starts(shown(path, "x", substeps=4), {"x.start": "identify"})
    own = drive(shown(path, "x", substeps=4), 0 * ONES, H)
    np.testing.assert_array_equal(drive(made, 0 * ONES, H), own)  # where it starts by itself, unless it is set
    moved = drive(made.with_parameters({"x.start": 0.25}), 0 * ONES, H)
    assert moved[0, 1] == pytest.approx(0.25)
    with pytest.raises(InputError, match=r"it is no continuous state[\s\S]*valid: x\.start"):
        with_starts(plain, {"y.start": "identify"})


@pytest.mark.gate
def test_known_and_identified_starts_of_a_case(tmp_path: Path) -> None:
    awkward_fmu(tmp_path)
    y = (slave_outputs(0 * TIME[:, None], a=2.0) + 0.7 * (1 - 2 * H) ** np.arange(TIME.size)[:, None])[:, 0]
    log = noisy(TIME, {"y": y}, 1e-3, 1)
    entries: dict[str, Any] = {"schema": 1, "name": "slave", "measured": "log"}

    def answer(model: dict[str, Any], **identify: Any) -> tuple[np.ndarray, np.ndarray]:
        case = load_case({**entries, "model": {"source": "plain.fmu", **model}, "identify": identify},
                         folder=tmp_path, signals={"log": log})  # fmt: skip
        found = case.estimator.estimate(case.model)
        return found.value, found.standard_deviation

    value, deviation = answer({}, **{"a": {}, "internal.start": {"start": 0.1}})
    assert (np.abs(value - [2.0, 0.7]) < 4 * deviation).all()
    known, _ = answer({"parameters": {"internal.start": 0.7}}, a={})
    assert known[0] == pytest.approx(2.0, abs=4 * deviation[0])


def test_a_start_of_its_own_in_each_experiment() -> None:
    time = np.linspace(0, 8, 81)
    starts, runs = {"one": 2.0, "two": -1.0}, {}
    signals = {"u": trajectory(time, {"u": np.ones(time.size)})}
    for seed, (label, start) in enumerate(starts.items()):
        y = steps_of_lag(time, {0.0: 1.0}, constant=1.5, gain=1.0, start=start)
        signals[label] = noisy(time, {"y": y}, 0.01, seed)
        runs[label] = {"inputs": "u", "measured": label, "own": ["y0"] if label == "two" else []}
    case = case_of("lag", signals, experiments=runs, identify={"T": {}, "y0": {}})
    found = case.estimator.estimate(case.model)
    assert found.names == ("T", "y0", "y0[two]")
    assert (np.abs(found.value - [1.5, 2.0, -1.0]) < 4 * found.standard_deviation).all()


def test_a_state_under_identify_is_told_how_its_start_is_called(tmp_path: Path) -> None:
    pack(tmp_path / "events.fmu", EVENTS, library("events"))
    log = trajectory(TIME, {"y": np.sin(TIME)})
    for name, said in (("x", r"Where it starts is 'x\.start'"), ("u", "It is an input"), ("y", "The model computes it"),
                       ("q", r"valid: x\.start")):  # fmt: skip
        with pytest.raises(InputError, match=said):
            load_case({"schema": 1, "name": "e", "model": "events.fmu", "measured": "log", "identify": {name: {}}},
                      folder=tmp_path, signals={"log": log})  # fmt: skip


@pytest.mark.gate
def test_parameters_that_change_nothing_are_told_with_what_wakes_them(tmp_path: Path) -> None:
    log, u = trajectory(TIME, {"y": np.exp(-TIME)}), trajectory(TIME, {"u": 0 * TIME})
    with pytest.raises(InputError, match=r"k changes nothing[\s\S]*has to move: u never does"):
        check_parameter_influence(
            case_of("lag", {"l": log, "u": u}, inputs="u", measured="l", identify={"k": {}}).model
        )
    awkward_fmu(tmp_path)
    case = load_case(
        {"schema": 1, "name": "s", "model": "plain.fmu", "measured": {"file": "l", "columns": {"internal": {}}},
         "identify": {"d": {}}}, folder=tmp_path,
        signals={"l": trajectory(TIME, {"internal": np.exp(-TIME)})},
    )  # fmt: skip
    with pytest.raises(InputError, match="d changes nothing that was measured"):
        check_parameter_influence(case.model)
