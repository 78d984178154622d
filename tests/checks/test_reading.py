"""FMUs that reading their outputs between inputs and step disturbs, as plant and as controller."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import yaml

from fmu_didim import check, discover, identify
from fmu_didim.case import load_case
from fmu_didim.components.fmu.load import load_fmu
from fmu_didim.components.fmu.reuse import reading as module
from fmu_didim.components.fmu.reuse.reading import find_reading
from fmu_didim.data.signals import Variable, trajectory, write_csv
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu
from tests.awkward.build import awkward_fmu
from tests.campaigns.helpers import sledge_case

H, KP, A = 0.01, 8.0, 3.0
"""Step, gain of the control of the speed, and the true damping of the plant x' = -a x + u."""


def gain(folder: Path) -> Path:
    u, p = ca.SX.sym("u", 2), ca.SX.sym("p")
    law = Block(
        name="gain", inputs=(Variable("dq_ref1", "rad/s", "input", 0.0), Variable("dq1", "rad/s", "input", 0.0)),
        outputs=(Variable("command1", "N.m", "output", 0.0),), states=(), sample_time=H,
        parameters=(Variable("Kp", "1", "parameter", KP),),
        update=ca.Function("update", [ca.SX(0, 1), u, p], [ca.SX(0, 1)]),
        output=ca.Function("output", [ca.SX(0, 1), u, p], [p * (u[0] - u[1])]),
        start=ca.Function("start", [u, p], [ca.SX(0, 1)]),
    )  # fmt: skip
    return build_fmu(law, directory=folder)


def speed_case(folder: Path, fmu: Path, **plant: Any) -> Path:
    """The data of x(k+1) = x(k) + h (u - a x), u = Kp (ref - x): the slave whose outputs nobody reads too early."""
    rng = np.random.default_rng(3)
    document: dict[str, Any] = {
        "schema": 1, "name": "speed", "loop": {"rate_hz": 1 / H},
        "plant": {
            "kind": "fmu", "source": str(fmu), "inputs": {"tau1": "u"}, "outputs": {"dq1": "y"},
            "parameters": {"d": 0.0}, **plant,
        },
        "controller": {"kind": "fmu", "source": str(gain(folder))},
        "identify": {"a": {"minimum": 0.1}}, "estimator": {"kind": "clie"},
    }  # fmt: skip
    time = H * np.arange(1201)
    for label, phase in (("train", 0.0), ("validation", 0.8)):
        reference = sum(np.sin(2 * np.pi * k * time / 4.0 + phase * k) / k for k in (1, 2, 3, 5))
        x, torque = 0.0, np.zeros(time.size)
        for k, wanted in enumerate(reference):
            torque[k] = KP * (wanted - x)
            x += H * (torque[k] - A * x)
        write_csv(trajectory(time, {"dq1": reference}), folder / f"{label}_reference.csv")
        log = torque + 0.01 * rng.normal(size=time.size)
        write_csv(trajectory(time[:-1:2], {"tau1": log[:-1:2]}), folder / f"{label}.csv")
        document[label] = {"reference": {"file": f"{label}_reference.csv"}, "torque": {"file": f"{label}.csv"}}
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return path


def codes(found: Any) -> list[str]:
    return [d.code.name for d in found.diagnostics]


@pytest.mark.gate
def test_outputs_that_reading_disturbs_are_taken_after_each_step(tmp_path: Path) -> None:
    fmu = awkward_fmu(tmp_path, "READING_ACTS")
    case = load_case(speed_case(tmp_path, fmu))
    told = check(case)
    assert "outputs-after-last-step" in codes(told) and "reading-acts" not in codes(told)
    found = identify(case)
    deviation = found.estimate.standard_deviation[0]
    assert abs(found.estimate.value[0] - A) < 3 * deviation
    assert found.verdict == "valid"
    assert any("Its outputs are those after the last step" in remark for remark in found.document.remarks)
    assert case.model.loop.plant.describe()["outputs"] == "those after the last step"


