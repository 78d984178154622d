"""Inputs and outputs of a model against analytic answers: instants, gaps, steps, ramps, and what covers what."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.case import Case
from fmu_didim.case.calibration.inputs import read_inputs
from fmu_didim.case.calibration.model import whole_numbers
from fmu_didim.case.sources import InputsFile
from fmu_didim.components.fmu import load_fmu
from fmu_didim.data.signals import Array, Trajectory, Variable, trajectory
from fmu_didim.fit.estimate import Estimate
from tests.awkward.build import library, pack
from tests.awkward.versions import TYPED_2
from tests.case.calibration.models import case_of, noisy, ramp_of_lag, steps_of_lag

TRUTH: Mapping[str, float] = {"T": 1.5, "k": 2.0, "y0": 0.5}
ANSWER = np.array(list(TRUTH.values()))
STEPS = {0.0: 0.0, 2.0: 1.0, 5.0: -0.5}
TIME = np.linspace(0, 9, 91)
NOISE = 0.01


def stepped(time: Array = TIME, *, start: float = TRUTH["y0"]) -> Array:
    return steps_of_lag(time, STEPS, constant=TRUTH["T"], gain=TRUTH["k"], start=start)


def input_rows(instants: Array | None = None) -> Trajectory:
    rows = np.array([*STEPS, TIME[-1]]) if instants is None else instants
    held = np.array(list(STEPS.values()))[np.searchsorted(list(STEPS), rows, side="right") - 1]
    return trajectory(rows, {"u": held})


def lag_case(signals: Mapping[str, Trajectory], folder: Path = Path(), **entries: Any) -> Case:
    given: dict[str, Any] = {
        "inputs": {"file": "u", "interpolation": "held"}, "measured": "y", "identify": {name: {} for name in TRUTH}
    }  # fmt: skip
    return case_of("lag", signals, folder, **{**given, **entries})


def estimated(case: Case) -> Estimate:
    return case.estimator.estimate(case.model)


def is_right(found: Estimate, answer: Array = ANSWER) -> bool:
    return bool((np.abs(found.value - answer) < 4 * found.standard_deviation).all())


def outputs_at(case: Case, *values: float) -> Array:
    model = case.model
    return model.torque(np.array(values))[:, 0]


@pytest.mark.parametrize("rows", [None, np.linspace(0, 9, 10)], ids=["rows at the steps", "a row a second"])
def test_steps_of_an_input_are_honoured(rows: Array | None) -> None:
    """Samples lie at instants of their own, none of them at a step."""
    time = np.sort(np.random.default_rng(0).uniform(0, 9, 60))
    case = lag_case({"u": input_rows(rows), "y": trajectory(time, {"y": stepped(time)})})
    np.testing.assert_allclose(outputs_at(case, *ANSWER), stepped(time), atol=2e-6)
    found = estimated(case)
    np.testing.assert_allclose(found.value, ANSWER, rtol=1e-5)


@pytest.mark.parametrize(("interpolation", "atol"), [("linear", 6e-4), ("held", 0.5)])
def test_a_ramp_is_a_straight_line_between_its_rows(interpolation: str, atol: float) -> None:
    """u = 0.4 t in two rows: held, it is zero all the time."""
    ramp = trajectory(np.array([0.0, 9.0]), {"u": np.array([0.0, 3.6])})
    y = ramp_of_lag(TIME, 0.4, constant=1.5, gain=2.0, start=0.5)
    signals = {"u": ramp, "y": trajectory(TIME, {"y": y})}
    case = lag_case(signals, inputs={"file": "u", "interpolation": interpolation})
    got, held = outputs_at(case, *ANSWER), 0.5 * np.exp(-TIME / 1.5)
    np.testing.assert_allclose(got, y if interpolation == "linear" else held, atol=6e-4)
    assert (np.abs(got - y).max() < atol) == (interpolation == "linear")


def test_before_and_after_the_rows_an_input_is_refused_or_held() -> None:
    rows = input_rows(np.linspace(0, 7, 8))
    signals = {"u": rows, "y": trajectory(TIME, {"y": stepped()})}
    with pytest.raises(InputError, match=r"do not cover what was measured[\s\S]*from 0 to 7 s[\s\S]*outside: hold"):
        lag_case(signals)
    held = lag_case(signals, inputs={"file": "u", "interpolation": "held", "outside": "hold"})
    np.testing.assert_allclose(outputs_at(held, *ANSWER), stepped(), atol=2e-6)
    late = {"u": input_rows(np.linspace(1, 9, 9)), "y": signals["y"]}
    with pytest.raises(InputError, match=r"inputs from 1 to 9 s"):
        lag_case(late)
    before = lag_case(late, inputs={"file": "u", "interpolation": "held", "outside": "hold"})
    np.testing.assert_allclose(outputs_at(before, *ANSWER), stepped(), atol=2e-6)


def test_an_input_with_an_empty_row_is_refused(tmp_path: Path) -> None:
    (tmp_path / "u.csv").write_text("t,u\n0,1\n3,\n9,2\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"no number in some rows[\s\S]*1 empty rows of 3"):
        lag_case({"y": trajectory(TIME, {"y": stepped()})}, folder=tmp_path, inputs="u.csv")


def two_outputs(seed: int, folder: Path) -> Case:
    """y in a file with gaps, z = g y in another one at other instants with another noise, stated."""
    rng = np.random.default_rng(seed)
    first = noisy(TIME, {"y": stepped()}, NOISE, seed).column("y")
    rows = [f"{t:.6f},{y if there else ''}" for t, y, there in
            zip(TIME, first, rng.uniform(size=TIME.size) > 0.3, strict=True)]  # fmt: skip
    (folder / "y.csv").write_text("\n".join(["t,y", *rows]), encoding="utf-8")
    other = np.sort(rng.uniform(0.05, 8.9, 40))
    signals = {"u": input_rows(), "z": trajectory(other, {"z in file": 3 * stepped(other) + 0.1 * rng.normal(size=40)})}
    measured = ["y.csv", {"file": "z", "columns": {"z": {"name": "z in file", "std": 0.1}}}]
    identify = {**{name: {} for name in TRUTH}, "g": {"start": 2.0}}
    return lag_case(signals, folder=folder, measured=measured, identify=identify)


def test_outputs_have_their_own_files_instants_gaps_and_noise(tmp_path: Path) -> None:
    case = two_outputs(1, tmp_path)
    model = case.model
    assert model.loop.output_signals == ("model.y",)
    assert model.experiments.channels == ("z",)
    y, z = model.experiments.output_counts
    assert 50 < y < 80
    assert z == 40
    found = estimated(case)
    assert is_right(found, np.array([*ANSWER, 3.0]))
    assert found.joint is not None
    assert found.joint.channels[0].is_stated


@pytest.mark.gate
def test_intervals_from_several_outputs_hold_as_often_as_they_say(tmp_path: Path) -> None:
    truth = np.array([*ANSWER, 3.0])
    found = [estimated(two_outputs(100 + seed, tmp_path)) for seed in range(60)]
    hits = [(low < truth) & (high > truth) for low, high in (one.interval().T for one in found)]
    assert (np.mean(hits, axis=0) > 0.84).all()  # 95 of 100 +- 2.8
    values, deviation = (np.array([getattr(one, what) for one in found]) for what in ("value", "standard_deviation"))
    ratio = values.std(axis=0) / deviation.mean(axis=0)
    assert ((ratio > 0.7) & (ratio < 1.3)).all()


def replicates(seed: int) -> Case:
    """Three runs: constant and gain are shared, each start is its own."""
    starts = {"a": 0.5, "b": 2.0, "c": -1.0}
    signals = {"u": input_rows()} | {
        label: noisy(TIME, {"y": stepped(start=start)}, NOISE, 10 * seed + i)
        for i, (label, start) in enumerate(starts.items())
    }
    runs = {
        label: {
            "inputs": {"file": "u", "interpolation": "held"},
            "measured": label,
            "own": ["y0"] if label != "a" else [],
        }
        for label in starts
    }
    return case_of("lag", signals, experiments=runs, identify={name: {} for name in TRUTH})


def test_replicates_share_values_and_have_their_own() -> None:
    found = estimated(replicates(1))
    assert found.names == ("T", "k", "y0", "y0[b]", "y0[c]")
    assert is_right(found, np.array([1.5, 2.0, 0.5, 2.0, -1.0]))


@pytest.mark.slow
def test_intervals_from_replicates_hold_as_often_as_they_say() -> None:
    truth = np.array([1.5, 2.0, 0.5, 2.0, -1.0])
    hits = [(low < truth) & (high > truth) for low, high in
            (estimated(replicates(seed)).interval().T for seed in range(60))]  # fmt: skip
    assert (np.mean(hits, axis=0) > 0.84).all()


def test_experiments_of_other_outputs_need_one_in_common() -> None:
    signals = {"u": input_rows(), "y": trajectory(TIME, {"y": stepped()}), "z": trajectory(TIME, {"z": stepped()})}
    runs = {label: {"inputs": {"file": "u", "interpolation": "held"}, "measured": label} for label in ("y", "z")}
    with pytest.raises(InputError, match=r"No output was measured in all experiments[\s\S]*y; z"):
        case_of("lag", signals, experiments=runs, identify={"T": {}})
    runs["z"]["measured"] = ["y", "z"]  # type: ignore[assignment]
    both = case_of("lag", signals, experiments=runs, identify={"T": {}, "g": {}})
    assert both.model.experiments.channels == ("z",)


def test_a_held_out_run_is_judged_and_not_fitted() -> None:
    signals = {
        "u": input_rows(),
        "a": noisy(TIME, {"y": stepped()}, NOISE, 1),
        "b": noisy(TIME, {"y": stepped()}, 0.5, 2),
    }
    driven = {"inputs": {"file": "u", "interpolation": "held"}}
    runs = {"a": {**driven, "measured": "a"}, "b": {**driven, "measured": "b", "role": "validation"}}
    alone = case_of("lag", signals, experiments={"a": runs["a"]}, identify={name: {} for name in TRUTH})
    both = case_of("lag", signals, experiments=runs, identify={name: {} for name in TRUTH})
    np.testing.assert_array_equal(estimated(alone).value, estimated(both).value)


def test_inputs_that_are_no_real_numbers_are_held(tmp_path: Path) -> None:
    """A gear and a switch stay where they are until the next row, where the real input follows its straight line."""
    pack(tmp_path / "typed2.fmu", TYPED_2, library("typed2"))
    assert whole_numbers(load_fmu(tmp_path / "typed2.fmu")) == {"gear", "on", "mode"}
    rows = trajectory(np.array([0.0, 4.0, 9.0]), {"gear": np.array([1.0, 3.0, 3.0]), "u": np.array([0.0, 4.0, 9.0])})
    driven = read_inputs(InputsFile(file="u"), Path(), {"gear": Variable("gear"), "u": Variable("u")},
                         held={"gear"}, signals={"u": rows})  # fmt: skip
    at = np.array([1.0, 3.9, 4.0, 5.0])
    assert driven.by_name["gear"].at(at).tolist() == [1.0, 1.0, 3.0, 3.0]
    np.testing.assert_allclose(driven.by_name["u"].at(at), at)
