"""The checks of a torque log, on torques made by hand."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.diagnosis.log_checks import _check_order, _correlations, _gaps, check_log
from fmu_didim.errors import InputError, SimulationError
from fmu_didim.signals import Array

N = np.arange(400)
A, B, C = (np.where(N // m % 2 == 0, 1.0, -1.0) for m in (1, 2, 4))
"""Torques without mean that are not correlated."""


def model(measured: Array, simulated: Array | None, places: Any = None) -> Any:
    experiment = SimpleNamespace(label="log.csv", places=N if places is None else places, time=0.01 * N)

    def torque(values: Any, label: str) -> Array:
        if simulated is None:
            raise SimulationError("It diverges.")
        return simulated

    return SimpleNamespace(measured_in=lambda label: measured, experiments={"x": experiment}, torque=torque, start=None)


def mixed(correlation: float, other: Array = C) -> Array:
    """A torque of this correlation with A."""
    return np.asarray(correlation * A + np.sqrt(1 - correlation**2) * other)


@pytest.mark.parametrize(("correlation", "refused"), [(-0.701, True), (-0.699, False), (0.9, False), (-1.0, True)])
def test_a_torque_that_runs_against_the_simulated_one(correlation: float, refused: bool) -> None:
    one = model(np.column_stack([B, mixed(correlation)]), np.column_stack([B, A]))
    if not refused:
        assert check_log(one, "x") == ()
        return
    with pytest.raises(InputError, match=rf"log.csv: joint 2[\s\S]*correlation {correlation:.2f}"):
        check_log(one, "x")


def test_all_torques_that_run_against_it_are_named() -> None:
    with pytest.raises(InputError, match=r"joint 1, 2[\s\S]*correlation -1.00, -1.00"):
        check_log(model(np.column_stack([-A, -B]), np.column_stack([A, B])), "x")


@pytest.mark.parametrize(
    ("correlation", "ratio", "remarked"),
    [
        (1.0, 30.1, True),
        (1.0, 29.9, False),
        (1.0, 1 / 30.1, True),
        (1.0, 1 / 29.9, False),
        (0.71, 50.0, True),
        (0.69, 50.0, False),
    ],
)
def test_another_unit(correlation: float, ratio: float, remarked: bool) -> None:
    measured = ratio / correlation * mixed(correlation)
    found = check_log(model(measured[:, None], A[:, None]), "x")
    assert bool(found) is remarked
    if remarked:
        assert found[0].startswith(f"log.csv: the torque of joint 1 is {ratio:.3g} times what the start values give")


@pytest.mark.parametrize(
    ("own", "other", "refused"),
    [
        # Errors of the own and of the other order, of the mean square, for two joints.
        (1.02, 0.09, True),
        (1.02, 0.11, False),
        (0.98, 0.05, False),
        (4.0, 0.39, True),
        (4.0, 0.41, False),
    ],
)
def test_another_order(own: float, other: float, refused: bool) -> None:
    """Each simulated torque is that of the other joint, but for a part of its own."""
    angle = np.arccos(1 - (own - other) / 4)  # of two torques of size one that are so far apart
    measured = np.column_stack([A, np.cos(angle) * A + np.sin(angle) * B])
    simulated = measured[:, ::-1] + np.sqrt(other / 2) * C[:, None]
    error = np.mean((measured[:, :, None] - simulated[:, None, :]) ** 2, axis=0)
    np.testing.assert_allclose([np.trace(error), error[0, 1] + error[1, 0]], [own, other], rtol=1e-9)
    if not refused:
        _check_order(measured, simulated, "log.csv")
        return
    with pytest.raises(InputError, match=r"squared error \S+ of the torque's square; \S+ if column 1 shows joint 2"):
        _check_order(measured, simulated, "log.csv")


def test_errors_are_relative_to_each_torque() -> None:
    measured = np.column_stack([1000.0 * A, B])
    with pytest.raises(InputError, match=re.escape("if column 1 shows joint 2, column 2 shows joint 1")):
        _check_order(measured, np.column_stack([B, 1000.0 * A]), "log.csv")


def test_constant_torques_are_not_correlated() -> None:
    found = _correlations(np.column_stack([A, np.ones(400)]), np.column_stack([-A, B]))
    assert found.tolist() == [[pytest.approx(-1.0), pytest.approx(0.0)], [0.0, 0.0]]


def test_where_nothing_can_be_simulated_only_gaps_are_named() -> None:
    places = np.where(N < 100, N, N + 3)
    found = check_log(model(-A[:, None], None, places), "x")
    assert len(found) == 1 and found[0].startswith("log.csv: 3 of 403 torque samples are missing")


@pytest.mark.parametrize(
    ("places", "text"),
    [
        (N, ""),
        (
            np.where(N < 100, N, N + 1),
            "log.csv: 1 of 401 torque samples is missing, the first of them after t = 0.99 s.",
        ),
        (
            np.where(N < 5, N, N + 7),
            "log.csv: 7 of 407 torque samples are missing, the first of them after t = 0.04 s.",
        ),
    ],
)
def test_samples_that_were_dropped(places: Any, text: str) -> None:
    experiment = SimpleNamespace(places=places, time=0.01 * N)
    found = _gaps(experiment, "log.csv")
    assert " ".join(found)[: len(text)] == text and bool(found) is bool(text)


def test_the_label_stands_for_a_log_without_a_name() -> None:
    one = model(-A[:, None], A[:, None])
    one.experiments["x"] = SimpleNamespace(**{**vars(one.experiments["x"]), "label": ""})
    with pytest.raises(InputError, match="x: joint 1"):
        check_log(one, "x")
