"""Each verb of the command line, once, on small cases."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import __version__
from fmu_didim import identify as identify_case
from fmu_didim.base.cache import KINDS
from fmu_didim.case import load_case
from fmu_didim.cli.main import command_parser, main
from fmu_didim.data.tables import read_trajectory
from fmu_didim.workflow.output.exit_codes import CHANGED_EXIT
from tests.discovery.helpers import arm_case
from tests.helpers import ROOT
from tests.workflow.naming.machine import HIDDEN, logged, written

pytestmark = pytest.mark.smoke
SCARA = "examples/scara/identify.yaml"
CAMPAIGN = {
    "name": "small", "case": str(ROOT / "examples/scara/identify_200hz.yaml"), "seeds": 1, "noise": {"relative": 0.05},
    "vary": {"train.torque.rate_hz": [20, 10]},
}  # fmt: skip


@dataclass(frozen=True)
class Made:
    """What verbs make that others read; each is made when it is first asked for."""

    folder: Path

    def run(self, *arguments: object, code: int = 0) -> None:
        assert main([str(argument) for argument in arguments]) == code

    @cached_property
    def result(self) -> Path:
        out = self.folder / "identified"
        self.run("identify", SCARA, "--out", out, "--figures")
        return out

    @cached_property
    def fmu(self) -> Path:
        self.run("export", "fmus/scara/robot.yaml", "--out", self.folder)
        return self.folder / "scara.fmu"

    @cached_property
    def campaign(self) -> Path:
        file, out = self.folder / "campaign.yaml", self.folder / "runs"
        file.write_text(yaml.safe_dump(CAMPAIGN), encoding="utf-8")
        self.run("campaign", "run", file, "--out", out, "--workers", 1)
        return out


Say = Callable[[], str]
"""What has been printed since the last call."""


def example(made: Made, printed: Say) -> None:
    made.run("example")
    assert "scara" in printed()
    made.run("example", "scara", made.folder / "scara")
    made.run("validate", made.folder / "scara" / "identify.yaml")


def init(made: Made, printed: Say) -> None:
    made.run("init", "examples/scara/train_10hz.csv", "--out", made.folder / "new", "--law", "pd")
    assert "torque of joint 2" in printed()
    assert yaml.safe_load((made.folder / "new" / "case.yaml").read_text(encoding="utf-8"))["schema"] == 1


def validate(made: Made, printed: Say) -> None:
    made.run("validate", SCARA)
    assert "No mistakes" in printed()


def robot(made: Made, printed: Say) -> None:
    made.run("robot", "fmus/scara/robot.yaml")
    assert "base parameters: " in printed()


def effects(made: Made, printed: Say) -> None:
    made.run("effects")
    assert "stribeck" in printed()
    made.run("effects", "stribeck")
    assert "Fs" in printed()


def schema(made: Made, printed: Say) -> None:
    for kind in ("case", "campaign"):
        made.run("schema", kind)
        assert json.loads(printed())["type"] == "object"


def completion(made: Made, printed: Say) -> None:
    made.run("completion", "bash")
    assert "identify" in printed()


def identify(made: Made, printed: Say) -> None:
    document = json.loads((made.result / "result.json").read_text(encoding="utf-8"))
    assert document["verdict"] == "valid"
    low, high = document["parameters"]["ZZ1R"]["interval"]
    assert low < 3.43 < high  # the truth of make_data.py
    assert (made.result / "report.html").stat().st_size > 1e5
    assert {path.suffix for path in made.result.glob("figure_*")} == {".png", ".svg"}


def check(made: Made, printed: Say) -> None:
    made.run("check", SCARA, "--json")
    assert json.loads(printed())["ready"]


def simulate(made: Made, printed: Say) -> None:
    out = made.folder / "loop.csv"
    made.run("simulate", SCARA, "--set", "Fc1=0.5", "--out", out)
    assert read_trajectory(out).time.size == 2001


def discover(made: Made, printed: Say) -> None:
    folder = made.folder / "arm"
    folder.mkdir()
    case = arm_case(folder, {"quadratic_viscous": {"Fq": 0.3}})
    made.run("discover", case, "--out", folder / "out", "--rounds", 1)
    findings = json.loads((folder / "out" / "findings.json").read_text(encoding="utf-8"))["findings"]
    assert [(found["effect"], found["joint"]) for found in findings] == [("quadratic_viscous", 1)]
    assert (folder / "out" / "discovery.html").is_file()


def compare(made: Made, printed: Say) -> None:
    """The logs of the example without and with a payload."""
    case = load_case(SCARA)
    for name, reference in (("empty", case.content["train"]), ("payload", case.content["validation"])):
        log = {"reference": reference["reference"], "torque": {"file": f"{name}_50hz.csv"}}
        identify_case(case.with_(train=log, validation=None), out=made.folder / name)
    found = (made.folder / "empty", made.folder / "payload")
    made.run("compare", *found, "--out", made.folder / "compared", code=CHANGED_EXIT)
    assert "ayload on the last link" in printed()
    assert (made.folder / "compared" / "compare.html").is_file()


def watch(made: Made, printed: Say) -> None:
    """Two logs of the example."""
    case = load_case(SCARA)
    logs, torque = made.folder / "logs", np.loadtxt(case.folder / "empty_50hz.csv", delimiter=",", skiprows=1)
    logs.mkdir()
    for day in (1, 2):
        own = torque.copy()
        own[:, 1:] += [0.17, 0.0065] * np.random.default_rng(day).normal(size=own[:, 1:].shape)
        np.savetxt(logs / f"2024-05-0{day}.csv", own, delimiter=",", header="t,tau1,tau2", comments="")
    made.run("watch", logs, "--case", SCARA, "--reference", 1, "--out", made.folder / "watched", code=4)  # too few
    assert "2024-05-02" in printed()
    assert (made.folder / "watched" / "watch.html").is_file()


def excite(made: Made, printed: Say) -> None:
    limits = made.folder / "limits.yaml"
    limits.write_text("{velocity: [1.5, 2.5], acceleration: [3, 5], torque: [15, 1.2]}\n", encoding="utf-8")
    motion = ("--period", 5, "--periods", 1, "--starts", 1, "--out", made.folder / "motion")
    made.run("excite", SCARA, "--torque-std", "0.17,0.0065", "--limits", limits, *motion)
    assert "Predicted for the simulated loop" in printed()
    assert (made.folder / "motion" / "reference.yaml").is_file()


def name_controller(made: Made, printed: Say) -> None:
    content = logged(made.folder, HIDDEN["cascade"], 3)
    made.run("name-controller", written(made.folder, content), "--out", made.folder / "law")
    assert "Law: P-PI cascade with feed-forward" in printed()
    assert (made.folder / "law" / "named_controller.fmu").is_file()


def export(made: Made, printed: Say) -> None:
    assert made.fmu.is_file()
    made.run("export", "controllers/scara_cascade.yaml", "--fmi", "3.0", "--out", made.folder)
    loop = made.folder / "loop.ssp"
    made.run("export", SCARA, "--ssp", loop, "--result", made.result / "result.json")
    assert loop.is_file()


def fmu_info(made: Made, printed: Say) -> None:
    made.run("fmu", "info", made.fmu)
    assert "scara: FMI 2.0" in printed()


def fmu_check(made: Made, printed: Say) -> None:
    made.run("fmu", "check", made.fmu)
    assert "outputs that follow the inputs at once: ddq1, ddq2" in printed()


def cache_show(made: Made, printed: Say) -> None:
    made.run("cache", "show")
    assert set(KINDS) <= set(printed().split())


def cache_clear(made: Made, printed: Say) -> None:
    made.run("fmu", "check", made.fmu)
    made.run("cache", "clear", made.fmu)
    assert not printed().splitlines()[-1].startswith("0 entries")


def campaign_run(made: Made, printed: Say) -> None:
    assert made.campaign.is_dir()
    assert "2 runs" in printed()


def campaign_status(made: Made, printed: Say) -> None:
    made.campaign, printed()
    made.run("campaign", "status", made.campaign, "--json")
    status = json.loads(printed())
    assert (status["verdicts"]["valid"], status["open"]) == (2, 0)


def campaign_report(made: Made, printed: Say) -> None:
    made.campaign, printed()
    made.run("campaign", "report", made.campaign)
    assert {Path(line).suffix for line in printed().split()} == {".html", ".csv", ".parquet"}


def campaign_retry(made: Made, printed: Say) -> None:
    made.run("campaign", "retry", made.campaign)
    assert "No run has failed." in printed()


def campaign_show(made: Made, printed: Say) -> None:
    made.run("campaign", "show", made.campaign)
    assert "0 runs without an answer" in printed()


VERBS = {
    "example": example, "init": init, "validate": validate, "effects": effects, "schema": schema, "robot": robot,
    "completion": completion,
    "identify": identify, "check": check, "simulate": simulate, "discover": discover, "export": export,
    "excite": excite, "compare": compare, "watch": watch, "name-controller": name_controller,
    "fmu info": fmu_info, "fmu check": fmu_check, "cache show": cache_show, "cache clear": cache_clear,
    "campaign run": campaign_run, "campaign status": campaign_status, "campaign report": campaign_report,
    "campaign retry": campaign_retry, "campaign show": campaign_show,
}  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return Made(tmp_path_factory.mktemp("smoke"))


@pytest.mark.parametrize("verb", VERBS)
def test_verb(verb: str, made: Made, capsys: pytest.CaptureFixture[str]) -> None:
    VERBS[verb](made, lambda: capsys.readouterr().out)


def verbs_of(parser: argparse.ArgumentParser, before: str = "") -> Iterator[str]:
    """All that may be said after ``fmu-didim``, down to the last word."""
    below = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not below:
        yield before
    for action in below:
        for name, sub in action.choices.items():
            yield from verbs_of(sub, f"{before} {name}".strip())


def test_every_verb_is_tried() -> None:
    assert set(VERBS) == set(verbs_of(command_parser()))


def test_the_command_starts_in_a_process_of_its_own(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "fmu_didim.cli.main", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["fmu-didim", __version__]
