"""What is looked for where data begin, and what the data after that must say."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.discovery import beginning
from fmu_didim.discovery.beginning import at_start, is_told_later
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import candidate_of

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


def test_of_the_catalogue_those_are_gains_of_a_controller() -> None:
    shown = {name for name, effect in EFFECTS.items() if effect.shows_at_start}
    assert shown == {name for name, effect in EFFECTS.items() if effect.class_name == "controller_gain"}


def fit(value: float, deviation: float) -> Any:
    """A fit with one value of the gain."""
    parameter = SimpleNamespace(effect=0)
    model = SimpleNamespace(added_effects=(GAIN,), free_parameters=[SimpleNamespace(effect=None), parameter])
    return SimpleNamespace(model=model, values=np.array([7.0, value]), covariance=np.diag([1.0, deviation**2]))


@pytest.mark.parametrize(
    ("with_start", "after", "gain", "starts_known", "wanted"),
    [
        ((0.80, 0.01), (0.82, 0.04), 20.0, False, True),
        ((0.80, 0.01), (0.9, 0.04), 20.0, False, True),  # 2.4 standard deviations of both
        ((0.80, 0.01), (0.95, 0.04), 20.0, False, False),  # 3.6: the start asks for something else
        ((0.80, 0.01), (0.81, 0.04), 9.0, False, False),  # the data after it do not tell it
        ((0.80, 0.01), None, 0.0, False, False),  # the loop cannot run there
        ((0.80, 0.01), None, 0.0, True, True),  # play of a gear, which starts in its middle
    ],
)
def test_what_is_found_with_the_start_is_in_the_data_after_it(
    monkeypatch: pytest.MonkeyPatch, with_start: tuple[float, float], after: tuple[float, float] | None, gain: float,
    starts_known: bool, wanted: bool,
) -> None:  # fmt: skip
    monkeypatch.setattr(beginning, "fitted_proposal", lambda fit, effect_at: (fit, effect_at))
    of_start: Any = SimpleNamespace(final=fit(*with_start))
    later: Any = SimpleNamespace(
        refit=lambda proposal: None if after is None else fit(*after), assess=lambda *_: candidate_of("gain", bic=gain)
    )
    builder: Any = SimpleNamespace(effect=lambda effect_at: SimpleNamespace(known_at_start=starts_known))
    step: Any = SimpleNamespace(effect_at=GAIN)
    assert is_told_later(step, of_start, builder, later) == wanted
