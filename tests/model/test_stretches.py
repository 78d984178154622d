"""The part of long logs that is judged: which samples it has, and that the loop is the same there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.cosim import sample_operator
from fmu_didim.data.filters import LowPass
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.model import stretches
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.stretches import part_of_logs
from tests.tools.benchmarks.growth import Size, write_case

STEP = 0.005
SAMPLES = 6000


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs count as long from 5000 samples on, and 2400 of them are judged."""
    monkeypatch.setattr(stretches, "LONG", 5000)
    monkeypatch.setattr(stretches, "PART", 2400)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> LoopModel:
    """An arm of two joints along three periods of its motion, with a log at the rate of the control."""
    return load_case(write_case(tmp_path_factory.mktemp("arm"), Size(samples=SAMPLES))).model


def motion(periodic: bool, samples: int = SAMPLES) -> Trajectory:
    """Of two joints, that repeats after two seconds or not at all."""
    t = STEP * np.arange(samples)
    rates = [np.pi, 2 * np.pi] if periodic else [2.1, np.e]
    columns = {f"q{j}": 0.4 * np.sin(w * t + j) for j, w in enumerate(rates, start=1)}
    columns |= {f"dq{j}": 0.4 * w * np.cos(w * t + j) for j, w in enumerate(rates, start=1)}
    return trajectory(t, columns)


def along(model: LoopModel, reference: Trajectory, every: int = 1, **options: Any) -> LoopModel:
    """The model along another motion, with the torque that it simulates there in a log of every so many ticks."""
    times = reference.time[every - 1 :: every]
    operator = sample_operator(
        times, start=0.0, step=STEP, tick_count=reference.time.size, window_s=every * STEP, **options
    )  # fmt: skip
    empty = Experiment(reference, times, np.zeros((times.size, 2)), operator, label="run_1")
    model = model.with_experiment("run_1", empty)
    return model.with_experiment("run_1", replace(empty, torque=model.torque(model.start)))


@pytest.mark.gate
@pytest.mark.parametrize(
    ("periodic", "every", "options"),
    [(True, 1, {}), (False, 1, {}), (True, 1, {"kind": "average"}), (False, 1, {"kind": "average"})],
)
def test_the_loop_is_the_same_in_the_part(
    model: LoopModel, periodic: bool, every: int, options: dict[str, Any]
) -> None:
    """Its log is that of the whole run at its rows, and simulated torque and reference are, too."""
    whole = along(model, motion(periodic), every, **options)
    part = part_of_logs(whole)
    assert part is not None
    own, rows = part.model.experiments["run_1"], part.rows["run_1"]
    all_of = whole.experiments["run_1"]
    assert 0.8 * stretches.PART <= rows.size <= stretches.PART + stretches.STRETCHES
    np.testing.assert_array_equal(own.torque, all_of.torque[rows])
    assert rows[0] == 0 and rows[-1] > 0.9 * all_of.time.size  # from begin to end
    assert len(part.spans["run_1"]) >= 2
    for begin, end in part.spans["run_1"]:
        inside = rows[(all_of.time[rows] >= begin) & (all_of.time[rows] <= end)]
        assert inside.size > 100 and (np.diff(inside) == 1).all()
    simulated = part.model.torque(part.model.start)
    apart = np.sqrt(np.mean((simulated - all_of.torque[rows]) ** 2))
    assert apart < (1e-9 if periodic else 1e-3) * all_of.torque.std()
    steps = np.diff(own.reference.time)
    assert np.ptp(steps) < 1e-9 and own.reference.time[0] == all_of.reference.time[0]


@pytest.mark.gate
def test_whole_periods_join_without_a_seam(model: LoopModel) -> None:
    part = part_of_logs(along(model, motion(True)))
    assert part is not None
    own = part.model.experiments["run_1"]
    period = round(2.0 / STEP)
    values = own.reference.values
    assert own.time.size == own.reference.time.size == 6 * period
    np.testing.assert_allclose(values[period:], values[:-period], atol=1e-9)


@pytest.mark.gate
@pytest.mark.parametrize("periodic", [True, False])
def test_measured_positions_stay_beside_their_reference(model: LoopModel, periodic: bool) -> None:
    reference = motion(periodic)
    whole = along(model, reference)
    measured = Trajectory(reference.time, 1.0 + reference.values[:, :2], reference.variables[:2])
    part = part_of_logs(whole.with_experiment("run_1", replace(whole.experiments["run_1"], positions=measured)))
    assert part is not None
    own = part.model.experiments["run_1"]
    assert own.positions is not None and own.positions.time.size == own.time.size
    at = np.searchsorted(own.reference.time, own.positions.time - 1e-6)
    np.testing.assert_allclose(own.positions.values, 1.0 + own.reference.values[at, :2], atol=1e-12)


@pytest.mark.gate
def test_of_a_log_of_a_part_of_its_motion_that_part_is_taken(model: LoopModel) -> None:
    whole = along(model, motion(True, 30_000))
    part = part_of_logs(whole.with_experiment("run_1", whole.experiments["run_1"].before(6000)))
    assert part is not None and part.model.experiments["run_1"].reference.time.size == stretches.PART
    late = whole.experiments["run_1"].at(np.arange(24_000, 30_000))
    assert part_of_logs(whole.with_experiment("run_1", late)) is None  # a run that is judged begins with its motion


@pytest.mark.gate
def test_a_seam_moves_no_faster_than_the_motion(model: LoopModel) -> None:
    reference = motion(False)
    part = part_of_logs(along(model, reference))
    assert part is not None
    own = part.model.experiments["run_1"].reference
    for name in ("q1", "q2", "dq1", "dq2"):
        slope = np.abs(np.diff(own.column(name))).max() / STEP
        assert slope < 2.5 * np.abs(np.diff(reference.column(name))).max() / STEP, name
    np.testing.assert_allclose(np.gradient(own.column("q1"), STEP)[2:-2], own.column("dq1")[2:-2], atol=0.01)


def pushed(model: LoopModel) -> LoopModel:
    from fmu_didim.model.external_torque import ExternalTorque

    return model.pushed("run_1", [ExternalTorque(1, 1.0, 2.0, 0.5)])


@pytest.mark.gate
@pytest.mark.parametrize(
    "other",
    [
        lambda m: m.with_low_pass(LowPass(10.0, 4)),
        lambda m: m.with_experiment("run_1", replace(m.experiments["run_1"], leaves_out_outliers=True)),
        lambda m: m.with_experiment("run_1", replace(m.experiments["run_1"], is_unsigned=True)),
        lambda m: m.with_experiment("run_1", m.experiments["run_1"].before(4000)),
        pushed,
    ],
    ids=["filtered", "without outliers", "without signs", "short", "pushed"],
)
def test_other_logs_are_judged_whole(model: LoopModel, other: Any) -> None:
    whole = along(model, motion(True))
    assert part_of_logs(whole) is not None
    assert part_of_logs(other(whole)) is None
