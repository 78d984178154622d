"""Discovery with positions beside the torque."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import discover
from fmu_didim.case import load_case
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.base_model import prepare
from fmu_didim.discovery.request import Request
from fmu_didim.discovery.run import _Search
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection import held_out
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.fit import gap
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.results.findings import FindingsDocument
from tests.discovery.helpers import arm_case

STRIBECK = {"stribeck": {"Fs": 0.8, "vs": 0.1}}
ENCODER = 1e-5
"""[rad] Noise of the positions."""


def without_positions(case: Path) -> Path:
    """The same case with the torque alone."""
    content = yaml.safe_load(case.read_text(encoding="utf-8"))
    for label in ("train", "validation"):
        del content[label]["measured"]
    alone = case.with_name("torque.yaml")
    alone.write_text(yaml.safe_dump(content), encoding="utf-8")
    return alone


def codes(document: FindingsDocument) -> set[str]:
    return {reason.code for reason in document.reasons}


def base_of(case: Path) -> tuple[LoopModelBuilder, Fit]:
    loaded = load_case(case)
    fit = prepare(loaded.model).fit
    return LoopModelBuilder(fit.model, loaded.parameters.model.description, EFFECTS), fit  # type: ignore[union-attr]


# ---- the base model


def test_each_signal_has_its_own_noise_and_the_torque_that_of_its_periods(tmp_path: Path) -> None:
    case = arm_case(tmp_path, sigma=0.2, rate_hz=50.0, encoder=ENCODER)
    _, fit = base_of(case)
    alone = prepare(load_case(without_positions(case)).model).fit
    assert fit.noise.deviation[0] == alone.noise.deviation[0]
    assert fit.noise.deviation[1] == pytest.approx(ENCODER, rel=0.2)
    assert (np.sqrt(np.diag(fit.covariance))[:5] < np.sqrt(np.diag(alone.covariance))[:5]).all()
    assert fit.shared_variance.min() >= 1
    moved = np.abs(fit.values - alone.values) / np.sqrt(np.diag(alone.covariance))
    assert moved.max() < 4


def test_a_case_without_positions_is_fitted_as_before(tmp_path: Path) -> None:
    alone = without_positions(arm_case(tmp_path, sigma=0.2, rate_hz=50.0, encoder=ENCODER))
    prepared = prepare(load_case(alone).model)
    assert prepared.of_torque is None and prepared.doubts == ()
    assert gap.pairs(prepared.fit, prepared.fit, prepared.fit.noise)[0].before is not None
    fit = prepared.fit
    assert gap.bic_gain(fit, fit, 1.0, fit.noise) == gap.delta_bic(fit.residual, fit.residual, 1.0, fit.noise)
    assert gap.channel_gaps(fit) == {}


@pytest.mark.parametrize(("scale", "words"), [(1.01, "it moves +1.0"), (0.98, "it moves -2.0")])
def test_a_sensor_with_another_scale_is_left_out_and_told(tmp_path: Path, scale: float, words: str) -> None:
    prepared = prepare(load_case(arm_case(tmp_path, sigma=0.2, rate_hz=50.0, encoder=ENCODER, scale=scale)).model)
    (told,) = prepared.doubts
    assert told.code.name == "channel-off" and told.place == "q1"
    assert words in told.text
    assert prepared.fit.model.experiments.channels == ()


def test_two_sensors_that_are_off_are_both_left_out(tmp_path: Path) -> None:
    case = arm_case(tmp_path, joints=2, sigma=0.2, rate_hz=50.0, encoder=ENCODER, scale=1.01)
    prepared = prepare(load_case(case).model)
    assert {told.place for told in prepared.doubts} == {"q1", "q2"}
    assert prepared.fit.model.experiments.channels == ()


@pytest.mark.parametrize(("late_s", "words"), [(0.004, "later"), (-0.004, "earlier")])
def test_a_sensor_with_a_late_clock_is_left_out_and_told(tmp_path: Path, late_s: float, words: str) -> None:
    case = arm_case(tmp_path, sigma=0.2, rate_hz=50.0, encoder=ENCODER)
    content = yaml.safe_load(case.read_text(encoding="utf-8"))
    for label in ("train", "validation"):
        content[label]["from_s"], content[label]["to_s"] = 0.5, 7.5
        content[label]["measured"]["offset_s"] = late_s
    case.write_text(yaml.safe_dump(content), encoding="utf-8")
    (told,) = prepare(load_case(case).model).doubts
    assert told.code.name == "channel-off"
    assert re.search(rf"it is (3\.9\d*|4(\.0\d*)?) ms {words} than the simulation", told.text)


# ---- screening


def test_signatures_show_what_an_effect_does_to_the_position(tmp_path: Path) -> None:
    """The change to first order beside that by a simulation, in torque and position."""
    builder, fit = base_of(arm_case(tmp_path, sigma=0.2, rate_hz=50.0, encoder=ENCODER))
    for effect in ("spring", "quadratic_viscous"):
        at = EffectAtJoint(effect, 1)
        (signature, *_) = SignatureCatalogue(builder, fit, candidates=[at])
        size = 0.3
        model = builder.build(fit.model, [signature.proposal(np.full(len(signature.amplitudes), size))])
        change = (model.outputs(model.start) - fit.outputs) / size
        shown = signature.columns[:, :, 0]
        for k in range(2):
            there = fit.model.experiments.blocks(change)[k][1][100:, 0]
            close = fit.model.experiments.blocks(shown)[k][1][100:, 0]
            assert np.linalg.norm(there - close) < 0.1 * np.linalg.norm(there)


def test_what_the_torque_hides_leads_the_screening_with_positions(tmp_path: Path) -> None:
    case = arm_case(tmp_path, STRIBECK, sigma=0.3, rate_hz=20.0, encoder=ENCODER)
    candidates = [EffectAtJoint(name, 1) for name in ("stribeck", "spring", "torque_ripple", "quadratic_viscous")]
    gains = []
    for one in (case, without_positions(case)):
        builder, fit = base_of(one)
        screened = Competition(builder, fit).screen(SignatureCatalogue(builder, fit, candidates=candidates))
        gains.append({s.effect_at.effect: s.gain for s in screened})
    assert max(gains[0], key=lambda name: gains[0][name]) == "stribeck"
    assert gains[0]["stribeck"] > 100 > gains[1]["stribeck"]


# ---- held-out data


def test_a_model_that_is_worse_for_a_held_out_position_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, fit = base_of(arm_case(tmp_path, sigma=0.2, rate_hz=50.0, encoder=ENCODER))
    before = gap.held_out_residual(fit)
    assert before.shape[1] == 2 and (before != 0).any(axis=0).all()
    assert fit.held_out_jacobian.shape == (*before.shape, fit.values.size)
    model_error = np.where(before != 0, np.sin(np.arange(before.shape[0]))[:, None] * fit.noise.deviation, 0.0)
    first, second = before + model_error * [9.0, 1.0], before + model_error * [1.0, 3.0]
    other = replace(fit, values=fit.values + 1e-6)
    for module in (gap, held_out):
        monkeypatch.setattr(module, "held_out_residual", lambda one: first if one is fit else second)
    assert held_out.held_out_objection(fit, other).startswith("held-out RMS ratio")
    assert "of q1, its interval starts at" in held_out.held_out_objection(fit, other)


# ---- the whole search


@pytest.mark.gate
def test_positions_name_what_a_slow_torque_log_hides(tmp_path: Path) -> None:
    case = arm_case(tmp_path, STRIBECK, sigma=0.3, rate_hz=20.0, encoder=ENCODER)
    found = discover(case)
    document = found.document
    (finding,) = document.findings
    assert (finding.effect, finding.joint, document.verdict) == ("stribeck", 1, "valid")
    fitted = {value.name: value for value in finding.parameters}
    low, high = fitted["Fs1"].interval
    assert low is not None and high is not None and low < 0.8 < high
    for label in ("estimation", "validation"):
        pair = finding.channels[label]["q1"]
        assert pair.before is not None and pair.after is not None and pair.after < 0.3 < 1 < pair.before
    assert document.channels["q1"].std == pytest.approx(ENCODER, rel=0.2)
    text = found.summary()
    assert "gap of q1" in text and "Beside the torque, q1 count" in " ".join(text.split())
    assert discover(without_positions(case)).document.findings == []


@pytest.mark.gate
def test_nothing_is_named_on_a_clean_plant_with_positions(tmp_path: Path) -> None:
    found = discover(arm_case(tmp_path, sigma=0.2, rate_hz=20.0, encoder=ENCODER))
    document = found.document
    assert (document.answer, document.verdict) == ("nothing", "valid")
    (condition,) = document.conditions
    assert condition.startswith("the data do not hide ") and document.power is not None
    assert f"Provided that {condition}." in " ".join(found.summary().split())
    assert any(note.startswith("It would not show, but move values: ") for note in document.notes)


@pytest.mark.gate
def test_a_wrong_sensor_names_no_effect_without_doubt(tmp_path: Path) -> None:
    document = discover(arm_case(tmp_path, sigma=0.2, rate_hz=20.0, encoder=ENCODER, scale=1.01)).document
    assert document.findings == [] and document.verdict == "doubtful"
    assert "channel-off" in codes(document)
    assert document.channels == {}


def test_positions_that_spoil_the_torque_are_told(tmp_path: Path) -> None:
    """A torque log that is a fifth too large: the positions ask for other values."""
    model = load_case(arm_case(tmp_path, sigma=0.2, rate_hz=50.0, encoder=ENCODER)).model
    for label, experiment in model.experiments.items():
        model = model.with_experiment(label, replace(experiment, torque=1.2 * experiment.torque))
    prepared = prepare(model)
    request = Request("arm", None)
    search = _Search(request, request, prepared, prepared.fit, None, LoopModelBuilder(model, None), False, [])
    (told,) = search.torn(prepared.fit)
    assert told.code.name == "channels-disagree" and told.place == "joint 1"
    assert "With q1 the torque error is" in told.text
    alone = replace(search, prepared=replace(prepared, of_torque=None))
    assert alone.torn(prepared.fit) == []
