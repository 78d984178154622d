"""Counts that wrapped are told, whatever joint, rate and width are; steps of friction are not taken for that."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.base.diagnostics import PROBLEM
from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.checks.data.expected import Expected
from fmu_didim.checks.data.wrapped import wrapped_diagnostics, wraps
from fmu_didim.data.signals import Array
from tests.checks.data.right import right, with_log

RNG = np.random.default_rng


def wrapped(values: Array, width: float, bits: int | None = None) -> Array:
    """In two's complement of a range of that width; with ``bits`` in counts of it."""
    if bits is not None:
        step = width / 2**bits
        values = np.rint(values / step) * step
    return (values + width / 2) % width - width / 2


CASES = [
    pytest.param(robot, seed, rate, share, bits, id=f"{robot}-{seed}-{rate:g}Hz-{share:g}-{bits}",
                 marks=[pytest.mark.gate] if rate > 100 or robot == "tx40" else [])
    for robot, seed, rate, share, bits in [
        ("scara", 1, 100.0, 0.7, None), ("scara", 2, 20.0, 0.55, 8), ("arm", 1, 100.0, 0.8, 16),
        ("arm", 2, 200.0, 0.6, None),        ("tx40", 1, 100.0, 0.75, None),
    ]
]  # fmt: skip


@pytest.mark.parametrize(("robot", "seed", "rate_hz", "share", "bits"), CASES)
def test_wrapped_counts_are_told(robot: str, seed: int, rate_hz: float, share: float, bits: int | None) -> None:
    model = right(robot, seed, rate_hz=rate_hz)
    joint = seed % model.joint_count

    def change(torque: Array) -> Array:
        torque[:, joint] = wrapped(torque[:, joint], share * 2 * np.abs(torque[:, joint]).max(), bits)
        return torque

    found = [d for d in data_diagnostics(with_log(model, change)) if d.code.severity == PROBLEM]
    assert [(d.code.name, d.place) for d in found] == [("log-wrapped", f"estimation: joint {joint + 1}")]


@pytest.mark.parametrize("rate_hz", [5.0, 20.0, 100.0])
def test_reversals_of_friction_are_no_wraps(rate_hz: float) -> None:
    """A joint that does little else than turn its friction round."""
    for robot in ("scara", "arm"):
        model = right(robot, 3, rate_hz=rate_hz)

        def change(torque: Array) -> Array:
            size = 5 * np.abs(torque).max(axis=0)
            return torque + size * np.sign(torque)

        assert "log-wrapped" not in [d.code.name for d in data_diagnostics(with_log(model, change), causes=False)]


@pytest.mark.parametrize("seed", range(20))
def test_the_width_is_that_of_the_counter(seed: int) -> None:
    rng = RNG(seed)
    t = np.linspace(0.0, 10.0, int(rng.integers(400, 4000)))
    torque = sum(rng.normal() * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.3, 0.7, 1.1))
    width = rng.uniform(1.1, 1.7) * np.abs(torque).max()
    found = wraps(wrapped(np.asarray(torque), width))
    if found is None:
        assert np.abs(torque).max() < width / 2 or np.sum(np.diff(np.abs(torque) > width / 2)) < 2
        return
    assert found.width == pytest.approx(width, rel=0.02)


SWING = 0.2 * np.sin(np.linspace(0, 20, 500))
SPIKES = SWING + np.isin(np.arange(500), [100, 300, 301])
LOAD = SWING + (np.arange(500) // 90 % 2)
SQUARE = (np.arange(500) // 90 % 2).astype(float)


@pytest.mark.parametrize("values", [SWING, np.array([0.0, 1.0, 0.0]), np.ones(50), SPIKES, LOAD])
def test_what_has_no_wraps(values: Array) -> None:
    assert wraps(values) is None


@pytest.mark.parametrize("knows", [False, True])
def test_steps_of_one_length_are_for_the_model_to_decide(knows: bool) -> None:
    """A square wave, for a model that has none, and for one that has."""
    columns = np.stack([SWING, SQUARE][: 1 + knows], axis=1)[:, None]
    torque = (SQUARE + SWING / 10 + 0.01 * RNG(1).normal(size=500))[:, None]
    found = wrapped_diagnostics(Expected(torque, columns=columns), "estimation")
    assert [d.code.name for d in found] == ([] if knows else ["log-wrapped"])
