"""What is looked for where data begin, and what the data after that must say."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from fmu_didim.discovery import beginning
from fmu_didim.discovery.beginning import (
    AfterStart,
    always_at_start,
    at_start,
    is_settled_by_start,
    is_told_later,
    unconfirmed_gears,
    untold_gears,
)
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import candidate_of, effect_of

GAIN = EffectAtJoint("gain", 1)


@pytest.mark.parametrize(
    ("refused", "wanted"),
    [
        ([("gain", "changes the torque by 0.58 of the noise, less than 0.6")], {"gain"}),
        ([("gain", "changes no signal by more than 0.58 of the noise, less than 0.6")], {"gain"}),
        ([("gain", "BIC difference 4.0 below 10")], set()),
        ([("gain", "held-out RMS ratio 1.020, its interval reaches 1.130")], set()),
        ([("drag", "changes the torque by 0.58 of the noise, less than 0.6")], set()),  # no more there than elsewhere
        ([], set()),
    ],
)
def test_what_the_later_data_tell_but_too_little(refused: list[tuple[str, str]], wanted: set[str]) -> None:
    effects: Any = {"gain": SimpleNamespace(shows_at_start=True), "drag": SimpleNamespace(shows_at_start=False)}
    discovery: Any = SimpleNamespace(refused=[(EffectAtJoint(name, 1), why) for name, why in refused])
    assert at_start(discovery, effects) == wanted


def test_of_the_catalogue_those_are_gains_of_a_controller_and_limits() -> None:
    shown = {name for name, effect in EFFECTS.items() if effect.shows_at_start}
    classes = {"controller_gain", "saturation"}
    assert shown == {name for name, effect in EFFECTS.items() if effect.class_name in classes}


def test_what_starts_in_a_known_state_and_limits_are_looked_for_where_data_begin() -> None:
    classes = {EFFECTS[name].class_name for name in always_at_start(EFFECTS)}
    assert classes == {"elasticity", "backlash", "gear_hardening", "transmission_error", "base_tilt", "saturation"}


def fit(value: float, deviation: float) -> Any:
    """A fit with one value of the gain."""
    parameter = SimpleNamespace(effect=0)
    model = SimpleNamespace(added_effects=(GAIN,), free_parameters=[SimpleNamespace(effect=None), parameter])
    return SimpleNamespace(model=model, values=np.array([7.0, value]), covariance=np.diag([1.0, deviation**2]))


@pytest.mark.parametrize(
    ("with_start", "after", "gain", "wanted"),
    [
        ((0.80, 0.01), (0.82, 0.04), 20.0, True),
        ((0.80, 0.01), (0.9, 0.04), 20.0, True),  # 2.4 standard deviations of both
        ((0.80, 0.01), (0.95, 0.04), 20.0, False),  # 3.6: the start asks for something else
        ((0.80, 0.01), (0.81, 0.04), 9.0, False),  # the data after it do not tell it
        ((0.80, 0.01), None, 0.0, False),  # the loop cannot run there
    ],
)
def test_what_is_found_with_the_start_is_in_the_data_after_it(
    monkeypatch: pytest.MonkeyPatch, with_start: tuple[float, float], after: tuple[float, float] | None, gain: float,
    wanted: bool,
) -> None:  # fmt: skip
    monkeypatch.setattr(beginning, "fitted_proposal", lambda fit, effect_at: (fit, effect_at))
    of_start: Any = SimpleNamespace(final=fit(*with_start))
    later: Any = SimpleNamespace(
        refit=lambda proposal: None if after is None else fit(*after), assess=lambda *_: candidate_of("gain", bic=gain)
    )
    step: Any = SimpleNamespace(effect_at=GAIN)
    assert is_told_later(step, of_start, later) == wanted


GEARS: Any = {
    "play": effect_of("play", title="Play", known_at_start=True),
    "elastic": effect_of("elastic", title="Elastic gear", known_at_start=True),
    "drag": effect_of("drag", title="Drag", known_at_start=False),
}
PLAY, ELASTIC, DRAG = (EffectAtJoint(name, 1) for name in GEARS)


@pytest.mark.parametrize(
    ("refused", "wanted"),
    [
        ([(PLAY, "held-out RMS ratio 0.893, its interval reaches 1.005")], True),
        ([(PLAY, "BIC difference 4.0 below 10")], False),
        ([(DRAG, "held-out RMS ratio 0.893, its interval reaches 1.005")], False),
        ([], False),
    ],
)
def test_gears_that_held_out_data_do_not_confirm_are_looked_for_with_the_start(
    refused: list[tuple[EffectAtJoint, str]], wanted: bool
) -> None:
    discovery: Any = SimpleNamespace(refused=refused)
    assert unconfirmed_gears(discovery, GEARS) == wanted


def step_with(effect_at: EffectAtJoint, *rivals: EffectAtJoint) -> Any:
    return SimpleNamespace(effect_at=effect_at, rivals=tuple((r, 1.0) for r in rivals))


@pytest.mark.parametrize(
    ("steps", "wanted"),
    [
        ([step_with(ELASTIC, PLAY)], {ELASTIC: PLAY}),
        ([step_with(ELASTIC)], {}),
        ([step_with(ELASTIC, DRAG)], {}),  # friction does not start from a state that is known
        ([step_with(DRAG, PLAY)], {}),
        ([step_with(ELASTIC, EffectAtJoint("play", 2))], {}),  # that is the gear of another joint
        ([step_with(DRAG), step_with(PLAY, ELASTIC)], {PLAY: ELASTIC}),
    ],
)
def test_gears_that_are_not_told_from_others_of_their_joint(
    steps: list[Any], wanted: dict[EffectAtJoint, EffectAtJoint]
) -> None:
    assert untold_gears(steps, GEARS) == wanted


@pytest.mark.parametrize(
    ("later", "of_start", "wanted"),
    [
        ([step_with(ELASTIC, PLAY)], [step_with(PLAY)], True),
        ([step_with(ELASTIC, PLAY)], [step_with(PLAY, ELASTIC)], False),  # it is not told there either
        ([step_with(ELASTIC, PLAY)], [step_with(ELASTIC)], False),  # the answer stays, with its doubt
        ([step_with(ELASTIC, PLAY)], [], False),
        ([step_with(ELASTIC, PLAY), step_with(DRAG)], [step_with(PLAY)], False),  # what the later data tell is lost
        ([step_with(ELASTIC, PLAY), step_with(DRAG)], [step_with(DRAG), step_with(PLAY)], True),
    ],
)
def test_the_start_settles_which_gear_it_is(later: list[Any], of_start: list[Any], wanted: bool) -> None:
    assert is_settled_by_start({ELASTIC: PLAY}, later, of_start) == wanted


@pytest.mark.parametrize(
    ("effect_at", "untold", "is_told", "wanted"),
    [
        (PLAY, {ELASTIC: PLAY}, True, ["effect-ambiguous"]),  # whatever the later data say of the play itself
        (PLAY, {}, False, ["gear-by-start"]),
        (PLAY, {}, True, []),
        (DRAG, {}, False, []),  # which is not named where only the start tells it
    ],
)
def test_what_the_start_alone_tells_is_said(
    monkeypatch: pytest.MonkeyPatch, effect_at: EffectAtJoint, untold: dict[EffectAtJoint, EffectAtJoint],
    is_told: bool, wanted: list[str],
) -> None:  # fmt: skip
    monkeypatch.setattr(beginning, "is_told_later", lambda *_: is_told)
    builder: Any = SimpleNamespace(effect=lambda at: GEARS[at.effect])
    of_start: Any = SimpleNamespace(steps=[step_with(effect_at)])
    found = AfterStart(cast(Any, "later"), untold).diagnostics(of_start, builder)
    assert [d.code.name for d in found] == wanted
    assert all("in the middle of its play" in d.text and "joint 1" in d.place for d in found)
