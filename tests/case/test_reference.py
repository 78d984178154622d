"""References as files have them: derivatives computed, rows resampled, and what is told of both."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fmu_didim.base.diagnostics import DiagnosedError
from fmu_didim.base.errors import InputError
from fmu_didim.case import load_case
from fmu_didim.case.runs.reference import read_reference, resampled, with_derivatives
from fmu_didim.case.sources import ReferenceFile
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.workflow.data import case_diagnostics
from tests.cases import SCARA
from tests.helpers import PERIOD, reference

NEEDED = frozenset({"q1", "q2", "dq1", "dq2"})


def only(motion: Trajectory, *names: str, noise: float = 0.0, step: float = 0.0) -> Trajectory:
    """Some columns, with noise, or rounded to an encoder's step."""
    columns = {name: motion.column(name) for name in names}
    rng = np.random.default_rng(3)
    columns = {name: c + noise * rng.normal(size=c.size) for name, c in columns.items()}
    if step:
        columns = {name: np.rint(c / step) * step for name, c in columns.items()}
    return trajectory(motion.time, columns)


def codes(told: Any) -> list[str]:
    return [d.code.name for d in told]


MOTION = reference(4.0)


@pytest.mark.parametrize(
    ("given", "needed", "names", "told"),
    [
        (MOTION, NEEDED, {"q1", "q2", "dq1", "dq2", "ddq1", "ddq2"}, []),
        (only(MOTION, "q1", "q2"), NEEDED, {"q1", "q2", "dq1", "dq2"}, ["reference-derived"]),
        # Nobody asks for velocities, but the motion has begun, and the plant with it.
        (only(MOTION, "q1", "q2"), frozenset(), {"q1", "q2", "dq1", "dq2"}, ["reference-derived"]),
        (only(MOTION, "q1", "q2"), frozenset({"ddq2"}), {"q1", "q2", "dq1", "dq2", "ddq2"}, ["reference-derived"]),
        (only(MOTION, "q1", "dq1"), frozenset({"ddq1"}), {"q1", "dq1", "ddq1"}, ["reference-derived"]),
        # Planned positions with nine digits are no noise; measured ones are, and those of an encoder.
        (only(MOTION, "q1", step=1e-9), NEEDED, {"q1", "dq1"}, ["reference-derived"]),
        (only(MOTION, "q1", noise=1e-3), NEEDED, {"q1", "dq1"}, ["reference-derived", "reference-derived-from-noise"]),
        (only(MOTION, "q1", step=2e-3), NEEDED, {"q1", "dq1"}, ["reference-derived", "reference-derived-from-noise"]),
        # Of noisy positions whose velocity only starts the plant nothing is doubted.
        (only(MOTION, "q1", noise=1e-3), frozenset(), {"q1", "dq1"}, ["reference-derived"]),
        (only(MOTION, "q1", noise=1e-6), frozenset({"ddq1"}), {"q1", "dq1", "ddq1"}, ["reference-derived"]),
        (
            only(MOTION, "q1", noise=1e-5), frozenset({"ddq1"}), {"q1", "dq1", "ddq1"},
            ["reference-derived", "reference-derived-from-noise"],
        ),
    ],
)  # fmt: skip
def test_derivatives(given: Trajectory, needed: frozenset[str], names: set[str], told: list[str]) -> None:
    found, of_it = with_derivatives(given, needed)
    assert set(found.names) == names
    assert codes(of_it) == told
    for name in set(found.names) - set(given.names):
        size = np.ptp(MOTION.column(name))
        noisy = len(told) > 1 or not needed
        assert_allclose(found.column(name), MOTION.column(name), atol=size * (1.0 if noisy else 0.05))


def test_noise_is_told_as_large_as_it_is() -> None:
    """Against the difference from the exact velocity."""
    found, (_, rough) = with_derivatives(only(MOTION, "q1", noise=1e-3), NEEDED)
    exact = MOTION.column("dq1")
    inner = slice(20, -20)
    true = np.std((found.column("dq1") - exact)[inner]) / np.std(found.column("dq1"))
    assert rough.value == pytest.approx(true, rel=0.15)


def test_motion_from_rest_needs_nothing() -> None:
    time = np.arange(401) * PERIOD
    motion = trajectory(time, {"q1": (1 - np.cos(2 * time)) ** 2})
    assert with_derivatives(motion, frozenset({"q1"})) == (motion, [])


