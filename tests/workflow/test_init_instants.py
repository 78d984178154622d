"""What `init` writes of the time of the loop: instants of the controller, and a motion that does not begin at rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import identify
from fmu_didim.base.documents import TO_FILL_IN
from fmu_didim.base.errors import InputError
from fmu_didim.case import load_case
from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.cli.main import main
from fmu_didim.data.signals import Array
from fmu_didim.workflow.init import start_case
from tests.case.test_instants import LONG_S, STEP, case, logged, slowing
from tests.cases import TRUTH
from tests.conftest import ROOT

FILES = [ROOT / "fmus/scara/robot.yaml", ROOT / "controllers/scara_pd.yaml"]


def write(path: Path, **columns: Array) -> Path:
    """A CSV file."""
    np.savetxt(path, np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments="")
    return path


def reference(folder: Path, *, rest: bool = False) -> Path:
    """The motion of the SCARA, a row a nominal control period; at rest: with a second in front in which it stands."""
    motion = case().reference("estimation")
    q = motion.select(["q1", "q2"])
    if rest:
        q = q[0] + np.clip(motion.time - 1, 0, 1)[:, None] ** 3 * (q - q[0])
    return write(folder / "run_soll.csv", t=motion.time, q1=q[:, 0], q2=q[:, 1])


def every(step: int) -> tuple[Array, Array]:
    """Instants and torques of the log of the loop that slows down, one row out of some."""
    log = logged()
    return np.asarray(log.time)[::step], np.asarray(log.torque)[::step]


def torque(folder: Path, step: int = 1, **further: Array) -> Path:
    time, found = every(step)
    return write(folder / "run_torque.csv", t=time, tau1=found[:, 0], tau2=found[:, 1], **further)


def made(folder: Path, *files: Path) -> tuple[str, dict[str, object]]:
    """Text and content of the case that is written for these files."""
    start_case([*files, *FILES], folder / "case")
    text = (folder / "case/case.yaml").read_text(encoding="utf-8")
    content = yaml.safe_load(text)
    assert TO_FILL_IN not in str(content)
    return text, content["train"]


@pytest.mark.gate
def test_a_folder_of_a_loop_that_slows_down_gives_the_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two files as a control loop writes them, the robot and its controller: nothing is to be filled in."""
    files = [reference(tmp_path), torque(tmp_path), *FILES]
    path = tmp_path / "case/case.yaml"
    assert main(["init", *map(str, files), "--out", str(path.parent)]) == 0
    assert main(["validate", str(path)]) == 0, capsys.readouterr().out
    loaded = load_case(path).with_(train={"torque": {"rate_hz": 50}})
    assert {d.code.name for d in data_diagnostics(loaded.model)} == {"control-instants", "reference-derived"}
    found = identify(loaded)
    off = np.abs(np.array([*found.values.values()]) - TRUTH) / [found.parameters[name].std for name in found.values]
    assert off.max() < 4
    assert found.verdict == "valid"


def test_a_log_whose_period_changes_is_named(tmp_path: Path) -> None:
    text, run = made(tmp_path, reference(tmp_path), torque(tmp_path))
    assert run["instants"] == "../run_torque.csv"
    assert "its rows come at a period that changes from 5" in text
    assert "warm_up_s" not in text  # which instants exclude
    assert load_case(tmp_path / "case/case.yaml").model.experiments["estimation"].operator.instants is not None


def test_a_loop_log_beside_a_slower_log_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file of instants alone is no run of its own."""
    files = [reference(tmp_path), torque(tmp_path, 4), write(tmp_path / "run_loop.csv", t=slowing())]
    _, run = made(tmp_path, *files)
    assert run["instants"] == "../run_loop.csv"
    (label,) = load_case(tmp_path / "case/case.yaml").model.experiments
    assert label == "estimation"
    assert main(["init", *map(str, [*files, *FILES]), "--out", str(tmp_path / "again")]) == 0
    assert "instants of the controller" in capsys.readouterr().out


def test_a_column_of_instants_is_named(tmp_path: Path) -> None:
    """A log stamped by the logger, with the time of the controller in a column of its own."""
    time, found = every(1)
    stamps = STEP * np.arange(time.size)
    log = write(tmp_path / "run_torque.csv", t=stamps, loop_time=time, tau1=found[:, 0], tau2=found[:, 1])
    _, run = made(tmp_path, reference(tmp_path), log)
    assert run["instants"] == {"file": "../run_torque.csv", "time": {"name": "loop_time"}}


def test_a_reference_at_the_instants_of_the_loop_is_named_with_its_shortest_period(tmp_path: Path) -> None:
    motion, at = case().reference("estimation"), slowing()
    columns = {name: np.interp(at, motion.time, motion.column(name)) for name in ("q1", "q2")}
    path = write(tmp_path / "run_soll.csv", t=at, **columns)
    start_case([path, torque(tmp_path, 4), FILES[0]], tmp_path / "case", law="pd")
    content = yaml.safe_load((tmp_path / "case/case.yaml").read_text(encoding="utf-8"))
    assert content["train"]["instants"] == "../run_soll.csv"
    law = yaml.safe_load((tmp_path / "case/controller.yaml").read_text(encoding="utf-8"))
    assert law["rate_hz"] == pytest.approx(1 / STEP, rel=0.02)  # not the usual rate, at which it runs late


def test_what_may_be_another_clock_is_left_to_the_user(tmp_path: Path) -> None:
    text, run = made(tmp_path, reference(tmp_path), torque(tmp_path, 4))
    assert "instants" not in run
    assert "# instants: ../run_torque.csv  # if the control loop writes that file" in text


def test_a_constant_period_needs_no_instants(tmp_path: Path) -> None:
    time = STEP * np.arange(int(LONG_S / STEP))
    counter = np.arange(time.size, dtype=float)  # increases, but is no time
    log = write(tmp_path / "run_torque.csv", t=time, cycle=counter, tau1=np.sin(time), tau2=np.cos(time))
    text, run = made(tmp_path, reference(tmp_path), log)
    assert "instants" not in text
    assert "instants" not in run


@pytest.mark.parametrize("rest", [False, True])
def test_a_hint_stands_where_the_reference_moves_in_its_first_row(tmp_path: Path, rest: bool) -> None:
    text, run = made(tmp_path, reference(tmp_path, rest=rest), torque(tmp_path, 4))
    assert ("# initial_state: reference" in text) is not rest
    assert "initial_state" not in run  # a hint, no choice


def test_a_loop_log_alone_is_no_data(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No file with signals"):
        start_case([write(tmp_path / "run_loop.csv", t=slowing()), *FILES], tmp_path / "case")
