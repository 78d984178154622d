"""What a case says of what was measured beside the torque, and what it gives."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import discover, identify
from fmu_didim.base.errors import InputError
from fmu_didim.case import Case, load_case
from fmu_didim.checks.channels import channel_diagnostics
from fmu_didim.checks.validation import validate_on
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.fit.estimate import Estimate, RefusedError
from fmu_didim.model.loop_model import LoopModel
from tests.helpers import ROOT

CASE = load_case(ROOT / "examples/scara/identify_200hz.yaml").with_(train={"torque": {"rate_hz": 50}}, validation=None)
ENCODER = 1e-4
"""[rad] Noise of the encoders."""


def log_of(
    rate_hz: float = 40.0, *, offset: float = 0.0, scale: float = 1.0, late_s: float = 0.0, seed: int = 0
) -> Trajectory:
    """Positions of the SCARA's truth, by encoders with noise and what else is wrong with them."""
    model = CASE.model
    rng, label = np.random.default_rng(seed), model.first
    run = model.simulation(model.start, label).record(all_ticks=True)
    times = np.arange(0.0021, run.time[-1] - 0.05, 1 / rate_hz)
    columns: dict[str, np.ndarray] = {}
    for j in (1, 2):
        at = np.interp(times - late_s, run.time, run.table([f"plant.q{j}"], sampled=True)[:, 0])
        columns[f"q{j}"] = offset + scale * at + ENCODER * rng.normal(size=times.size)
    return trajectory(times, columns)


@pytest.fixture
def written(tmp_path: Path) -> Path:
    return write(log_of(), tmp_path)


def write(log: Trajectory, folder: Path) -> Path:
    path = folder / "encoders.csv"
    table = np.column_stack([log.time, log.values])
    np.savetxt(path, table, delimiter=",", header=",".join(["t", *log.names]), comments="", fmt="%.12g")
    return path


def with_file(path: Path, **entry: Any) -> Case:
    return CASE.with_(train={"measured": [{"file": str(path), **entry}]}, estimator={"kind": "didim"})


def test_positions_that_the_file_has_by_default(written: Path) -> None:
    experiment = with_file(written).model.experiments["estimation"]
    assert [(c.name, c.signal, c.unit, c.deviation) for c in experiment.channels] == [
        ("q1", "plant.q1", "rad", None), ("q2", "plant.q2", "rad", None)
    ]  # fmt: skip
    assert experiment.channels[0].time[1] - experiment.channels[0].time[0] == pytest.approx(0.025)


