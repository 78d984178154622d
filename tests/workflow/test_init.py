"""Own data: a case by ``init``, run after filling in only what cannot be known, gives the values of one by hand."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml

from fmu_didim import identify
from fmu_didim.base.errors import InputError
from fmu_didim.case import load_case
from fmu_didim.case.document import CaseDocument
from fmu_didim.case.files import data_folder
from fmu_didim.cli.main import main
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.workflow.init import start_case
from fmu_didim.workflow.reference.schema import SCHEMAS, schema
from tests.cases import SCARA
from tests.conftest import ROOT, needs_emps, package
from tests.tools.blind.simulator.make import make_plant, write_cases

NEAR = 0.05
"""Standard deviations by which values may differ: the data have nine digits, their velocities come from a spline."""
GEAR, CONSTANT = (50.0, 30.0), (0.2, 0.05)
GEOMETRY = ["[0, 0, 0]", "0", "0.5", "0"]
"""Of the SCARA: gravity; alpha, a and d of joint 2."""


def filled(path: Path, *values: str) -> None:
    """Put values in the places of a file that are to be filled in, in their order."""
    lines, given = path.read_text(encoding="utf-8").splitlines(), iter(values)
    for i, line in enumerate(lines):
        text, sign, note = line.partition("#")
        lines[i] = re.sub(r"\bEDIT\b", lambda _: next(given), text) + sign + note
    assert next(given, None) is None
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def scara() -> tuple[Trajectory, Array, Array]:
    """Reference at 200 Hz, instants and torque at 10 Hz of the training run."""
    run = load_case(SCARA).model.experiments["estimation"]
    return run.reference, run.time, run.torque


def comma(table: Array) -> str:
    return "\n".join(";".join(f"{value:.9g}".replace(".", ",") for value in row) for row in table)


def as_csv(folder: Path) -> list[Path]:
    """Semicolons, decimal commas, degrees, ms, motor currents, German words in Windows' letters, a line on top."""
    motion, time, torque = scara()
    q = np.degrees(motion.select(["q1", "q2"]))
    current = torque / (np.array(GEAR) * CONSTANT)
    files = {
        "bahn_soll.csv": ("Zeit [ms];Achse1 Soll [°];Achse2 Soll [°]", np.column_stack([1000 * motion.time, q])),
        "bahn_strom.csv": ("Zeit [ms];Strom Achse1 [A];Strom Achse2 [A]", np.column_stack([1000 * time, current])),
    }
    for name, (header, table) in files.items():
        text = f"Prüfstand 7; Größen der Achsen\n{header}\n{comma(table)}\n"
        (folder / name).write_bytes(text.encode("cp1252"))
    return [folder / name for name in files]


def as_hdf5(folder: Path) -> list[Path]:
    """One file, groups for what comes at another rate, units as attributes."""
    h5py = package("h5py")
    motion, time, torque = scara()
    with h5py.File(folder / "reference.h5", "w") as file:
        file["time"] = motion.time
        for j in (1, 2):
            file[f"position{j}_set"] = np.degrees(motion.column(f"q{j}"))
            file[f"position{j}_set"].attrs["unit"] = "deg"
    with h5py.File(folder / "torque.h5", "w") as file:
        file["time"] = 1e3 * time
        file["time"].attrs["unit"] = "ms"
        for j in (1, 2):
            file[f"torque{j}"] = 1e3 * torque[:, j - 1]
            file[f"torque{j}"].attrs["unit"] = "mN.m"
    return [folder / "reference.h5", folder / "torque.h5"]


def as_mf4(folder: Path) -> list[Path]:
    """One file, two groups with their own instants, units of the channels."""
    asammdf = package("asammdf")
    motion, time, torque = scara()
    file = asammdf.MDF(version="4.10")
    signal = asammdf.Signal
    file.append([signal(np.degrees(motion.column(f"q{j}")), motion.time, "deg", f"q{j}_ref") for j in (1, 2)])
    file.append([signal(torque[:, j - 1], time, "Nm", f"tau{j}_act") for j in (1, 2)])
    file.save(folder / "run.mf4", overwrite=True)
    file.close()
    return [folder / "run.mf4"]


def values_of(case: Any) -> dict[str, tuple[float, float]]:
    document = identify(case).document
    return {name: (p.value, p.std) for name, p in document.parameters.items()}


def assert_same(found: dict[str, tuple[float, float]], expected: dict[str, tuple[float, float]]) -> None:
    assert set(found) == set(expected)
    off = {n: (found[n][0] - v) / s for n, (v, s) in expected.items()}
    assert max(abs(d) for d in off.values()) < NEAR, off


