"""Outliers that a case asks to leave out: what is fitted, what is told, and whether the standard deviations hold."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.case import Case, load_case
from fmu_didim.checks.data.checks import data_diagnostics, without_outliers
from fmu_didim.model.loop_model import LoopModel
from tests.checks.data.right import loaded, right, with_columns, with_log
from tests.checks.data.test_outliers import NOISE, signs, spiked
from tests.helpers import ROOT
from tests.tools.verdict.run import answer, named

ROWS = [12, 31, 50, 77]
"""Of the log, that are wrong."""

ROBOTS = [
    ("scara", 20.0),
    ("arm", 100.0),
    *(pytest.param(*one, marks=pytest.mark.slow) for one in (("scara", 100.0), ("arm", 20.0))),
]
"""And the rate of the log in Hz."""


def spiked_case(folder: Path, outliers: str) -> Case:
    """The SCARA with four wrong samples at joint 1."""
    case = load_case(ROOT / "examples/scara/identify.yaml")
    lines = (case.folder / "train_10hz.csv").read_text(encoding="utf-8").splitlines()
    for row in ROWS:
        cells = lines[1 + row].split(",")
        cells[1] = str(float(cells[1]) + (6.0 if row % 2 else -6.0))
        lines[1 + row] = ",".join(cells)
    (folder / "log.csv").write_text("\n".join(lines), encoding="utf-8")
    torque = {"file": str(folder / "log.csv"), "outliers": outliers}
    return case.with_(plant={"kind": "model"}, controller={"kind": "model"}, train={"torque": torque})


def test_outliers_are_left_out_where_the_case_asks_for_it(tmp_path: Path) -> None:
    kept, left = (identify(spiked_case(tmp_path, way)) for way in ("keep", "leave_out"))
    clean = identify(load_case(ROOT / "examples/scara/identify.yaml"))
    assert kept.document.reasons[0].code == "log-outliers"
    assert [d.code for d in left.document.reasons] == [d.code for d in clean.document.reasons]
    (told,) = [text for text in left.document.remarks if "They are left out." in text]
    assert "4 of 100 samples" in told and "estimation: joint 1" in told
    assert not [text for text in kept.document.remarks if "left out" in text]
    own, others = left.estimate.model.experiments["estimation"], clean.estimate.model.experiments["estimation"]
    np.testing.assert_array_equal(own.time, np.delete(others.time, ROWS))
    sigma = clean.estimate.standard_deviation
    assert np.abs(left.estimate.value - clean.estimate.value).max() < 3 * sigma.max()
    assert (np.abs(left.estimate.value - clean.estimate.value) < sigma).all()


def test_discovery_leaves_them_out_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []

    def stop(model: object, request: object) -> None:
        seen.append(model)
        raise KeyboardInterrupt

    verb = import_module("fmu_didim.workflow.discover")
    monkeypatch.setattr(verb, "discover_in", stop)
    with pytest.raises(KeyboardInterrupt):
        verb.discover(spiked_case(tmp_path, "leave_out"))
    assert seen[0].experiments["estimation"].time.size == 100 - len(ROWS)


def test_nothing_is_left_out_of_a_log_that_no_motion_comes_near_and_that_is_told() -> None:
    model = with_log(right("scara", 1), lambda torque: np.random.default_rng(1).normal(size=torque.shape))
    asked = model.with_experiment("estimation", replace(model.experiments["estimation"], leaves_out_outliers=True))
    same, told = without_outliers(asked, data_diagnostics(asked))
    assert same is asked
    assert "none is left out" in told[-1].text and told[-1].code.name == "outliers-left-out"


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [20.0, 50.0])
def test_the_intervals_of_the_other_samples_hold(rate_hz: float) -> None:
    """100 draws of noise and of 2 % of spikes: 92 to 97 % of the 95 % intervals hold the truth."""
    inside = compared = valid = 0
    for seed in range(100, 200):
        model = spiked(right("scara", seed, rate_hz=rate_hz, noise=NOISE), lambda r, n: 20 * signs(r, n), seed=seed)
        for label in model.experiments:
            model = model.with_experiment(label, replace(model.experiments[label], leaves_out_outliers=True))
        found = answer(without_outliers(model)[0], named(loaded("scara")))
        inside, compared, valid = inside + found.inside, compared + found.compared, valid + (found.verdict == "valid")
    assert 0.92 <= inside / compared <= 0.97
    assert valid >= 95


@pytest.mark.gate
@pytest.mark.parametrize(("robot", "rate_hz"), ROBOTS)
def test_outliers_that_are_kept_are_the_first_reason(robot: str, rate_hz: float) -> None:
    """2 % of spikes of 20 standard deviations, six draws; the intervals are wider by them, and hold."""
    inside = compared = 0
    for seed in range(200, 206):
        model = spiked(right(robot, seed, rate_hz=rate_hz, noise=NOISE), lambda r, n: 20 * signs(r, n), seed=seed)
        found = answer(model, named(loaded(robot)))
        assert found.verdict == "doubtful"
        assert set(found.codes) == {"log-outliers"}
        inside, compared = inside + found.inside, compared + found.compared
    assert inside / compared >= 0.95 - 2.5 * np.sqrt(0.95 * 0.05 / compared)


@pytest.mark.gate
@pytest.mark.parametrize(("robot", "rate_hz"), ROBOTS)
def test_noise_of_encoders_is_called_no_outlier(robot: str, rate_hz: float) -> None:
    """0.001 degrees in what the controller is given for the positions, as much off as if it were in its reference."""

    def noisy(model: LoopModel) -> LoopModel:
        rng = np.random.default_rng(robot == "arm")
        for label in model.experiments:
            model = with_columns(
                model, lambda n, q: q + np.deg2rad(1e-3) * rng.normal(size=q.size) * (n in ("q1", "q2")), label
            )
        return model

    for seed in range(200, 203):
        model = right(robot, seed, rate_hz=rate_hz, noise=NOISE, change=noisy)
        assert answer(model, named(loaded(robot))).codes == ()
        assert not [d for d in data_diagnostics(model) if "outliers" in d.code.name]