@pytest.mark.gate
def test_the_case_may_overrule_it(tmp_path: Path) -> None:
    fmu = awkward_fmu(tmp_path, "READING_ACTS")
    case = load_case(speed_case(tmp_path, fmu, outputs_after_step=False)).with_(loop={"algebraic_loops": "previous"})
    assert not {"outputs-after-last-step", "reading-acts"} & set(codes(check(case)))
    found = identify(case)
    assert found.verdict == "doubtful"  # each reading moves the plant


@pytest.mark.gate
@pytest.mark.parametrize(("macros", "d"), [((), 0.0), (("READING_ACTS",), 0.5), ((), 0.5)])
def test_others_are_read_as_before(tmp_path: Path, macros: tuple[str, ...], d: float) -> None:
    """That does not act, or whose output follows the inputs at once."""
    path = speed_case(tmp_path, awkward_fmu(tmp_path, *macros), parameters={"d": d})
    case = load_case(path).with_(loop={"algebraic_loops": "previous"})
    assert case.model.loop.plant.reads_between  # type: ignore[attr-defined]
    assert ("reading-acts" in codes(check(case))) == bool(macros)


@pytest.mark.gate
@pytest.mark.parametrize(("stated", "doubted"), [(None, True), (True, False), (False, False)])
def test_a_controller_must_say_when_its_command_holds(tmp_path: Path, stated: bool | None, doubted: bool) -> None:
    entry = {} if stated is None else {"outputs_after_step": stated}
    content = sledge_case(str(awkward_fmu(tmp_path, "READING_ACTS")), **entry)
    time = np.arange(100) / 50
    content["train"]["torque"] = {"file": "log.csv"}
    content["controller"]["parameters"] = {"d": 1.0}
    write_csv(trajectory(time, {"tau1": np.sin(time)}), tmp_path / "log.csv")
    found = {d.code.name: d for d in check(load_case(content, folder=tmp_path)).diagnostics}
    assert ("reading-acts" in found) == doubted
    if doubted:
        assert found["reading-acts"].place == "controller"
        assert "outputs_after_step: true" in found["reading-acts"].advice


@pytest.mark.gate
def test_discover_names_nothing_where_nothing_is_missing(tmp_path: Path) -> None:
    found = discover(speed_case(tmp_path, awkward_fmu(tmp_path, "READING_ACTS")))
    assert (found.document.answer, found.document.findings) == ("nothing", [])


@pytest.mark.gate
def test_discover_names_no_gain_or_delay_while_that_is_open(tmp_path: Path) -> None:
    fmu = awkward_fmu(tmp_path, "READING_ACTS")
    path = speed_case(tmp_path, fmu, parameters={"d": 0.02})
    found = discover(load_case(path).with_(loop={"algebraic_loops": "previous"}), rounds=1)
    assert found.verdict == "doubtful"
    assert "reading-acts" in [reason.code for reason in found.document.reasons]
    forbidden = found.document.provenance["options"]["forbid"]
    assert {"controller_gain", "drive_gain", "delay", "log_time_shift", "encoder_eccentricity"} <= set(forbidden)
    assert not {"coulomb", "spring"} & set(forbidden)
    assert any("drives, sensors and the log were not tried" in note for note in found.document.notes)


def test_a_trial_is_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = load_fmu(awkward_fmu(tmp_path, "READING_ACTS")).with_parameters({"d": 0.125})
    first = find_reading(made, 0.01)
    assert first is not None and first.acts and first.at_once == (0,)
    monkeypatch.setattr(module, "_known", {})
    monkeypatch.delattr(module, "TrialRunner")
    assert find_reading(made, 0.01) == first


def test_without_an_answer_nothing_changes(tmp_path: Path) -> None:
    assert find_reading(load_fmu(awkward_fmu(tmp_path, "ERROR_IN_STEP")), 0.01) is None