def at(time: Any) -> Trajectory:
    return trajectory(time, {"q1": np.sin(2 * time), "dq1": 2 * np.cos(2 * time)})


EVEN = np.arange(1001) * PERIOD
JITTER = EVEN + 0.2 * PERIOD * np.random.default_rng(1).uniform(-1, 1, EVEN.size)


@pytest.mark.parametrize(
    ("given", "told", "text"),
    [
        (
            at(JITTER),
            ["reference-resampled"],
            r"usually (4\.9|5\.0)\d* ms apart, were brought to 200 Hz. They lie 0\.5\d* ms",
        ),
        (at(np.arange(0, 5, 0.01)), ["reference-resampled"], "10 ms apart"),
        (at(np.delete(EVEN, [50, 51, 300])), ["reference-resampled", "reference-gaps"], "3 rows are missing"),
        (at(np.arange(0, 5, 0.3)), ["reference-resampled", "reference-coarse"], "300 ms apart"),
    ],
)
def test_resampling_is_told(given: Trajectory, told: list[str], text: str) -> None:
    found, of_it = resampled(given, PERIOD)
    assert codes(of_it) == told
    assert of_it[0].text and np.ptp(np.diff(found.time)) < 1e-9
    import re

    assert re.search(text, of_it[0].text), of_it[0].text
    atol = 0.02 if "reference-coarse" in told else 1e-5
    assert_allclose(found.column("q1"), np.sin(2 * found.time), atol=atol)


def scara(motion: Trajectory, **changes: Any) -> Any:
    content = load_case(SCARA).content
    content |= {"validation": None}
    content["train"] = {"reference": {"file": "motion.csv", **changes}, "torque": {"file": "train_10hz.csv"}}
    return load_case(content, folder=SCARA.parent, signals={"motion.csv": motion})


def exact() -> Trajectory:
    return load_case(SCARA).model.experiments["estimation"].reference


def test_jittered_reference_is_refused_with_the_figure_or_resampled_where_asked() -> None:
    motion = exact()
    jitter = np.random.default_rng(2).uniform(-1, 1, motion.time.size) * 0.5e-3
    jitter[0] = 0
    q = np.column_stack([np.interp(motion.time + jitter, motion.time, c) for c in motion.values.T])
    uneven = Trajectory(motion.time + jitter, q, motion.variables)
    with pytest.raises(DiagnosedError, match=r"unevenly[\s\S]*0\.2\d* ms[\s\S]*motion\.csv[\s\S]*resample: true"):
        scara(uneven)
    case = scara(uneven, resample=True)
    assert_allclose(case.model.experiments["estimation"].reference.values, motion.values, atol=2e-3)
    found = case_diagnostics(case)
    assert "reference-resampled" in codes(found)


def test_a_reference_without_velocities_gives_the_values_of_one_that_has_them() -> None:
    motion = exact()
    case = scara(only(motion, "q1", "q2"))
    made = case.model.experiments["estimation"].reference
    for name in ("dq1", "dq2"):
        assert_allclose(made.column(name), motion.column(name), atol=1e-4)
    assert "reference-derived" in codes(case_diagnostics(case))


@pytest.mark.parametrize(
    ("name", "refused"), [("ddq1", True), ("enable", True), ("wrist_current", False), ("Q1 commanded", False)]
)
def test_a_column_without_a_number_matters_where_something_asks_for_it(
    tmp_path: Path, name: str, refused: bool
) -> None:
    """Where no entry names it: signals of joints, and what a controller takes from its reference by that name."""
    motion = only(reference(1.0), "q1", "q2", "dq1", "dq2")
    broken = np.where(np.arange(motion.time.size) == 7, np.nan, 1.0)
    columns = {"t": motion.time, **{n: motion.column(n) for n in motion.names}, name: broken}
    rows = [
        ",".join(columns),
        *(",".join(f"{value:.9g}" for value in row) for row in zip(*columns.values(), strict=True)),
    ]
    (tmp_path / "reference.csv").write_text("\n".join(rows) + "\n")
    source = ReferenceFile(file="reference.csv")
    needed = NEEDED | {"enable"}

    def read() -> Trajectory:
        return read_reference(source, tmp_path, step=PERIOD, torque_units=("N.m", "N.m"), needed=needed).signals

    if refused:
        with pytest.raises(InputError, match=rf"not finite[\s\S]*1 rows, the first one is row 7 \(from 0\), in {name}"):
            read()
    else:
        assert read().names == ("q1", "q2", "dq1", "dq2")