def by_hand(folder: Path) -> dict[str, tuple[float, float]]:
    """The robot that was filled in with the project's own reference, by its formula, and its log in SI."""
    content = load_case(SCARA).content
    content |= {"robot": str(folder / "robot.yaml"), "estimator": {"kind": "didim"}, "plant": {"kind": "model"}}
    content |= {"controller": {"kind": "model", "source": str(ROOT / "controllers/scara_pd.yaml")}}
    return values_of(load_case(content | {"validation": None}, folder=SCARA.parent))


@pytest.mark.gate
@pytest.mark.parametrize(
    ("write", "drive"),
    [
        (as_csv, [f"{c:g}" for joint in zip(CONSTANT, GEAR, strict=True) for c in joint]),
        (as_hdf5, []),
        (as_mf4, []),
    ],
)
def test_own_data_give_the_values_of_a_case_by_hand(
    tmp_path: Path, write: Callable[[Path], list[Path]], drive: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    files = write(tmp_path)
    assert main(["init", *map(str, files), "--out", str(tmp_path), "--law", "pd"]) == 0
    told = capsys.readouterr().out
    assert "position of joint 2" in told and "places to be filled in" in told
    case = tmp_path / "case.yaml"
    assert main(["validate", str(case)]) == 1
    assert "still to be filled in" in capsys.readouterr().out
    if drive:
        filled(case, *drive)
    filled(tmp_path / "robot.yaml", *GEOMETRY)
    filled(tmp_path / "controller.yaml", "3700", "62", "230", "4")
    assert main(["validate", str(case)]) == 0, capsys.readouterr().out
    assert_same(values_of(load_case(case)), by_hand(tmp_path))


@pytest.mark.gate
@needs_emps
def test_emps_files_give_the_values_of_the_example(tmp_path: Path) -> None:
    """What cannot be known: the column of the command, the gain of the drive, the period, the pulses, the rate."""
    files = ["emps/DATA_EMPS.mat", "emps/DATA_EMPS_PULSES.mat"]
    example = load_case("examples/emps/identify.yaml")
    made = start_case(
        [*(data_folder(ROOT) / name for name in files), "fmus/emps/robot.yaml", "controllers/emps.yaml"], tmp_path
    )
    assert [path.name for path in made.files] == ["case.yaml"]
    filled(tmp_path / "case.yaml", "vir")  # once, for both runs
    content = yaml.safe_load((tmp_path / "case.yaml").read_text(encoding="utf-8"))
    content["loop"] |= {"drive_gains": [35.15065188248547], "injections": {"command1": "pulse1"}}
    for run in (content["train"], content["validation"]):
        run["reference"] |= {"period_s": 6.24, "warm_up_s": 1.0}
        run["torque"]["quantity"] = "command"
    content["train"]["torque"] |= {"rate_hz": 100, "phase_s": 0.005}
    content["validation"]["reference"]["columns"]["pulse1"] = "pulses_N"
    found = values_of(load_case(content, folder=tmp_path))
    assert_same(found, values_of(example.with_(estimator={"kind": "didim"}, plant={"kind": "model"})))


@pytest.mark.gate
def test_four_plain_files_give_the_values_of_one_by_hand(tmp_path: Path) -> None:
    """A blind case of the arm: its files are told apart by their names; to be filled in are geometry and gains."""
    blind = tmp_path / "blind"
    rng = np.random.default_rng(1)
    plant, motion, deviation = make_plant(["stribeck"], rng, level=1.0, robots="development")
    write_cases([(blind, 100)], plant, motion, deviation, rng)
    start_case(sorted(blind.glob("*.csv")), tmp_path, law="pd")
    filled(tmp_path / "robot.yaml", "[0, -9.81, 0]", "revolute", "revolute", "0", "0.5", "0")
    filled(tmp_path / "controller.yaml", "revolute", "revolute", "3300", "450", "150", "20")
    law = tmp_path / "controller.yaml"
    law.write_text(
        law.read_text(encoding="utf-8").replace("velocity: measured", "velocity: backward_difference"), "utf-8"
    )
    case = load_case(tmp_path / "case.yaml")
    assert {label: run.role for label, run in case.document.runs.items()} == {
        "estimation": "estimation", "validation": "validation",
    }  # fmt: skip
    hand = {
        "schema": 1, "name": "hand", "robot": str(tmp_path / "robot.yaml"), "plant": {"kind": "model"},
        "controller": {"kind": "model", "source": str(ROOT / "controllers/arm2r_pd.yaml")},
        "train": {"reference": {"file": "train_reference.csv"}, "torque": {"file": "train_torque.csv"}},
        "validation": {"reference": {"file": "test_reference.csv"}, "torque": {"file": "test_torque.csv"}},
    }  # fmt: skip
    assert_same(values_of(case), values_of(load_case(hand, folder=blind)))


def test_files_that_are_written_follow_their_schemas(tmp_path: Path) -> None:
    start_case(as_csv(tmp_path), tmp_path, law="pd")
    drive = [f"{c:g}" for joint in zip(CONSTANT, GEAR, strict=True) for c in joint]
    for name, values in (("case", drive), ("robot", GEOMETRY), ("controller", ["1", "1", "1", "1"])):
        path = tmp_path / f"{name}.yaml"
        filled(path, *values)
        text = path.read_text(encoding="utf-8")
        assert text.startswith(f"# yaml-language-server: $schema=schemas/{name}.json\n")
        made = json.loads((tmp_path / "schemas" / f"{name}.json").read_text(encoding="utf-8"))
        jsonschema.validate(yaml.safe_load(text), made)


def test_nothing_is_replaced(tmp_path: Path) -> None:
    files = as_csv(tmp_path)
    start_case(files, tmp_path)
    with pytest.raises(InputError, match=r"there already[\s\S]*case\.yaml"):
        start_case(files, tmp_path)


def test_two_columns_that_may_be_meant_are_left_to_the_user(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,pos_a,pos_b,torque1\n" + "".join(f"{k / 100},1,2,3\n" for k in range(20)))
    start_case([tmp_path / "log.csv"], tmp_path)
    content = yaml.safe_load((tmp_path / "case.yaml").read_text())
    assert content["train"]["reference"]["columns"] == {"q1": "EDIT"}
    assert content["train"]["torque"]["columns"] == {"tau1": "torque1"}


def test_set_points_are_taken_rather_than_measurements(tmp_path: Path) -> None:
    names = "t,Pos1_Ist,Pos1_Soll,Moment1_Ist,Moment1_Soll"
    (tmp_path / "log.csv").write_text(names + "\n" + "".join(f"{k / 100},1,2,3,4\n" for k in range(20)))
    start_case([tmp_path / "log.csv"], tmp_path)
    train = yaml.safe_load((tmp_path / "case.yaml").read_text())["train"]
    assert train["reference"]["columns"] == {"q1": "Pos1_Soll"}
    assert train["torque"]["columns"] == {"tau1": "Moment1_Ist"}


@pytest.mark.parametrize("kind", SCHEMAS)
def test_schemas_are_schemas(kind: str) -> None:
    jsonschema.Draft202012Validator.check_schema(schema(kind))


@pytest.mark.gate
@pytest.mark.parametrize(
    ("kind", "path"),
    [
        *(
            ("case", str(p.relative_to(ROOT)))
            for p in sorted(ROOT.glob("examples/*/*.yaml"))
            if "train:" in p.read_text() or "experiments:" in p.read_text()
        ),
        *(("robot", str(p.relative_to(ROOT))) for p in sorted(ROOT.glob("fmus/*/robot.yaml"))),
        *(("controller", str(p.relative_to(ROOT))) for p in sorted(ROOT.glob("controllers/*.yaml"))),
    ],
)
def test_shipped_files_follow_their_schemas(kind: str, path: str) -> None:
    jsonschema.validate(yaml.safe_load(Path(path).read_text(encoding="utf-8")), schema(kind))


def test_a_mistyped_effect_is_told_by_the_schema() -> None:
    robot = {"name": "x", "joints": [{"type": "revolute", "effects": ["viscos"]}]}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(robot, schema("robot"))


def test_fmus_are_told_apart_and_their_variables_listed(tmp_path: Path) -> None:
    """Controller by its set points, plant by what is left; with a description the case runs as it is."""
    files = as_csv(tmp_path)
    assert main(["export", "fmus/scara/robot.yaml", "--out", str(tmp_path)]) == 0
    assert main(["export", "controllers/scara_pd.yaml", "--out", str(tmp_path)]) == 0
    fmus = [tmp_path / "scara.fmu", tmp_path / "scara_pd.fmu"]
    made = start_case([*files, *fmus, "fmus/scara/robot.yaml"], tmp_path / "with")
    assert [path.name for path in made.files] == ["case.yaml"]
    text = made.files[0].read_text(encoding="utf-8")
    assert "# scara_pd.fmu inputs: q_ref1" in text and "source: ../scara.fmu" in text
    filled(made.files[0], *(f"{c:g}" for joint in zip(CONSTANT, GEAR, strict=True) for c in joint))
    case = load_case(made.files[0])
    assert case.document.plant.source == "../scara.fmu"
    alone = start_case([*files, *fmus], tmp_path / "without").files[0].read_text(encoding="utf-8")
    content = yaml.safe_load(alone)
    assert "robot" not in content and content["identify"] == {"EDIT": {"parameter": "EDIT", "minimum": 0}}
    assert "# ZZ1: {parameter: ZZ1, start: 3.43}  # kg.m2" in alone


@pytest.mark.parametrize(
    ("names", "problem"),
    [
        (["absent.csv"], r"does not exist[\s\S]*absent\.csv"),
        (["notes.docx"], r"no kind that is known[\s\S]*notes\.docx"),
        (["case.yaml"], r"neither a robot"),
        (["scara.yaml"], r"No file with signals"),
    ],
)
def test_files_that_are_none(tmp_path: Path, names: list[str], problem: str) -> None:
    (tmp_path / "notes.docx").write_text("x")
    (tmp_path / "case.yaml").write_text("name: x\n")
    (tmp_path / "scara.yaml").write_text(Path("fmus/scara/robot.yaml").read_text())
    with pytest.raises(InputError, match=problem):
        start_case([tmp_path / name for name in names], tmp_path / "out")


def test_joints_of_a_list_are_those_of_the_robot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By their names; without a robot nobody knows their order, though one name ends with a number."""
    package("rosbags")
    from tests.bags import written

    time = np.arange(0.0, 2.0, 0.01)
    q = {"wrist_1": np.sin(time), "elbow": np.cos(time)}
    written(tmp_path / "run.mcap", time, q, efforts={name: -values for name, values in q.items()})
    robot = ROOT / "fmus/scara/robot.yaml"
    described = yaml.safe_load(robot.read_text(encoding="utf-8"))
    for joint, name in zip(described["joints"], ("elbow", "wrist_1"), strict=True):
        joint["name"] = name
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(described), encoding="utf-8")
    given = [str(tmp_path / name) for name in ("run.mcap", "robot.yaml")]
    assert main(["init", *given, "--out", str(tmp_path / "case")]) == 0
    assert "nothing to be filled in" in capsys.readouterr().out
    assert not (tmp_path / "case/controller.yaml").exists()  # nothing that one was told is there
    case = yaml.safe_load((tmp_path / "case/case.yaml").read_text(encoding="utf-8"))
    assert case["controller"] == {"kind": "tracking"} and "reference" not in case["train"]
    columns = {"tau1": "/joint_states.effort.elbow", "tau2": "/joint_states.effort.wrist_1"}
    assert case["train"]["torque"]["columns"] == columns
    positions = {"q1": "/joint_states.position.elbow", "q2": "/joint_states.position.wrist_1"}
    assert case["train"]["positions"]["columns"] == positions
    assert main(["validate", str(tmp_path / "case/case.yaml")]) == 0
    assert main(["init", *given, "--law", "pd", "--out", str(tmp_path / "known")]) == 0
    assert yaml.safe_load((tmp_path / "known/case.yaml").read_text(encoding="utf-8"))["controller"]["kind"] == "model"
    capsys.readouterr()
    assert main(["init", given[0], "--law", "pd", "--out", str(tmp_path / "without")]) == 0
    told = capsys.readouterr().out
    assert "of joint" not in told and "train.torque.columns.tau2 (which of" in told


def test_a_log_with_measured_positions_is_offered_a_virtual_controller(tmp_path: Path) -> None:
    """As a comment, which makes a case once it is taken; none where a controller is given or nothing is measured."""
    motion, time, torque = scara()
    q = np.array([np.interp(time, motion.time, motion.column(name)) for name in ("q1", "q2")])
    table = np.column_stack([time, q.T, q.T, torque])
    for name, columns in {"both": "q1_set,q2_set,q1_meas,q2_meas", "planned": "q1_set,q2_set,other1,other2"}.items():
        text = "\n".join(",".join(f"{value:.9g}" for value in row) for row in table)
        (tmp_path / f"{name}.csv").write_text(f"t,{columns},tau1,tau2\n{text}\n", encoding="utf-8")
        start_case([tmp_path / f"{name}.csv"], tmp_path / name)
    offered = (tmp_path / "both/case.yaml").read_text(encoding="utf-8")
    assert "kind: tracking" not in (tmp_path / "planned/case.yaml").read_text(encoding="utf-8")
    controller = ROOT / "controllers/scara_pd.yaml"
    start_case([tmp_path / "both.csv", controller], tmp_path / "known")
    assert "kind: tracking" not in (tmp_path / "known/case.yaml").read_text(encoding="utf-8")
    taken = yaml.safe_load(re.sub(r"# positions:", "positions:", offered))
    assert taken["train"]["positions"] == {"file": "../both.csv", "columns": {"q1": "q1_meas", "q2": "q2_meas"}}
    taken |= {"controller": {"kind": "tracking"}}
    taken.pop("loop")
    taken["train"].pop("reference")
    CaseDocument.model_validate(taken)
