"""IDIM-IV beside IDIM-LS on measured positions: bias, intervals, another controller, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from fmu_didim import Case, Result, identify, load_case, simulate, trajectory
from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.estimators.idim_iv import WEAK, IdimIv, cragg_donald
from fmu_didim.estimators.idim_ls import IdimLs, acting_instants, on_even_grid
from fmu_didim.fit.estimate import RefusedError
from tests.helpers import ROOT

SCARA = ROOT / "examples/scara/identify.yaml"
OPTIONS = {"cutoff_hz": 40, "decimation": 4}
TORQUE_STD = (0.17, 0.0065)
"""[N.m] 5 % of the torque."""
POSITION_STD = 2e-4
"""[rad] Of an encoder that is coarse: what it leaves of the acceleration is as large as the motion's."""


@cache
def motion(delay: float = 0.0) -> Trajectory:
    """What a logger shows of the loop at its control rate, with the values of the description, and a delay in control
    periods: the command, which acts that much later, and the positions at the same instants."""
    loop = {"loop": {"delay_samples": delay}} if delay else {}
    return simulate(load_case(SCARA).with_(plant={"kind": "model"}, controller={"kind": "model"}, **loop))


@cache
def truth() -> dict[str, float]:
    model = load_case(SCARA).model
    return dict(zip(model.names, map(float, model.start), strict=True))


def case_of(kind: str, seed: int, position_std: float = POSITION_STD, delay: float = 0.0, **changes: Any) -> Case:
    """A case with noisy torques and positions at the control rate."""
    rng, names = np.random.default_rng(seed), ("q1", "q2", "tau1", "tau2")
    std = np.array((position_std, position_std, *TORQUE_STD))
    table = motion(delay).select(names)
    table = table + std * rng.normal(size=table.shape)
    log = trajectory(motion(delay).time, dict(zip(names, table.T, strict=True)))
    changes = ({"loop": {"delay_samples": delay}} if delay else {}) | changes
    content = dict(load_case(SCARA).content)
    content["train"] = content["train"] | {"torque": {"file": "log"}, "positions": {"file": "log"}}
    content |= {"plant": {"kind": "model"}, "controller": {**content["controller"], "kind": "model"}}
    content |= {"estimator": {"kind": kind, **OPTIONS}, **changes}
    content.pop("validation")
    return load_case(content, folder=SCARA.parent, signals={"log": log})


def errors_of(found: Result) -> Array:
    """(b,) errors of the values, over their standard deviations."""
    return np.array([(p.value - truth()[name]) / p.std for name, p in found.parameters.items()])


@pytest.mark.gate
@pytest.mark.parametrize("draws", [6, pytest.param(60, marks=pytest.mark.slow)])
def test_noise_of_positions_biases_least_squares_and_not_instruments(draws: int) -> None:
    errors = {
        kind: np.array([errors_of(identify(case_of(kind, seed))) for seed in range(draws)])
        for kind in ("idim_ls", "idim_iv")
    }
    inertia = list(truth()).index("ZZ2")
    assert errors["idim_ls"][:, inertia].mean() < -3
    assert np.abs(errors["idim_iv"].mean(axis=0)).max() < 1.2
    inside = np.abs(errors["idim_iv"]) < 1.96
    assert inside.mean() >= 0.92  # intervals are wide where noise is twice differentiated, not narrow


def test_values_of_no_machine_become_the_nearest_of_one_and_are_a_doubt() -> None:
    """A torque of joint 2 that lacks its inertia and a little more; where the loop of the case cannot move what is
    left, or much more is lacking, it is refused."""
    whole = case_of("idim_ls", 0, 2e-5)
    log, run = whole.signals["log"], motion()
    column, inertia = log.names.index("tau2"), truth()["ZZ2"]

    def answer(lacks: float, **changes: Any) -> Result:
        values = log.values.copy()
        values[:, column] -= lacks * (run.column("ddq1") + run.column("ddq2"))
        signals = {"log": replace(log, values=values)}
        return identify(load_case({**whole.content, **changes}, folder=SCARA.parent, signals=signals))

    virtual = {"controller": {"kind": "tracking"}, "loop": {"rate_hz": 200}}
    found = answer(1.02 * inertia, **virtual)
    assert found.parameters["ZZ2"].value > 0
    assert found.verdict == "doubtful"
    told = {reason.code: reason.text for reason in found.reasons}
    assert told["mass-matrix-indefinite"].startswith("By the data alone: ")  # of those that are given it is definite
    assert "nearest that a machine can have" in " ".join(found.document.remarks)
    for lacks, changes in ((1.02, {}), (3.0, virtual)):
        with pytest.raises(RefusedError, match="not physical"):
            answer(lacks * inertia, **changes)


