"""Several references and logs: which belong together, per cent of rated torque, stamps under other names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import identify, simulate
from fmu_didim.base.errors import InputError
from fmu_didim.case import load_case
from fmu_didim.cli.main import main
from fmu_didim.data.tables import Column, read_table
from fmu_didim.data.tables.clock import clock_column, stamp_columns
from fmu_didim.data.tables.columns import TimeColumn, conversion, target
from fmu_didim.workflow.init import start_case
from tests.cases import SCARA
from tests.conftest import ROOT
from tests.workflow.test_init import GEAR, GEOMETRY, comma, filled

RATED = (0.2, 0.4)
"""[N.m] Of the motors."""
TRUTH = yaml.safe_load((ROOT / "fmus/scara/robot.yaml").read_text(encoding="utf-8"))
JOINTS = TRUTH["joints"]
VALUES = {name: JOINTS[int(own[-1]) - 1]["parameters"][own[:-1]] for name, own in TRUTH["identified"].items()}


def written(path: Path, header: str, *rows: str) -> Path:
    path.write_text("\n".join([header, *(rows or ("0,0,0", "0.01,1,1", "0.02,2,2"))]) + "\n", encoding="utf-8")
    return path


def files(folder: Path, *names: str) -> list[Path]:
    """References begin with soll, logs with anything else."""
    motion, torque = "t,q1 soll [rad],q2 soll [rad]", "t,tau1 [Nm],tau2 [Nm]"
    return [written(folder / f"{name}.csv", motion if "soll" in name else torque) for name in names]


def pairs(folder: Path, made: list[Path]) -> dict[str, str]:
    """Log -> reference of the case that init writes."""
    found = start_case(made, folder / "out")
    content = yaml.safe_load(found.files[0].read_text(encoding="utf-8"))
    runs = content.get("experiments") or {k: content[k] for k in ("train", "validation") if k in content}
    return {Path(r["torque"]["file"]).stem: Path(r["reference"]["file"]).stem for r in runs.values()}


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["soll_a", "soll_b", "mess_1", "mess_2"], {"mess_1": "soll_a", "mess_2": "soll_b"}),
        (["soll_a", "soll_b", "mess_2", "mess_1"], {"mess_2": "soll_a", "mess_1": "soll_b"}),
        (["soll_slow", "soll_fast", "run_fast", "run_slow"], {"run_fast": "soll_fast", "run_slow": "soll_slow"}),
        (["soll_1", "soll_2", "messung_002", "messung_001"], {"messung_002": "soll_2", "messung_001": "soll_1"}),
        (["soll", "mess_1", "mess_2"], {"mess_1": "soll", "mess_2": "soll"}),
        (["soll_x", "mess_1", "mess_2", "mess_3"], {f"mess_{i}": "soll_x" for i in (1, 2, 3)}),
        (["a_soll", "a_moment", "b_soll", "b_moment"], {"a_moment": "a_soll", "b_moment": "b_soll"}),
        (["soll_a", "soll_b", "mess_a", "mess_7"], {"mess_a": "soll_a", "mess_7": "soll_b"}),
    ],
)
def test_each_log_gets_the_reference_that_is_its_own(
    names: list[str], expected: dict[str, str], tmp_path: Path
) -> None:
    assert pairs(tmp_path, files(tmp_path, *names)) == expected


def test_the_pairs_are_printed_and_a_guess_is_marked_in_the_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = files(tmp_path, "soll_a", "soll_b", "mess_1", "mess_2")
    assert main(["init", *map(str, made), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "a run, with the reference soll_a.csv: in the order of the files" in told
    assert "held out, with the reference soll_b.csv: in the order of the files" in told
    text = (tmp_path / "out/case.yaml").read_text(encoding="utf-8")
    assert text.count("nothing but the order of the files says") == 2
    start_case(files(tmp_path, "a_soll", "a_moment"), tmp_path / "sure")
    assert "order of the files" not in (tmp_path / "sure/case.yaml").read_text(encoding="utf-8")


@pytest.mark.parametrize("names", [["soll_a", "soll_b", "mess_1"], ["soll_a", "soll_b", "mess_1", "mess_2", "mess_3"]])
def test_references_that_do_not_go_round_are_refused(names: list[str], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"Which reference belongs to which log[\s\S]*next: "):
        start_case(files(tmp_path, *names), tmp_path / "out")


# ---- stamps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("header", "clock"),
    [
        ("Zeitstempel [ms],a,b", "Zeitstempel [ms]"),
        ("a,timestamp (us),b", "timestamp (us)"),
        ("Time stamp [s],a,b", "Time stamp [s]"),
        ("t,Zeitstempel [ms],b", "t"),
        ("Zeitstempel,a,b", None),  # of an unknown unit
        ("cycle time [ms],a,b", None),
        ("Rechenzeit [us],a,b", None),
        ("Zeit A [ms],Zeit B [ms],b", None),
        ("Zeitstempel [Nm],a,b", None),
    ],
)
def test_stamps_by_name_and_unit(header: str, clock: str | None, tmp_path: Path) -> None:
    table = read_table(written(tmp_path / "a.csv", header, "1,1,5", "2,2,3", "3,3,4"))
    try:
        assert clock_column(table, TimeColumn(), ()) == clock
    except InputError:
        assert clock is None


def test_a_duration_that_does_not_grow_is_no_time(tmp_path: Path) -> None:
    assert not stamp_columns(read_table(written(tmp_path / "a.csv", "time of run [ms],a", "1,1", "1,2", "3,3")))


def test_what_is_asked_of_the_time_does_not_contradict_the_file(tmp_path: Path) -> None:
    rows = ("1,0,0", "2,1,1", "3,2,2")
    reference = written(tmp_path / "soll.csv", "Zeitstempel,q1 soll [rad],q2 soll [rad]", *rows)
    torque = written(tmp_path / "mess.csv", "x,tau1 [Nm],tau2 [Nm]", *rows)
    made = start_case([reference, torque], tmp_path / "out")
    text = made.files[0].read_text(encoding="utf-8")
    assert "time: {name: Zeitstempel, unit: EDIT}  # s, ms, us, ns: the file does not say" in text
    assert "time: {name: EDIT, unit: s}  # no column is known as the time" in text
    both = written(tmp_path / "b.csv", "t,q1 soll [rad],tau1 a [Nm],tau1 b [Nm]", "0,0,0,0", "1,1,1,1")
    text = start_case([both], tmp_path / "two").files[0].read_text(encoding="utf-8")
    assert "tau1: EDIT  # which of tau1 a [Nm], tau1 b [Nm]" in text


# ---- per cent --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("column", "stated", "factor"),
    [
        ({"unit": "%", "rated": 40}, "", 0.4),
        ({"unit": "‰", "rated": 40}, "", 0.04),
        ({"unit": "1", "rated": 40}, "", 40.0),
        ({"rated": 40}, "%", 0.4),
        ({"rated": 2, "gear_ratio": 50, "sign": -1}, "%", -1.0),
        ({"rated": 8, "torque_constant": 0.5, "gear_ratio": 10}, "%", 0.4),
    ],
)
def test_per_cent_of_a_rated_torque(column: dict[str, Any], stated: str, factor: float) -> None:
    made = conversion("tau1", Column(name="a", **column), stated, target("tau1", ("N.m",)), where="a.csv")
    assert made.factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    ("signal", "column", "stated", "told"),
    [
        ("tau1", {"unit": "%"}, "", "rated: 40"),
        ("tau1", {}, "%", "rated: 40"),
        ("tau1", {"rated": 40}, "", "got:   no unit"),
        ("tau1", {"rated": 40, "unit": "Nm"}, "", "needs per cent"),
        ("q1", {"rated": 40, "unit": "%"}, "", "Only a torque"),
        ("tau1", {"scale": -1e-300}, "Nm", "multiplied by a number that no unit"),
        ("q1", {"scale": 1e40}, "rad", "multiplied by a number that no unit"),
    ],
)
def test_per_cent_that_is_not_clear_is_refused(signal: str, column: dict[str, Any], stated: str, told: str) -> None:
    with pytest.raises(InputError) as caught:
        conversion(signal, Column(name="a", **column), stated, target(signal, ("N.m",)), where="a.csv")
    assert told in str(caught.value)


def german(folder: Path) -> list[Path]:
    """Two runs of the SCARA: per cent of the rated torque of the motors, stamps in ms, commas, other words."""
    case, made, rng = load_case(SCARA), [], np.random.default_rng(1)
    joints = [{**joint, "parameters": {k: v for k, v in joint["parameters"].items() if k != "v0"}} for joint in JOINTS]
    case = case.with_(robot={**TRUTH, "joints": joints})  # with the smoothing of friction that init takes, too
    for number, label in enumerate(("estimation", "validation"), start=1):
        run = case.model.experiments[label]
        q = np.degrees(run.reference.select(["q1", "q2"]))
        table = simulate(case, experiment=label, parameters=VALUES)
        torque = table.select(["tau1", "tau2"])[::2]
        torque = torque + 0.02 * np.std(torque, axis=0) * rng.standard_normal(torque.shape)
        time, parts = table.time[::2], 100 * torque / (np.array(GEAR) * RATED)
        tables = {
            f"bahn_soll_{'xy'[number - 1]}.csv": (
                "Zeitstempel [ms];Achse1 Soll [°];Achse2 Soll [°]", np.column_stack([1000 * run.reference.time, q]),
            ),
            f"messung_00{number}.csv": (
                "Zeitstempel [ms];Moment Achse1 [%];Moment Achse2 [%]", np.column_stack([1000 * time, parts]),
            ),
        }  # fmt: skip
        for name, (header, table) in tables.items():
            (folder / name).write_bytes(f"{header}\n{comma(table)}\n".encode("cp1252"))
            made.append(folder / name)
    return made


@pytest.mark.gate
def test_own_data_in_per_cent_are_valid_with_eight_lines_edited(tmp_path: Path) -> None:
    made = start_case(sorted(german(tmp_path)), tmp_path / "out", law="pd")
    before = {path: path.read_text(encoding="utf-8").splitlines() for path in made.files}
    case, robot, controller = made.files
    filled(case, *[f"{value:g}" for joint in zip(RATED, GEAR, strict=True) for value in joint])
    filled(robot, *GEOMETRY)
    filled(controller, "3700", "62", "230", "4")
    edited = sum(
        old != new
        for path, lines in before.items()
        for old, new in zip(lines, path.read_text(encoding="utf-8").splitlines(), strict=True)
    )
    assert edited <= 8
    assert main(["validate", str(case)]) == 0
    result = identify(load_case(case))
    assert result.verdict == "valid", result.document.reasons
    for name, value in VALUES.items():
        found = result.document.parameters[name]
        assert abs(found.value - value) < 4 * found.std, name
