"""Controllers that nobody tells are named from their logs, with gains that hold; and nobody is misled."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import InputError, load_case, name_controller, simulate
from fmu_didim.cli.main import main
from fmu_didim.workflow.naming.catalogue import Candidate, candidates
from fmu_didim.workflow.naming.named import Gain, Member, NamedController
from fmu_didim.workflow.naming.verdict import tied
from tests.conftest import ROOT
from tests.workflow.naming.machine import HIDDEN, logged, scara, written

LAW = {"cascade": "P-PI+ff", "pid": "PID", "pd": "PD", "whole": "PID"}


def test_an_interval_spans_those_of_the_same_law_in_the_set() -> None:
    law = candidates(["lag"])[1]
    one = Member(law, (Gain("Kp", 1, 10.0, 1.0, ""),))
    other = Member(law.without("lag"), (Gain("Kp", 1, 20.0, 1.0, ""),))
    another = Member(candidates()[-1], (Gain("Kp", 1, 90.0, 1.0, ""),))
    assert one.beside([]).gains[0].interval == pytest.approx((8.04, 11.96), abs=1e-3)
    assert one.beside([other, another]).gains[0].interval == pytest.approx((8.04, 21.96), abs=1e-3)


@dataclass(frozen=True)
class Fitted:
    """A law as a contest leaves it."""

    candidate: Candidate
    akaike: float
    bic: float


def test_a_simpler_law_stays_in_the_set_where_one_criterion_does_not_exclude_it() -> None:
    """One of many extras looks better by chance: J + 2 (free values) alone would exclude the right law."""
    law = candidates(["lag"])[1]
    best, simple = Fitted(law.with_extra("acceleration"), 0.0, 0.0), Fitted(law, 7.8, 0.1)
    richer, far = Fitted(law.with_extra("filter"), 4.6, 4.6), Fitted(candidates()[-1], 7.8, 7.8)
    assert tied([best, simple, richer, far]) == [best, simple]  # the richer one only adds to the simple one
    assert tied([simple, Fitted(law.with_extra("acceleration"), 0.0, 5.0)]) == [simple]
    assert tied([best, Fitted(law, 7.8, 6.1)]) == [best]


def codes(found: NamedController) -> set[str]:
    return {diagnostic.code.name for diagnostic in found.diagnostics}


def within(found: NamedController, name: str, true: float, joint: int, sigmas: float = 4.0) -> None:
    gain = next(g for g in found.gains if (g.name, g.joint) == (name, joint))
    assert abs(gain.value - true) < sigmas * gain.deviation
    assert gain.deviation < 0.1 * abs(true)


@pytest.mark.gate
@pytest.mark.parametrize("hidden", ["cascade", pytest.param("pid", marks=pytest.mark.slow)])
def test_a_law_is_named_with_its_gains(hidden: str, tmp_path: Path) -> None:
    found = name_controller(logged(tmp_path, HIDDEN[hidden], 1))
    assert found.candidate.law.name == LAW[hidden]
    assert found.ok
    for joint in (1, 2):
        for name in ("Kp", "Ki"):
            within(found, name, HIDDEN[hidden][name][joint - 1], joint)


@pytest.mark.gate
def test_a_law_that_cannot_be_told_apart_is_told_as_a_set(tmp_path: Path) -> None:
    """A lag of 4 ms and half a control period of a difference are nearly the same."""
    found = name_controller(logged(tmp_path, HIDDEN["pd"], 1))
    assert "PD" in found.tied_laws
    assert found.candidate.law.name == "PD"
    assert any("lag of the command" in words for words in found.tied)
    within(found, "Kp", HIDDEN["pd"]["Kp"][0], 1)
    for gain in found.gains:  # whichever of the set it is
        if gain.name in HIDDEN["pd"]:
            low, high = gain.interval
            assert low - gain.deviation < HIDDEN["pd"][gain.name][gain.joint - 1] < high + gain.deviation


@pytest.mark.slow
def test_a_cascade_with_whole_feed_forward_is_told_to_be_a_pid(tmp_path: Path) -> None:
    found = name_controller(logged(tmp_path, HIDDEN["whole"], 1))
    assert set(found.tied_laws) >= {"PID", "P-PI+1"}
    assert "law-same-in-effect" in codes(found)
    ties = [d.text for d in found.diagnostics if d.code.name == "law-tied"]
    assert not any("cascade with whole feed-forward, measured" in text for text in ties)


@pytest.mark.slow
def test_the_description_runs_in_the_case_and_gives_the_measured_torque(tmp_path: Path) -> None:
    content = logged(tmp_path, HIDDEN["cascade"], 2)
    found = name_controller(content, tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "controller.yaml", "law.json", "named_controller.fmu",
    }  # fmt: skip
    quiet = simulate(load_case(logged(tmp_path, HIDDEN["cascade"], 2, noise=0.0), require_torque=False).with_(
        controller={"kind": "fmu", "source": str(tmp_path / "out" / "named_controller.fmu")}
    ))  # fmt: skip
    for name, noise in (("tau1", 0.17), ("tau2", 0.0065)):
        true = simulate(scara().with_(controller={"source": str(tmp_path / "out" / "controller.yaml")})).column(name)
        assert np.std(quiet.column(name) - true) < 0.2 * noise
    saved = json.loads((tmp_path / "out" / "law.json").read_text(encoding="utf-8"))
    assert saved["law"] == found.candidate.law.name
    assert saved["provenance"]["files"]


@pytest.mark.slow
def test_slow_positions_are_fitted_in_the_loop(tmp_path: Path) -> None:
    found = name_controller(logged(tmp_path, HIDDEN["cascade"], 1, every=10))
    assert found.candidate.law.name == "P-PI+ff"
    assert "closed loop" in found.way
    assert found.verdict == "doubtful" and "law-from-slow-positions" in codes(found)
    for joint in (1, 2):
        for name in ("Kv", "Kp", "Ki"):
            within(found, name, HIDDEN["cascade"][name][joint - 1], joint)


@pytest.mark.slow
def test_a_law_outside_the_catalogue_is_not_named_from_slow_positions(tmp_path: Path) -> None:
    content = logged(tmp_path, "controllers/scara_computed_torque.yaml", 1, every=10)
    try:
        found = name_controller(content)
    except InputError as error:
        assert "could be simulated" in error.what
    else:
        assert found.verdict == "refused"


@pytest.mark.gate
def test_a_wrong_robot_does_not_change_the_law_and_is_told(tmp_path: Path) -> None:
    """Friction that the description lacks: the regression does not need it, and the loop cannot confirm."""
    description = yaml.safe_load((ROOT / "fmus/scara/robot.yaml").read_text(encoding="utf-8"))
    for joint in description["joints"]:
        joint["effects"] = [effect for effect in joint["effects"] if effect != "coulomb"]
        joint["parameters"] = {k: v for k, v in joint["parameters"].items() if k not in ("Fc", "v0")}
    description["identified"] = {k: v for k, v in description["identified"].items() if not k.startswith("Fc")}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(description), encoding="utf-8")
    content = logged(tmp_path, HIDDEN["cascade"], 1, robot=str(tmp_path / "robot.yaml"))
    found = name_controller(content)
    assert found.candidate.law.name == "P-PI+ff"
    assert "law-not-confirmed" in codes(found)
    within(found, "Kp", HIDDEN["cascade"]["Kp"][0], 1)


@pytest.mark.slow
def test_a_gain_that_nothing_excites_is_told(tmp_path: Path) -> None:
    """A short log in which joint 2 hardly moves."""
    content = logged(tmp_path, HIDDEN["pid"], 1)
    content["train"] |= {"from_s": 0.0, "to_s": 1.0}
    found = name_controller(content)
    assert found.verdict != "valid"


@pytest.mark.gate
def test_a_law_outside_the_catalogue_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, logged(tmp_path, "controllers/scara_computed_torque.yaml", 1))
    out = tmp_path / "out"
    out.mkdir()
    (out / "controller.yaml").write_text("of an earlier run")
    assert main(["name-controller", str(path), "--out", str(out)]) == 1
    printed = capsys.readouterr().out
    assert "No law is named" in printed
    assert "law-unexplained" in printed
    assert [file.name for file in out.iterdir()] == ["law.json"]
    assert json.loads((out / "law.json").read_text(encoding="utf-8"))["controller"] is None


@pytest.mark.slow
def test_a_torque_log_that_is_late_is_told(tmp_path: Path) -> None:
    """Either as a delay, which it looks like, or as clocks that differ; never as a valid answer."""
    found = name_controller(logged(tmp_path, HIDDEN["cascade"], 1, late=2))
    assert found.verdict != "valid"
    assert codes(found) & {"law-delay-or-clock", "law-clocks-apart"}
    early = name_controller(logged(tmp_path, HIDDEN["cascade"], 1, late=-2))
    assert "law-clocks-apart" in codes(early)
    assert early.verdict == "refused"


@pytest.mark.gate
def test_stamps_that_were_put_right_are_a_doubt(tmp_path: Path) -> None:
    """The log is late by two fifths of a control period then, and gains are off by more than their intervals."""
    content = logged(tmp_path, HIDDEN["cascade"], 1)
    path = tmp_path / "machine.csv"
    header, table = path.read_text(encoding="utf-8").splitlines()[0], np.loadtxt(path, delimiter=",", skiprows=1)
    table[:, 0] += np.random.default_rng(1).uniform(0, 0.004, len(table))
    np.savetxt(path, table, delimiter=",", header=header, comments="")
    for kind in ("torque", "positions"):
        content["train"][kind] |= {"time": {"name": "t", "jittered": True}}
    found = name_controller(content)
    assert found.verdict != "valid"
    assert found.verdict == "refused" or "law-clock-rebuilt" in codes(found)


@pytest.mark.slow
def test_a_rate_that_is_not_known_is_told(tmp_path: Path) -> None:
    found = name_controller(logged(tmp_path, HIDDEN["cascade"], 1, loop={}))
    assert "law-rate-assumed" in codes(found)
    assert found.verdict == "doubtful"


@pytest.mark.slow
def test_gains_that_are_those_of_the_case_times_a_factor_are_told(tmp_path: Path) -> None:
    guessed = {"kind": "model", "source": str(Path("controllers/scara_cascade.yaml").resolve())}
    scaled = {**HIDDEN["cascade"], "Kp": [184, 3.2], "Ki": [720, 12]}
    found = name_controller(logged(tmp_path, scaled, 1, controller=guessed, loop={}))
    assert found.candidate.law.name == "P-PI+ff"
    assert "law-rate-assumed" not in codes(found)


@pytest.mark.gate
def test_a_control_rate_below_that_of_the_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="faster than the controller"):
        name_controller(logged(tmp_path, HIDDEN["cascade"], 1, loop={"rate_hz": 100}))


@pytest.mark.gate
def test_without_positions_it_says_what_to_log(tmp_path: Path) -> None:
    content = logged(tmp_path, HIDDEN["cascade"], 1)
    del content["train"]["positions"]
    with pytest.raises(InputError, match="positions"):
        name_controller(content)


@pytest.mark.slow
@pytest.mark.data
def test_the_law_of_a_measured_machine_is_named_and_doubted() -> None:
    """EMPS: a P-P cascade, kp = 160.18 1/s, kv = 243.45 V/(m/s), 35.15 N/V. The model lacks some of its friction, so
    that the loop confirms nothing; a delay and a filter take a part of each gain, and leave their product."""
    found = name_controller(ROOT / "examples/emps/identify_idim_ls.yaml")
    assert found.candidate.law.name.startswith("P-P+") or found.candidate.law.name == "P-P"
    assert found.verdict == "doubtful" and "law-not-confirmed" in codes(found)
    gains = {gain.name: gain.value for gain in found.gains}
    assert gains["Kv"] * gains["Kp"] == pytest.approx(160.18 * 243.45 * 35.15065188248547, rel=0.02)