def test_a_part_of_the_log_gives_what_that_part_alone_gives() -> None:
    """Torque is taken from ``from_s`` to ``to_s``; positions of the same file at the same instants go with it."""
    whole, part = case_of("idim_ls", 0), {"from_s": 2.0, "to_s": 8.0}
    log = whole.signals["log"]
    kept = (log.time >= 2.0 - 1e-9) & (log.time <= 8.0 + 1e-9)
    train = {**whole.content["train"], **part}
    alone = replace(log, time=log.time[kept], values=log.values[kept])
    found = [
        identify(load_case({**whole.content, "train": train}, folder=SCARA.parent, signals={"log": one})).parameters
        for one in (log, alone)
    ]
    assert {name: p.value for name, p in found[0].items()} == {name: p.value for name, p in found[1].items()}


@pytest.mark.gate
@pytest.mark.parametrize(
    "lacks",
    [
        lambda time: (time > 5) & (time < 5.5),
        lambda time: np.random.default_rng(1).random(time.size) < 0.02,
    ],
    ids=["half a second", "rows here and there"],
)
def test_rows_that_are_missing_do_not_bias(lacks: Callable[[Array], NDArray[np.bool_]]) -> None:
    """Rows taken for even ones put velocities and accelerations off: an error of ten sigma, or no machine at all."""
    whole = case_of("idim_ls", 0, 2e-5)
    log = whole.signals["log"]
    kept = ~lacks(log.time)
    kept[[0, -1]] = True
    signals = {"log": replace(log, time=log.time[kept], values=log.values[kept])}
    found = identify(load_case(dict(whole.content), folder=SCARA.parent, signals=signals))
    assert np.abs(errors_of(found)).max() < 3


def test_what_lies_beside_a_gap_is_left_out_and_even_rows_stay_as_they_are() -> None:
    estimator = IdimLs(cutoff_hz=50.0, skip=10)
    time = 0.001 * np.delete(np.arange(1000), slice(500, 550))
    lacking = time[np.setdiff1d(np.arange(time.size), estimator.inner(time))]
    assert lacking[10] == pytest.approx(0.479) and lacking[-11] == pytest.approx(0.57)
    even = 0.001 * np.arange(1000)
    assert on_even_grid(even, np.zeros((1000, 2)))[0] is even
    grid, q = on_even_grid(time, np.sin(6 * time)[:, None])
    assert grid == pytest.approx(even) and q[:, 0] == pytest.approx(np.sin(6 * even), abs=1e-6)


def test_positions_between_the_samples_of_the_torque_are_refused_with_both_times() -> None:
    whole = case_of("idim_ls", 0)
    log = whole.signals["log"]
    late = {"log": log, "positions": replace(log, time=log.time + 0.001)}
    train = {**whole.content["train"], "positions": {"file": "positions"}}
    with pytest.raises(InputError, match=r"idim_ls needs .* same instants[^$]*positions \d+ samples from 0.001 to"):
        identify(load_case({**whole.content, "train": train}, folder=SCARA.parent, signals=late))


