"""Friction that the FMU of another tool lacks, so large that the fit of the base goes astray without it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_didim import discover
from tests.foreign import exported, foreign_case, one_joint, spring_pendulum

DEFAULTS = {"m": 1.0, "l": 0.5, "k": 2.0, "d": 0.2}
TRUTH = {"m": 1.4, "k": 4.0, "d": 0.3}
IDENTIFY = {"m": {"minimum": 0.01}, "k": {}, "d": {}}


@pytest.mark.gate
@pytest.mark.parametrize(
    ("gains", "size", "friction", "astray"),
    [
        ((20.0, 2.0), 0.5, 4.0, (1.5, 1.6)),
        *(
            pytest.param(*row, marks=pytest.mark.slow)
            for row in [
                ((20.0, 2.0), 0.2, 4.0, (0.02, 0.2)),
                ((60.0, 6.0), 0.1, 4.0, (0.0, 0.1)),
                ((10.0, 1.0), 0.5, 4.0, (0.9, 1.2)),
                ((20.0, 2.0), 0.1, 1.0, (0.5, 0.9)),
                ((70.0, 7.0), 0.12, 4.0, (0.0, 0.1)),  # Stribeck friction leads out of the astray fit, and goes again
                ((80.0, 8.0), 0.1, 5.0, (0.0, 0.1)),  # so does drift of friction
            ]
        ),
    ],
)
def test_it_is_named_with_right_values(
    tmp_path: Path, gains: tuple[float, float], size: float, friction: float, astray: tuple[float, float]
) -> None:
    """The drive fights a friction of up to 4 N.m with 2.7 and 4.0 N.m on average; without it the mass is far off."""
    plant = exported(tmp_path / "plant", one_joint("pendulum", DEFAULTS, spring_pendulum))
    truth = {**DEFAULTS, "m": 1.4, "k": 4.0, "d": 0.3, "Fc": friction}
    data = exported(tmp_path / "truth", one_joint("pendulum", truth, spring_pendulum, rate=4000.0))
    found = discover(foreign_case(tmp_path, plant, data, IDENTIFY, gains=gains, size=size))
    assert found.fits is not None
    base, final = found.fits.discovery.base, found.fits.discovery.final
    assert astray[0] < dict(zip(base.model.names, base.values, strict=True))["m"] < astray[1]
    assert (found.document.answer, found.verdict) == ("named", "valid")
    assert [(f.effect, f.joint) for f in found.document.findings] == [("coulomb", 1)]
    values = dict(zip(final.model.names, final.values, strict=True))
    deviation = dict(zip(final.model.names, np.sqrt(np.diag(final.covariance)), strict=True))
    for name, true in {**TRUTH, "Fc1": friction}.items():  # where the motion is small some are hardly known
        assert abs(values[name] - true) < max(0.02 * true, 4 * deviation[name]), name


@pytest.mark.gate
@pytest.mark.parametrize(("output", "advice"), [("phi", "Map its velocity"), ("w", "map that output as dq1")])
def test_without_a_velocity_the_doubt_says_that_it_was_not_tried(tmp_path: Path, output: str, advice: str) -> None:
    """Of a position alone, and of a speed that is mapped as a position."""
    plant = exported(tmp_path / "plant", one_joint("pendulum", DEFAULTS, spring_pendulum))
    truth = {**DEFAULTS, "m": 1.4, "k": 4.0, "d": 0.3, "Fc": 4.0}
    data = exported(tmp_path / "truth", one_joint("pendulum", truth, spring_pendulum, rate=4000.0))
    entries = {"outputs": {"q1": output}}
    speed = {"velocity": "backward_difference"} if output == "phi" else {"gains": (6.0, 0.0)}
    found = discover(foreign_case(tmp_path, plant, data, IDENTIFY, plant_entries=entries, **speed))
    assert found.verdict == "doubtful"
    if output == "phi":  # what drives a loop whose speed is fed as a position is no motion that anybody asked for
        assert found.document.answer == "unknown"
        assert found.document.text == "something is missing that no effect which could be tried explains"
    reason = found.document.reasons[0]
    assert (reason.code, reason.place) == ("effects-untried", "plant")
    assert "friction" in reason.text and advice in reason.next_step
    assert ("torque limit that falls with the speed" in reason.text) is (output == "w")  # of positions it is tried
