"""Long logs, of which a part is judged: the answer is that of all samples, and what is wrong is told wherever it is."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import Log, identify
from fmu_didim.base.diagnostics import DiagnosedError
from fmu_didim.case import load_case
from fmu_didim.checks.all_samples import with_all_samples
from fmu_didim.data.signals import Array
from fmu_didim.estimators import long_logs
from fmu_didim.model import stretches
from fmu_didim.workflow.output.result import Result
from tests.tools.benchmarks.growth import NOISE, RATE_HZ, Size, motion, robot, write_case

SAMPLES, LONG, PART = 20_000, 5000, 4800
"""Of a log of ten periods of ten seconds, of which two are judged: the first and the last one."""
BETWEEN = (0.31, 0.37)
"""[1] A part of a log that lies between the stretches that are judged, whatever its length."""
STRIBECK = {"Fs": 0.1, "vs": 0.1}
"""Of the second joint, whose Coulomb friction is 1 N.m."""


@dataclass(frozen=True)
class Data:
    """Logs without noise of one motion: the case, and the torque (N, 2) with other parameters of joint 2."""

    case: Path
    samples: int

    @property
    def time(self) -> Array:
        return np.arange(self.samples) / RATE_HZ

    @cache  # noqa: B019  # as long as the module
    def torque(self, *changes: tuple[str, float]) -> Array:
        arm = robot(2)
        joint = arm["joints"][1]
        joint["effects"] = [*joint["effects"], *(["stribeck"] if "Fs" in dict(changes) else [])]
        joint["parameters"] = {**joint["parameters"], **dict(changes)}
        path = self.case.parent / f"robot_{len(list(self.case.parent.iterdir()))}.yaml"
        path.write_text(yaml.safe_dump(arm), encoding="utf-8")
        model = load_case(self.case).with_(robot=str(path)).model
        recording = model.simulation(model.start).record(all_ticks=True)
        return np.column_stack([recording.inputs[f"plant.tau{j}"][: self.samples] for j in (1, 2)])

    @property
    def between(self) -> slice:
        return slice(*(int(share * self.samples) for share in BETWEEN))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], Data]:
    """For a number of samples."""

    @cache
    def of(samples: int) -> Data:
        path = write_case(tmp_path_factory.mktemp("arm"), Size(samples=1000))
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        content["experiments"]["run_1"]["reference"] = motion(Size(samples=samples), 1).model_dump(mode="json")
        path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        return Data(path, samples)

    return of


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stretches, "LONG", LONG)
    monkeypatch.setattr(stretches, "PART", PART)


def noisy(data: Data, torque: Array) -> Array:
    noise = np.random.default_rng(3).normal(size=torque.shape)
    return np.asarray(torque + NOISE * data.torque().std(axis=0) * noise)


def offset(data: Data) -> tuple[Array, Array]:
    return data.time, noisy(data, data.torque() + np.array([0.0, 0.1]))


def late(data: Data) -> tuple[Array, Array]:
    """By six milliseconds."""
    return data.time[:-2] + 0.006, noisy(data, data.torque())[:-2]


def stribeck(data: Data) -> tuple[Array, Array]:
    return data.time, noisy(data, data.torque(*STRIBECK.items()))


def outliers(data: Data) -> tuple[Array, Array]:
    """Only where nothing is judged."""
    torque = noisy(data, data.torque())
    torque[data.between][:: (data.between.stop - data.between.start) // 20, 0] += 4.0
    return data.time, torque


def changes(data: Data) -> tuple[Array, Array]:
    """Coulomb friction of joint 2, by a tenth, where nothing is judged."""
    torque = data.torque().copy()
    torque[data.between] = data.torque(("Fc", 1.1))[data.between]
    return data.time, noisy(data, torque)


def drifts(data: Data) -> tuple[Array, Array]:
    """The same by three per cent, half-way."""
    half = np.arange(data.samples)[:, None] >= 0.53 * data.samples
    return data.time, noisy(data, np.where(half, data.torque(("Fc", 1.03)), data.torque()))


def shaken(data: Data) -> tuple[Array, Array]:
    """Where nothing is judged, by three times the noise."""
    torque = noisy(data, data.torque())
    torque[data.between, 1] += 3 * NOISE * torque[:, 1].std() * np.sin(2 * np.pi * 1.7 * data.time[data.between])
    return data.time, torque


WRONG: Mapping[str, tuple[Callable[[Data], tuple[Array, Array]], str]] = {
    "offset": (offset, "residual-depends-on-motion"), "late": (late, "clock-late"),
    "stribeck": (stribeck, "residual-depends-on-motion"), "outliers": (outliers, "log-outliers"),
    "changes": (changes, "log-changes"), "drifts": (drifts, "residual-depends-on-motion"),
}  # fmt: skip
"""What is wrong -> the log, and the code that tells it."""


def identified(data: Data, log: tuple[Array, Array]) -> Result:
    return identify(data.case, log=Log(*log))


@pytest.mark.gate
def test_the_answer_is_that_of_all_samples(data: Any, short: None, monkeypatch: pytest.MonkeyPatch) -> None:
    own = data(SAMPLES)
    log = own.time, noisy(own, own.torque())
    parted = identified(own, log)
    assert parted.document.verdict == "valid"
    assert [text for text in parted.document.remarks if "in 2 stretches" in text and f"Of {SAMPLES} samples" in text]
    monkeypatch.setattr(stretches, "LONG", SAMPLES)
    whole = identified(own, log)
    assert whole.estimate.all_samples is None and parted.estimate.all_samples is not None
    sigma = whole.estimate.standard_deviation
    apart = np.abs(parted.estimate.value - whole.estimate.value) / sigma
    assert apart.max() < 0.05  # by the steps of the integration, which the part has chosen
    np.testing.assert_allclose(parted.estimate.standard_deviation, sigma, rtol=0.02)
    part = parted.estimate.all_samples.deviation_of_part
    assert (part > 1.5 * sigma).all()  # which have fewer samples
    np.testing.assert_allclose(parted.estimate.measured, whole.estimate.measured)
    np.testing.assert_allclose(parted.estimate.simulated, whole.estimate.simulated, atol=1e-3)


@pytest.mark.gate
@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_told(what: str, data: Any, short: None) -> None:
    log, code = WRONG[what]
    found = identified(own := data(SAMPLES), log(own))
    assert found.document.verdict == "doubtful"
    assert code in [reason.code for reason in found.document.reasons]
    assert [text for text in found.document.remarks if "stretches were looked at" in text]


@pytest.mark.gate
def test_outliers_of_a_held_out_log_move_no_value(data: Any, short: None) -> None:
    found = identified(own := data(SAMPLES), outliers(own))
    estimate, validations = found.estimate, found.validations
    for role, code in (("estimation", "log-outliers"), ("validation", "few-outliers")):
        told = with_all_samples(estimate, [replace(v, role=role) for v in validations], [])  # type: ignore[arg-type]
        assert [d.code.name for d in told if "outliers" in d.code.name] == [code]


@pytest.mark.gate
def test_a_residual_that_is_larger_in_the_rest_is_told(data: Any, short: None) -> None:
    found = identified(own := data(SAMPLES), shaken(own))
    (told,) = [reason for reason in found.document.reasons if reason.code == "residual-larger-in-rest"]
    assert told.place == "run_1: joint 2" and told.value is not None and 1.3 < told.value < 3
    begin, end = (float(word) for word in re.findall(r"(\d+(?:\.\d+)?) s", told.text)[:2])
    assert begin < BETWEEN[1] * own.time[-1] and end > BETWEEN[0] * own.time[-1]


@pytest.mark.gate
def test_a_log_that_stands_still_in_the_rest_is_refused(data: Any, short: None, tmp_path: Path) -> None:
    own = data(SAMPLES)
    torque = noisy(own, own.torque())
    torque[own.between, 1] = 0.3
    with pytest.raises(DiagnosedError) as caught:
        identify(own.case, log=Log(own.time, torque), out=tmp_path)
    assert caught.value.found[0].code.name == "log-constant"
    assert '"verdict": "refused"' in (tmp_path / "result.json").read_text(encoding="utf-8")


@pytest.mark.gate
def test_a_part_that_is_none_of_these_logs_gives_way_to_all(
    data: Any, short: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where a loop remembers a seam for long."""
    monkeypatch.setattr(long_logs, "SEAM", -1.0)
    own = data(SAMPLES)
    found = identified(own, (own.time, noisy(own, own.torque())))
    assert found.document.verdict == "valid" and found.estimate.all_samples is None
    assert found.estimate.fit is not None and found.estimate.fit.residual.shape == (SAMPLES, 2)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [100_000, 1_000_000])
@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_told_in_long_logs(what: str, samples: int, data: Any) -> None:
    log, code = WRONG[what]
    found = identified(own := data(samples), log(own))
    assert found.document.verdict == "doubtful"
    assert code in [reason.code for reason in found.document.reasons]
    assert found.estimate.all_samples is not None and found.estimate.measured.shape[0] > 0.99 * samples


@pytest.mark.slow
@pytest.mark.parametrize("samples", [100_000, 1_000_000])
def test_nothing_is_told_where_nothing_is_wrong(samples: int, data: Any) -> None:
    own = data(samples)
    found = identified(own, (own.time, noisy(own, own.torque())))
    assert found.document.verdict == "valid" and found.estimate.all_samples is not None
    truth = {"Fv1": 2.0, "Fc1": 1.0, "Fv2": 2.0, "Fc2": 1.0, "MX2": 0.05, "MY2": 0.02}
    table = found.to_frame()
    for name, value in truth.items():
        assert abs(table["value"][name] - value) < 4 * table["std"][name], name