@pytest.mark.gate
@pytest.mark.parametrize("delay", [0.0, 0.5, pytest.param(1.0, marks=pytest.mark.slow)])
def test_torque_counts_where_it_acts_and_friction_as_the_description_has_it(delay: float) -> None:
    """Positions without noise leave least squares no bias; at the instants of the samples, and with a sharp
    friction, as publications have it, it is many standard deviations."""
    as_published = {"estimator": {"kind": "idim_ls", **OPTIONS, "held": False, "sharp_coulomb": True}}
    cases = {"own": dict[str, Any](), "published": as_published}
    errors = {
        name: np.mean(
            [errors_of(identify(case_of("idim_ls", seed, 1e-6, delay, **changes))) for seed in range(8)], axis=0
        )
        for name, changes in cases.items()
    }
    assert np.abs(errors["own"]).max() < 1.4  # the mean of eight draws has a deviation of 0.35
    assert np.abs(errors["published"]).max() > 4


def test_instants_at_which_a_sample_acts() -> None:
    """In the middle of its control period of 5 ms, a delay later."""
    for delay in (0.0, 0.5, 2.0):
        model = case_of("idim_ls", 1, delay=delay).model
        late = acting_instants(model, model.first) - model.experiments[model.first].time
        assert late == pytest.approx(np.full(late.size, 0.005 * (0.5 + delay)), abs=1e-12)


def test_gains_that_are_far_off_hardly_change_the_answer(tmp_path: Path) -> None:
    """The motion still follows the reference, and is no less correlated with the measured one."""
    law = yaml.safe_load((ROOT / "controllers/scara_pd.yaml").read_text(encoding="utf-8"))
    law |= {name: [0.3 * gain for gain in law[name]] for name in ("Kp", "Kd")}
    (tmp_path / "soft.yaml").write_text(yaml.safe_dump(law), encoding="utf-8")
    right = identify(case_of("idim_iv", 1))
    off = identify(case_of("idim_iv", 1, controller={"kind": "model", "source": str(tmp_path / "soft.yaml")}))
    assert np.abs(errors_of(off)).max() < 2
    assert np.abs(errors_of(right) - errors_of(off)).max() < 0.5


def test_stages_show_what_instruments_change() -> None:
    found = identify(case_of("idim_iv", 2))
    assert found.document.status == "converged"
    assert list(found.document.stages) == ["idim_ls", "idim_iv"]
    least_squares = found.document.stages["idim_ls"].value["ZZ2"]
    assert found.values["ZZ2"] == found.document.stages["idim_iv"].value["ZZ2"]
    assert abs(least_squares - truth()["ZZ2"]) > 3 * abs(found.values["ZZ2"] - truth()["ZZ2"])


def test_iterations_that_do_not_settle_are_said() -> None:
    found = identify(case_of("idim_iv", 2, estimator={"kind": "idim_iv", **OPTIONS, "maximum_iterations": 1}))
    assert found.document.status == "maximum_iterations" and found.verdict != "valid"


def test_the_strength_of_instruments() -> None:
    """F of the first stage: the columns themselves are as strong as can be, foreign ones of chance alone."""
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(2000, 4))
    assert cragg_donald(columns @ rng.normal(size=(4, 4)), columns) > 1e9
    assert cragg_donald(rng.normal(size=(2000, 4)), columns) < 1.5
    noisy = columns + rng.normal(size=columns.shape)  # half of the variance is that of the motion
    assert cragg_donald(columns, noisy) == pytest.approx(2000 / 4, rel=0.2)


def test_a_simulated_motion_that_is_another_is_refused(tmp_path: Path) -> None:
    """A controller that hardly moves the robot."""
    law = yaml.safe_load((ROOT / "controllers/scara_pd.yaml").read_text(encoding="utf-8"))
    law |= {name: [1e-4 * gain for gain in law[name]] for name in ("Kp", "Kd")}
    (tmp_path / "dead.yaml").write_text(yaml.safe_dump(law), encoding="utf-8")
    model = case_of("idim_iv", 1, controller={"kind": "model", "source": str(tmp_path / "dead.yaml")}).model
    with pytest.raises(RefusedError, match="hardly correlated") as caught:
        IdimIv(cutoff_hz=40, decimation=4).estimate(model)
    assert f"{WEAK:g} or more" in str(caught.value) and "controller" in str(caught.value)


def test_positions_are_needed() -> None:
    with pytest.raises(InputError, match="idim_iv needs measured positions"):
        identify(load_case(SCARA).with_(estimator={"kind": "idim_iv"}))