def test_signals_rate_noise_and_part_as_stated(written: Path) -> None:
    case = with_file(
        written, columns={"q2": {"name": "q1", "unit": "deg"}}, std={"q2": 0.001}, rate_hz=10, offset_s=0.01
    ).with_(train={"from_s": 2.0, "to_s": 6.0})  # fmt: skip
    (channel,) = case.model.experiments["estimation"].channels
    assert (channel.name, channel.deviation) == ("q2", 0.001)
    assert channel.time[0] >= 2.0 and channel.time[-1] <= 6.0
    assert np.diff(channel.time).min() >= 0.075 and channel.time.size in (40, 41)
    log = log_of()
    at = np.searchsorted(log.time, channel.time - 0.01 - 1e-9)
    np.testing.assert_allclose(channel.values, np.deg2rad(log.column("q1")[at]), rtol=1e-9)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"signals": ["q3"]}, r"output of the plant named 'q3'[\s\S]*valid: q1, q2"),
        ({"signals": ["dq1"]}, "no column named 'dq1'"),
        ({"signals": ["q1"], "std": {"q2": 0.1}}, "std: names q2, which is not among the signals q1"),
        ({"std": {"q1": 0.0}}, "greater than 0"),
        ({"offset_s": 500.0}, r"no samples|reach beyond the reference"),
        ({"rate_hz": 1.0}, r"too few samples[\s\S]*20 or more"),
        ({"columns": {"q1": {"name": "q1", "unit": "Nm"}}}, "unit of q1 is not one of its kind"),
        ({"file": "absent.csv"}, "data file is absent"),
    ],
)
def test_what_is_wrong_is_said(written: Path, entry: Mapping[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        with_file(written, **entry)


def test_a_file_without_positions_and_a_signal_twice_are_refused(tmp_path: Path) -> None:
    log = log_of()
    path = write(trajectory(log.time, {"speed": log.values[:, 0]}), tmp_path)
    with pytest.raises(InputError, match="shows no position"):
        with_file(path)
    twice = [{"file": str(write(log, tmp_path))}] * 2
    with pytest.raises(InputError, match="Two files show the same signal"):
        CASE.with_(train={"measured": twice})


@pytest.mark.parametrize(
    "estimator", [{"kind": "idim_ls"}, {"kind": "output_error"}, {"kind": "didim", "finish": False}]
)
def test_estimators_that_would_not_use_it_say_so(written: Path, estimator: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="does not fit what was measured beside the torque") as caught:
        with_file(written).with_(estimator=estimator)
    assert ("Write positions: in the place of measured:" in caught.value.next_step) == (estimator["kind"] != "didim")


@pytest.mark.gate
def test_the_same_file_as_positions_is_what_output_error_fits(written: Path) -> None:
    """As the refusal says; the instants of the encoders lie between the ticks, where a position is not held."""
    found = identify(CASE.with_(train={"positions": {"file": str(written)}}, estimator={"kind": "output_error"}))
    assert found.verdict == "valid", found.document.reasons
    for name, true in {"ZZ1R": 3.43, "Fc1": 0.82, "ZZ2": 0.063, "MX2": 0.241, "MY2": 0.014, "Fv2": 0.013}.items():
        value = found.parameters[name]
        assert abs(value.value - true) < 3.5 * value.std, name


def test_positions_that_are_early_are_refused_with_what_to_check(tmp_path: Path) -> None:
    """Early by a control period: friction is negative then."""
    case = CASE.with_(
        train={"positions": {"file": str(write(log_of(late_s=-0.005), tmp_path))}}, estimator={"kind": "output_error"}
    )
    with pytest.raises(RefusedError, match="not physical") as caught:
        case.estimator.estimate(case.model)
    assert "clock of the positions" in caught.value.next_step and "start: description" in caught.value.next_step


@pytest.mark.gate
@pytest.mark.parametrize("late_s", [0.0002, 0.002])
def test_positions_that_are_late_are_doubted_by_the_torque(late_s: float, tmp_path: Path) -> None:
    """Viscous friction takes the lateness, so that the positions leave no more than their noise."""
    case = CASE.with_(
        train={"positions": {"file": str(write(log_of(late_s=late_s), tmp_path))}}, estimator={"kind": "output_error"}
    )
    found = identify(case)
    assert found.verdict == "doubtful"
    reason = found.document.reasons[0]
    assert reason.code == "channels-disagree" and "by the torque along that motion" in reason.text
    assert "clocks of torque and positions" in reason.next_step


# ---- what is told of the answer


def estimate_with(tmp_path: Path, log: Trajectory, **entry: Any) -> Estimate:
    case = with_file(write(log, tmp_path), **entry)
    return case.estimator.estimate(case.model)


def test_right_sensors_are_not_doubted(tmp_path: Path) -> None:
    found = estimate_with(tmp_path, log_of(), std={"q1": ENCODER, "q2": ENCODER})
    assert channel_diagnostics(found) == []
    shown = validate_on(found.model, found.value, "estimation").channels
    assert list(shown) == ["q1", "q2"]
    assert [c.rms for c in shown.values()] == pytest.approx([ENCODER] * 2, rel=0.15)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"offset": 0.002}, "q1 shows 0.00[12].* rad more than the simulation"),
        ({"scale": 1.01}, r"q1 moves \+1(\.0)? % more than it"),
        ({"late_s": 0.004}, r"q1 is (4|3\.\d+|4\.\d+) ms later than it"),
        ({"late_s": -0.004}, r"q1 is (4|3\.\d+|4\.\d+) ms earlier than it"),
    ],
)
def test_wrong_sensors_are_told(tmp_path: Path, wrong: dict[str, float], words: str) -> None:
    found = channel_diagnostics(estimate_with(tmp_path, log_of(**wrong)))
    text = " ".join(d.text for d in found if d.code.name == "channel-off")
    assert re.search(words, text), text


def test_more_than_the_stated_noise_is_told(tmp_path: Path) -> None:
    found = channel_diagnostics(estimate_with(tmp_path, log_of(), std={"q1": ENCODER / 4, "q2": ENCODER}))
    (told,) = [d for d in found if d.code.name == "channel-beyond-noise"]
    assert told.place == "q1" and "4" in told.text


def test_a_drive_that_gives_less_than_its_log_says_is_told(tmp_path: Path) -> None:
    case = with_file(write(log_of(), tmp_path))
    model = case.model
    data = model.experiments["estimation"]
    larger = model.with_experiment("estimation", replace(data, torque=1.2 * data.torque))
    (told,) = [d for d in channel_diagnostics(case.estimator.estimate(larger)) if d.code.name == "channels-disagree"]
    assert "by the torque alone" in told.text


def test_result_and_report_show_both_answers(tmp_path: Path) -> None:
    result = identify(with_file(write(log_of(), tmp_path)))
    joint = result.document.joint
    assert joint is not None and set(joint.channels) == {"q1", "q2"}
    assert set(joint.alone.value) == set(result.document.parameters) == set(joint.apart)
    text = result.summary()
    assert "Torque with q1, q2" in text and "torque alone" in text and "σ ratio" in text


def test_discovery_looks_at_all_that_was_measured(written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[LoopModel] = []

    def asked(model: LoopModel, *_: object) -> None:
        seen.append(model)
        raise InterruptedError

    monkeypatch.setattr(sys.modules["fmu_didim.workflow.discover"], "discover_in", asked)
    case = with_file(written)
    with pytest.raises(InterruptedError):
        discover(case)
    assert seen[0].experiments.channels == ("q1", "q2")
