"""A plant that starts elsewhere than its reference."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest
import yaml

from fmu_didim.case import load_case
from fmu_didim.checks.plant import start_diagnostics
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.export import build_fmu
from tests.cases import ENTRIES, scara_case

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
