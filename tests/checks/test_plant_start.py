"""A plant that starts elsewhere than its reference."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import casadi as ca
import pytest
import yaml

from fmu_didim.case import load_case
from fmu_didim.checks.plant.start import start_diagnostics
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.export import build_fmu
from tests.cases import ENTRIES, scara_case
from tests.foreign import RATE, exported, foreign_case, one_joint, spring_pendulum

OWN_NAMES = {f"{name}{j}": f"{own}_{j}" for name, own in (("q_start", "origin"), ("dq_start", "speed")) for j in (1, 2)}


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The SCARA as an FMU whose start values have names of its own."""
    block = RobotModel(read_robot("fmus/scara/robot.yaml")).block()
    built = build_fmu(block, directory=tmp_path_factory.mktemp("built"))
    path = tmp_path_factory.mktemp("plant") / "scara.fmu"
    with zipfile.ZipFile(built) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "modelDescription.xml":
                for known, own in OWN_NAMES.items():
                    content = content.replace(f'name="{known}"'.encode(), f'name="{own}"'.encode())
            new.writestr(name, content)
    return path


@pytest.mark.parametrize(
    ("named", "after_step", "expected"),
    [
        (["q_start1", "q_start2", "dq_start1", "dq_start2"], False, []),
        (["q_start1", "q_start2", "dq_start1", "dq_start2"], True, []),
        (["q_start1", "q_start2"], False, ["dq1", "dq2"]),
        (["q_start2", "dq_start1", "dq_start2"], False, ["q1"]),
        (["q_start2", "dq_start1", "dq_start2"], True, ["q1", "q2"]),  # in one step the jump of joint 1 moves joint 2
        ([], False, ["q1", "q2", "dq1", "dq2"]),
    ],
)
def test_start(tmp_path: Path, plant: Path, named: list[str], after_step: bool, expected: list[str]) -> None:
    """The reference starts in motion: after one step it is elsewhere than in its first row."""
    names = {name: OWN_NAMES[name] for name in named}
    path = scara_case(
        tmp_path, identify=ENTRIES, estimator={"kind": "clie"}, loop={"algebraic_loops": "previous"},
        plant={"kind": "fmu", "source": str(plant), "outputs_after_step": after_step, "parameter_names": names},
    )  # fmt: skip
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    del content["robot"], content["estimator"]["start"]
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    found = start_diagnostics(load_case(path).model)
    assert [d.text.partition(" = ")[0].rpartition(" ")[2] for d in found] == expected
    assert {d.code.name for d in found} <= {"plant-start"}


def test_a_given_start_is_no_mistake(tmp_path: Path, plant: Path) -> None:
    path = scara_case(tmp_path, plant={"kind": "fmu", "source": str(plant), "parameter_names": OWN_NAMES})
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["train"]["initial_state"] = {"q1": 0.8}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    model = load_case(path).model
    assert start_diagnostics(model) == []
    assert model.simulation(model.start).record().applied["plant.q1"][0] == 0.8


DEFAULTS = {"m": 1.0, "l": 0.5, "k": 2.0, "d": 0.2}
IDENTIFY = {"m": {"minimum": 0.01}, "k": {}, "d": {}}
NO_STARTS: dict[str, Any] = {"parameter_names": {}}
STARTS = {"parameter_names": {"q_start1": "phi_0", "dq_start1": "w_0"}}


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(tmp_path_factory.mktemp("pendulum"), one_joint("pendulum", DEFAULTS, spring_pendulum))


@pytest.mark.parametrize(("machine", "expected"), [({}, []), (STARTS, ["q1", "dq1"])])
def test_a_log_that_begins_there_decides(
    tmp_path: Path, pendulum: Path, machine: dict[str, Any], expected: list[str]
) -> None:
    """The plant starts at rest at zero, though the reference does not: as the machine did, or not."""
    path = foreign_case(tmp_path, pendulum, pendulum, IDENTIFY, plant_entries={**NO_STARTS, **machine})
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["plant"] |= NO_STARTS
    found = start_diagnostics(load_case(content, folder=tmp_path).model)
    assert [d.text.partition(" = ")[0].rpartition(" ")[2] for d in found] == expected


def test_a_log_that_begins_later_decides_nothing(tmp_path: Path, pendulum: Path) -> None:
    path = foreign_case(tmp_path, pendulum, pendulum, IDENTIFY, plant_entries=NO_STARTS)
    lines = (tmp_path / "train.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "train.csv").write_text("\n".join([lines[0], *lines[2:]]), encoding="utf-8")
    assert len(start_diagnostics(load_case(path).model)) == 2


@pytest.mark.parametrize(("unit", "doubts"), [("V", 0), ("", 0), ("rad", 1)])
def test_a_reference_that_is_no_position_is_not_compared(
    tmp_path: Path, pendulum: Path, unit: str, doubts: int
) -> None:
    """A drive that is fed with a voltage, in the column q1: by its unit, or as the joint does not follow it."""
    u, p = ca.SX.sym("u", 2), ca.SX.sym("p")
    none = ca.SX(0, 1)
    drive = Block(
        name="drive", inputs=(Variable("supply", unit, "input", 0.0), Variable("speed", "rad/s", "input", 0.0)),
        outputs=(Variable("torque", "N.m", "output", 0.0),), states=(), sample_time=1 / RATE,
        parameters=(Variable("k", "1", "parameter", 2.0),),
        update=ca.Function("update", [none, u, p], [none]),
        output=ca.Function("output", [none, u, p], [p * (u[0] - u[1])]),
        start=ca.Function("start", [u, p], [none]),
    )  # fmt: skip
    controller = {
        "kind": "fmu", "source": str(exported(tmp_path / "drive", drive)),
        "inputs": {"q_ref1": "supply", "dq1": "speed"}, "outputs": {"command1": "torque"},
    }  # fmt: skip
    path = foreign_case(tmp_path, pendulum, pendulum, IDENTIFY, plant_entries=NO_STARTS, controller=controller)
    lines = (tmp_path / "train.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "train.csv").write_text("\n".join([lines[0], *lines[2:]]), encoding="utf-8")
    found = start_diagnostics(load_case(path).model)
    assert len([d for d in found if "q1" in d.text and "dq1" not in d.text]) == doubts
