"""Discovery on real data: what M, Fv and Fc lack on the EMPS, and its pulses found without being told about them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from fmu_didim.case.files import data_folder
from fmu_didim.discovery.external_torques.fit import find_external_torques
from fmu_didim.results.findings import FindingsDocument
from fmu_didim.workflow.discover import discover
from tests.conftest import needs_emps
from tests.discovery.helpers import base_of

LACKS, PULSES = "examples/emps/discover.yaml", "examples/emps/discover_pulses.yaml"
PULSE = 5 * 35.15065188248547
"""The pulses that were added, N: 5 V."""
SAMPLE_S = 0.01


def pulse_edges() -> tuple[np.ndarray, np.ndarray]:
    """Begins and ends of the pulses in the data, s."""
    data = loadmat(data_folder(Path("examples/emps")) / "emps" / "DATA_EMPS_PULSES.mat")
    time, height = data["t"].ravel(), data["pulses_N"].ravel().astype(float)
    steps = np.diff(height)
    return time[1:][steps > 0], time[1:][steps < 0]


def check_pulses(external_torques: list[tuple[float, float, float]], tolerance: float) -> None:
    """Times within a sample of the torque log, sizes within a tolerance."""
    begins, ends = pulse_edges()
    assert len(external_torques) == begins.size == 25
    found = np.array(external_torques)
    assert np.abs(found[:, 0] - begins).max() < SAMPLE_S
    assert np.abs(found[: ends.size, 1] - ends).max() < SAMPLE_S  # the last one outlasts the log
    assert np.abs(found[:, 2] - PULSE).max() < 0.08 * PULSE
    assert abs(found[:, 2].mean() - PULSE) < tolerance * PULSE


@pytest.mark.gate
@needs_emps
def test_noise_comes_from_the_laps() -> None:
    """The file holds measured columns beside the reference; they do not hide that the motion repeats."""
    fit = base_of(LACKS)
    noise = fit.noise
    assert noise.period_s == pytest.approx(6.24)
    assert noise.deviation[0] == pytest.approx(0.0056 * np.sqrt(np.mean(fit.model.measured**2)), rel=0.2)


@pytest.mark.gate
@needs_emps
def test_asymmetric_viscous_friction_is_named_first() -> None:
    found = discover(LACKS, rounds=1)
    first = found.findings[0]
    assert (first.effect, first.joint) == ("asymmetric_viscous", 1)
    # (Fv+ - Fv-)/2 of the published asymmetric model.
    assert first.parameters[0].value == pytest.approx((166.7061 - 240.4236) / 2, rel=0.1)
    for label, before, after in (("estimation", 7.4, 3.8), ("validation", 7.6, 4.7)):
        was, now = found.error_percent[label]
        assert was is not None
        assert now is not None
        assert was == pytest.approx(before, abs=0.3)
        assert now <= after
    fit, motion, *others = first.ladder
    assert (fit.state, motion.state) == ("climbed", "open")
    assert "validation repeats the motion of a fitted run, with pulse1 added" in motion.text
    assert motion.evidence[0].says == "yes"
    assert {rung.state for rung in others} == {"open"}


@needs_emps
@pytest.mark.slow
def test_what_the_usual_model_lacks() -> None:
    found = discover(LACKS)
    classes = [f.class_ for f in found.findings]
    assert classes[0] == "asymmetric_viscous"
    assert classes[1] in ("stribeck", "presliding")  # what happens at low speed
    assert len(classes) == 2, "what remains is refinement, a few per cent of the gap"
    assert any("of the base model" in why for _, _, why in found.refused)
    now = [found.error_percent[label][1] for label in ("estimation", "validation")]
    assert now[0] is not None
    assert now[1] is not None
    assert now[0] < 3.1
    assert now[1] < 4.3
    assert not [f for f in found.findings if f.ratio_interval is None or (f.ratio_interval[1] or 9.0) >= 1.0]


@pytest.mark.slow
@needs_emps
def test_pulses_are_found() -> None:
    fit = base_of(PULSES)
    fitted_torques = find_external_torques(fit)
    assert fitted_torques is not None
    assert fitted_torques.share > 0.9
    assert all(external.is_logged for external in fitted_torques.external_torques)
    check_pulses([(p.begin_s, p.end_s, p.torque) for p in fitted_torques.external_torques], 0.03)


@needs_emps
@pytest.mark.slow
def test_pulses_are_reported_before_what_else_is_missing(tmp_path: Path) -> None:
    found: FindingsDocument = discover(PULSES, tmp_path)
    assert [f.effect for f in found.findings][:2] == ["external_force", "asymmetric_viscous"]
    check_pulses([(w.begin_s, w.end_s, w.torque) for w in found.windows if w.experiment == "estimation"][:25], 0.02)
    assert found.error_percent["estimation"][0] > 40  # type: ignore[operator]
    assert found.error_percent["estimation"][1] < 3  # type: ignore[operator]
