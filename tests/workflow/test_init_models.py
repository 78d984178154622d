"""``init`` for a model: which files make a case of a model, which columns are its inputs and outputs, what is asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim.base.errors import InputError
from fmu_didim.case import load_case
from fmu_didim.cli.main import main
from fmu_didim.components.fmu.description import CO_SIMULATION, MODEL_EXCHANGE, FmuDescription, FmuVariable, Interface
from fmu_didim.data.tables import read_table
from fmu_didim.workflow.init import start_case
from fmu_didim.workflow.init.data_file import DataFile
from fmu_didim.workflow.init.fmu_roles import FmuPorts
from fmu_didim.workflow.init.inventory import Inventory, a_model
from fmu_didim.workflow.init.model_case import model_case
from fmu_didim.workflow.init.model_columns import matched
from fmu_didim.workflow.init.model_runs import model_runs
from tests.conftest import ROOT

HOUSE = ROOT / "examples/house"
FILES = [HOUSE / name for name in ("house.fmu", "weather.csv", "room.csv", "weather_2.csv", "room_2.csv")]


def fmu(inputs: str, outputs: str, parameters: str = "") -> FmuDescription:
    """An FMU with these variables: ``name`` or ``name:unit``; of parameters also ``name:unit=start``."""
    kinds = (("input", inputs), ("output", outputs), ("parameter", parameters))
    found = []
    for causality, texts in kinds:
        for text in texts.split():
            head, _, start = text.partition("=")
            name, _, unit = head.partition(":")
            variability = "fixed" if causality == "parameter" else "continuous"
            found.append(
                FmuVariable(name, len(found), "Real", causality, variability, "exact", unit=unit, start=start or "1")
            )
    return FmuDescription(Path("x.fmu"), Path(), "", "2.0", "x", "", "", (), (), tuple(found))


def table(path: Path, header: str, rows: int = 40) -> DataFile:
    count = len(header.split(","))
    numbers = np.column_stack([np.arange(rows) * 60.0, np.ones((rows, count - 1))])
    np.savetxt(path, numbers, delimiter=",", header=header, comments="", fmt="%g")
    return DataFile(path, read_table(path))


def found_in(description: FmuDescription, *files: DataFile) -> tuple[dict[str, str], dict[str, str]]:
    """Inputs and outputs: name -> column."""
    sides: tuple[dict[str, str], dict[str, str]] = ({}, {})
    for file in matched(description, files):
        for side, matches in zip(sides, (file.inputs, file.outputs), strict=True):
            side.update({m.name: m.column for m in matches})
    return sides


def content_of(description: FmuDescription, *files: DataFile) -> dict:
    ports = FmuPorts(Path("x.fmu"), description)
    texts, _ = model_case(Inventory(data=list(files), fmus=[ports], model=(ports, "")), Path())
    return yaml.safe_load(texts["case.yaml"])


def test_fmu_and_two_csv_files_make_a_case_that_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["init", *map(str, FILES), "--out", str(tmp_path)]) == 0
    assert "nothing to be filled in" in capsys.readouterr().out
    text = (tmp_path / "case.yaml").read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if not line.lstrip().startswith("#")]) <= 15
    assert "  # C: {minimum: 0}  # 4e+06 J/K: Heat capacity of the room" in text
    assert [path.name for path in (tmp_path / "schemas").iterdir()] == ["case.json"]
    case = load_case(tmp_path / "case.yaml")
    assert case.model.names == ("R1", "R2") and list(case.model.experiments) == ["estimation", "validation"]


@pytest.mark.parametrize(
    ("header", "room", "inputs", "outputs"),
    [
        ("t,T_out,T_beside", "t,T", {"T_out": "T_out", "T_beside": "T_beside"}, {"T": "T"}),
        ("t,t_OUT [degC],T beside [K]", "time [s],T (°C)", {"T_out": "t_OUT [degC]", "T_beside": "T beside [K]"},
         {"T": "T (°C)"}),
        ("t,house.T_out,house.T_beside", "t,room.T", {"T_out": "house.T_out", "T_beside": "house.T_beside"},
         {"T": "room.T"}),
        ("t,out,beside", "t,room [degC]", {"T_out": "out", "T_beside": "beside"}, {"T": "room [degC]"}),
        ("t,T_out,x", "t,value", {"T_out": "T_out", "T_beside": "x"}, {"T": "value"}),
        ("t,T_out,x,y", "t,value", {"T_out": "T_out", "T_beside": "EDIT"}, {"T": "value"}),
        ("t,a,b", "t,value", {"T_out": "EDIT", "T_beside": "EDIT"}, {"T": "value"}),
        ("t,T_out,T_beside [Pa]", "t,T", {"T_out": "T_out"}, {"T": "T"}),
    ],
)  # fmt: skip
def test_columns_are_matched_by_name_and_unit(
    tmp_path: Path, header: str, room: str, inputs: dict[str, str], outputs: dict[str, str]
) -> None:
    house = fmu("T_out:degC T_beside:degC", "T:degC")
    assert found_in(house, table(tmp_path / "a.csv", header), table(tmp_path / "b.csv", room)) == (inputs, outputs)


def test_one_file_with_all_of_it(tmp_path: Path) -> None:
    content = content_of(fmu("u:W", "y:K z:K"), table(tmp_path / "log.csv", "t,u,y,other"))
    assert content["inputs"] == content["measured"] and content["inputs"].endswith("log.csv")


def test_one_of_many_outputs_is_asked_for_once(tmp_path: Path) -> None:
    content = content_of(fmu("u", "y1 y2 y3"), table(tmp_path / "u.csv", "t,u"), table(tmp_path / "m.csv", "t,value"))
    assert content["measured"]["columns"] == {"EDIT": "value"}


def test_an_output_is_told_by_its_unit_among_many(tmp_path: Path) -> None:
    files = table(tmp_path / "u.csv", "t,u"), table(tmp_path / "m.csv", "t,P [W]")
    assert content_of(fmu("u", "y1:K y2:W y3:m"), *files)["measured"]["columns"] == {"y2": "P [W]"}


def test_a_column_with_another_name_is_named(tmp_path: Path) -> None:
    files = table(tmp_path / "u.csv", "t,U [V]"), table(tmp_path / "m.csv", "t,y")
    assert content_of(fmu("u:V", "y"), *files)["inputs"]["columns"] == {"u": "U [V]"}


def test_inputs_that_no_file_has_are_told(tmp_path: Path) -> None:
    ports = FmuPorts(Path("x.fmu"), fmu("u P_heat:W=5", "y"))
    files = [table(tmp_path / "u.csv", "t,u"), table(tmp_path / "m.csv", "t,y")]
    texts, _ = model_case(Inventory(data=files, model=(ports, "")), Path())
    assert "which stay where they are in the model: P_heat = 5 W" in texts["case.yaml"]


def test_runs_by_words_of_their_names_and_the_last_one_held_out(tmp_path: Path) -> None:
    names = ("monday_weather", "tuesday_weather", "friday_weather", "friday_room", "monday_room", "tuesday_room")
    files = [table(tmp_path / f"{n}.csv", "t,u" if n.endswith("weather") else "t,y") for n in names]
    made = content_of(fmu("u", "y"), *files)["experiments"]
    assert {label: run.get("role") for label, run in made.items()} == {
        "monday": None, "tuesday": None, "friday": "validation",
    }  # fmt: skip
    assert all(label in run["inputs"] and label in run["measured"] for label, run in made.items())


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (("SimpleBatch_Data_1st", "SimpleBatch_Data_2nd"), ["1st", "2nd"]),
        (("run-7_b", "run-9_b"), ["7", "9"]),
        (("day", "day_2"), ["day", "2"]),
        (("growth",), ["growth"]),
    ],
)
def test_a_run_is_called_by_what_tells_it_from_the_others(
    tmp_path: Path, names: tuple[str, ...], labels: list[str]
) -> None:
    files = [table(tmp_path / f"{name}.csv", "t,y") for name in names]
    assert [run.label for run in model_runs(matched(fmu("", "y"), files))] == labels


def test_two_outputs_in_files_of_their_own_are_one_run(tmp_path: Path) -> None:
    files = [table(tmp_path / f"{n}.csv", h) for n, h in (("w", "t,u"), ("room", "t,y"), ("floor", "t,z"))]
    made = content_of(fmu("u", "y z"), *files)
    assert [name.rpartition("/")[2] for name in made["measured"]] == ["room.csv", "floor.csv"]


def test_what_cannot_be_a_run_is_refused(tmp_path: Path) -> None:
    weather = [table(tmp_path / f"w{i}.csv", f"t,u{i}") for i in (1, 2)]
    room = table(tmp_path / "room.csv", "t,y")
    with pytest.raises(InputError, match="in several files"):
        content_of(fmu("u1 u2", "y"), *weather, room)
    with pytest.raises(InputError, match="No column can be an output"):
        content_of(fmu("u1", "y:m"), table(tmp_path / "x.csv", "t,u1,p [Pa]"))
    with pytest.raises(InputError, match="Which inputs belong"):
        content_of(fmu("u", "y"), *(table(tmp_path / f"{n}.csv", "t,u") for n in "abc"),
                   *(table(tmp_path / f"{n}.csv", "t,y") for n in "de"))  # fmt: skip


def test_likely_parameters_are_active_and_all_are_listed(tmp_path: Path) -> None:
    files = table(tmp_path / "u.csv", "t,u"), table(tmp_path / "m.csv", "t,y")
    ports = FmuPorts(
        Path("x.fmu"), fmu("u", "y", "T_start:K=293 g:m/s2=9.81 k=2 zero:W=0 a:W/K=3 L:m=-1 m0:kg=4 b:W=3")
    )
    texts, _ = model_case(Inventory(data=list(files), model=(ports, "")), Path())
    assert yaml.safe_load(texts["case.yaml"])["identify"] == {"a": {"minimum": 0}, "L": {}}
    for line in ("# T_start: {}  # 293 K", "# m0: {minimum: 0}  # 4 kg", "# k: {}  # 2"):
        assert line in texts["case.yaml"]


@pytest.mark.parametrize(
    ("parameters", "active"),
    [
        ("mu_max x_max y_limit", ["mu_max", "x_max"]),
        ("mu_max X0 start", ["mu_max"]),
        ("mu_max Y_XS", ["Y_XS"]),
        ("mu_max:1/s Y_XS", ["Y_XS"]),
        ("X0 start", ["EDIT"]),
    ],
)
def test_a_name_like_a_limit_is_offered_where_nothing_else_is_there(
    tmp_path: Path, parameters: str, active: list[str]
) -> None:
    files = table(tmp_path / "y.csv", "time,y")
    assert list(content_of(fmu("", "y", parameters), files)["identify"] or {}) == active


@pytest.mark.parametrize(
    "other",
    [
        "absTolerance", "relTol", "timeStep", "timeSlowStart", "stepSizeCtrlMaxStep", "settings.dtMin", "_cs_rel_tol",
        "maxTimeStep", "theSolverType", "plotDt", "writeLogLevel", "A.limit.maximum", "DA.bits", "Ramp.offset",
    ],
)  # fmt: skip
def test_no_setting_and_no_limit_is_taken_for_a_parameter_of_the_model(tmp_path: Path, other: str) -> None:
    """As other tools name what their solvers are told; one that the data do not show makes the first fit a refusal."""
    ports = FmuPorts(Path("x.fmu"), fmu("u", "y", f"{other}=0.3 mass=10 drag=0.47 stepResponse=2"))
    files = table(tmp_path / "u.csv", "t,u"), table(tmp_path / "m.csv", "t,y")
    texts, _ = model_case(Inventory(data=list(files), model=(ports, "")), Path())
    assert list(yaml.safe_load(texts["case.yaml"])["identify"]) == ["mass", "drag"]
    assert f"# {other}: " in texts["case.yaml"]


@pytest.mark.parametrize(
    ("inputs", "outputs", "header", "is_model"),
    [
        ("T_out:degC", "T:degC", "t,T_out,T", True),
        ("u:V", "speed:rad/s", "t,u,speed", True),
        ("Q_flow:W T_set:degC", "T:degC", "t,Q_flow,T_set,T", True),
        ("a b", "c", "t,x,y,z", True),
        ("u_s1 u_m1", "y1", "t,q1,tau1", False),
        ("q_ref1 q1", "tau1", "t,q_ref1,q1,tau1", False),
        ("q_ref1 q1", "command1", "t,q_ref1,q1,command1 [V]", False),
        ("tau1", "q1 dq1", "t,q1,tau1", False),
        ("torque", "angle", "t,torque,angle", False),
        ("in[1]", "out[1]", "t,q1,x1", False),
        ("w_ref:rad/s w:rad/s", "i:A", "t,w_ref,w,i [A]", False),
    ],
)
def test_models_and_parts_of_robots_are_told_apart(
    tmp_path: Path, inputs: str, outputs: str, header: str, is_model: bool
) -> None:
    ports = FmuPorts(Path("x.fmu"), fmu(inputs, outputs))
    found = Inventory(data=[table(tmp_path / "log.csv", header)], fmus=[ports])
    assert (a_model(found, is_loop=False, model=None) is not None) == is_model
    assert a_model(found, is_loop=True, model=None) is None


def test_the_user_may_say_that_it_is_a_model(tmp_path: Path) -> None:
    robot = tmp_path / "log.csv"
    table(robot, "t,T_out,T_beside,T,tau1 [N.m]")
    made = start_case([robot], tmp_path / "a", model=HOUSE / "house.fmu")
    assert made.found[0] == ("house.fmu", "", "the model: as you say")
    with pytest.raises(InputError, match="no plant and no controller"):
        start_case([robot], tmp_path / "b", model=HOUSE / "house.fmu", law="pd")
    with pytest.raises(InputError, match="Only an FMU"):
        start_case([robot], tmp_path / "b", model=robot)


def test_a_variable_that_is_no_output_is_found_by_its_name(tmp_path: Path) -> None:
    model = fmu("u", "y")
    inner = FmuVariable("tank.level", 9, "Real", "local", "continuous", "calculated", unit="m")
    model = replace(model, variables=(*model.variables, inner))
    files = table(tmp_path / "u.csv", "t,u"), table(tmp_path / "m.csv", "t,Tank.Level [cm],other")
    assert content_of(model, *files)["measured"]["columns"] == {"tank.level": "Tank.Level [cm]"}
    assert content_of(model, files[0], table(tmp_path / "n.csv", "t,y"))["measured"].endswith("n.csv")


def test_starts_of_states_are_listed_where_they_can_be_chosen(tmp_path: Path) -> None:
    files = [table(tmp_path / "u.csv", "t,u"), table(tmp_path / "m.csv", "t,y")]
    model = replace(fmu("u", "y:K der(z)", "k:W=1"), states=("y",))
    texts, _ = model_case(Inventory(data=files, model=(FmuPorts(Path("x.mo"), model), "")), Path())
    assert "# y.start: {}  # K: where it starts" in texts["case.yaml"] and "# z.start: {}" in texts["case.yaml"]


@pytest.mark.parametrize(("kinds", "listed"), [((CO_SIMULATION, MODEL_EXCHANGE), True), ((CO_SIMULATION,), False)])
def test_starts_are_listed_where_an_fmu_is_integrated_here(
    tmp_path: Path, kinds: tuple[str, ...], listed: bool
) -> None:
    files = [table(tmp_path / "m.csv", "t,y")]
    model = replace(fmu("", "y:K", "k:W=1"), states=("y",), interfaces=tuple(Interface(kind, "x") for kind in kinds))
    texts, _ = model_case(Inventory(data=files, model=(FmuPorts(Path("x.fmu"), model), "")), Path())
    assert ("y.start" in texts["case.yaml"]) == listed
