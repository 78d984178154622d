"""Discovery on plants of which only an FMU is known: effects are put before them as components."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import yaml

from fmu_didim.case import load_case
from fmu_didim.components import load_fmu
from fmu_didim.discovery.augmentation.black_box import acts_on_own_joint, torque_part
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder, Proposal
from fmu_didim.effects import EFFECTS, Surroundings, TorqueEffect
from fmu_didim.export import build_fmu
from fmu_didim.prediction.loop_model import EffectAtJoint
from fmu_didim.robot import RobotModel, read_robot, write_robot
from fmu_didim.signals import trajectory, write_csv
from fmu_didim.workflow import simulate
from fmu_didim.workflow.discover import discover

NOISE = (0.03, 0.003)
"""Standard deviation of the torque log of the joints, N.m."""
IDENTIFY = {
    "J1": "ZZ1", "d1": "Fv1", "c1": "Fc1", "J2": "ZZ2", "mx2": "MX2", "my2": "MY2", "d2": "Fv2", "c2": "Fc2",
}  # fmt: skip


def sines(seed: int, seconds: float = 12.0, period_s: float = 4.0, rate_hz: float = 200.0) -> Any:
    """A periodic motion of both joints, slow and fast."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    columns = {}
    for j, size in ((1, 0.5), (2, 0.6)):
        phase, q, dq, ddq = rng.uniform(0, 2 * np.pi, 4), 0.0, 0.0, 0.0
        for i, k in enumerate((1, 2, 3, 5)):
            w, a = 2 * np.pi * k / period_s, size / k
            q = q + a * np.sin(w * time + phase[i])
            dq = dq + a * w * np.cos(w * time + phase[i])
            ddq = ddq - a * w**2 * np.sin(w * time + phase[i])
        columns |= {f"q{j}": q, f"dq{j}": dq, f"ddq{j}": ddq}
    return trajectory(time, columns)


def vendor_case(folder: Path, hidden: str = "", joint: int = 1, *, late: int = 0, **values: float) -> Path:
    """A case whose plant is an FMU without the hidden effect, its data made by a robot with it, noise added.

    Args:
        late: control periods by which the torque log is stamped late.
    """
    robot = read_robot("fmus/scara/robot.yaml")
    plant = build_fmu(RobotModel(robot).block(), directory=folder)
    joints = list(robot.joints)
    if hidden:
        own = joints[joint - 1]
        joints[joint - 1] = own.model_copy(
            update={"effects": (*own.effects, hidden), "parameters": {**own.parameters, **values}}
        )
    truth = robot.model_copy(update={"joints": tuple(joints)})
    write_robot(truth, folder / "truth.yaml")
    document: dict[str, Any] = {
        "schema": 1, "name": "vendor", "plant": {"kind": "fmu", "source": str(plant)},
        "controller": {"kind": "fmu", "source": str(Path("controllers/scara_pd.yaml").resolve())},
        "identify": {
            name: {"parameter": own, **({"minimum": 1e-3} if name.startswith("J") else {})}
            for name, own in IDENTIFY.items()
        },
        "estimator": {"kind": "clie"},
    }  # fmt: skip
    rng = np.random.default_rng(5)
    for label, seed in (("train", 1), ("validation", 2)):
        write_csv(sines(seed), folder / f"{label}_reference.csv")
        reference = {"file": f"{label}_reference.csv"}
        making = {
            **{k: v for k, v in document.items() if k not in ("identify", "estimator")},
            "robot": "truth.yaml", "plant": {"kind": "fmu"},
            "train": {"reference": reference, "torque": {"file": "none.csv", "rate_hz": 100}},
        }  # fmt: skip
        (folder / "making.yaml").write_text(yaml.safe_dump(making), encoding="utf-8")
        table = simulate(folder / "making.yaml")
        torque = table.select(["tau1", "tau2"])[np.maximum(np.arange(0, table.time.size - 1, 2) - late, 0)]
        torque = torque + np.array(NOISE) * rng.normal(size=torque.shape)
        write_csv(trajectory(table.time[:-1:2], {"tau1": torque[:, 0], "tau2": torque[:, 1]}), folder / f"{label}.csv")
        document[label] = {"reference": reference, "torque": {"file": f"{label}.csv"}}
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("hidden", "joint", "values", "kind"),
    [
        ("actuator_lag", 1, {"T": 0.006}, "lag"),
        ("stribeck", 2, {"Fs": 0.08, "vs": 0.15}, "stribeck"),
    ],
)
def test_hidden_effect_is_named_and_spliced_in(
    tmp_path: Path, hidden: str, joint: int, values: dict[str, float], kind: str
) -> None:
    found = discover(vendor_case(tmp_path, hidden, joint, **values), tmp_path / "out")
    assert [(f.class_, f.joint) for f in found.findings] == [(kind, joint)]
    assert found.verdict == "named"
    truth = {name: value for name, value in values.items() if name in ("T", "Fs", "vs")}
    for value in found.findings[0].parameters:
        wanted = truth[value.name.rstrip("12").rstrip("_")]
        assert abs(value.value - wanted) < max(4 * (value.std or 0), 0.03 * wanted)
    for label in ("estimation", "validation"):
        before, after = found.gap[label].before, found.gap[label].after
        assert before is not None
        assert after is not None
        assert before > 1.0
        assert after < 0.4 * before
    assert found.ratio_interval is not None
    assert (found.ratio_interval[1] or 9.0) < 1.0
    part = load_fmu(tmp_path / "out" / found.files[f"part_{found.findings[0].effect}{joint}"])
    assert [v.name for v in part.inputs] == (["u"] if hidden == "actuator_lag" else ["u", "q", "dq"])


def test_late_log_is_named_and_told_to_the_case(tmp_path: Path) -> None:
    found = discover(vendor_case(tmp_path, late=3), tmp_path / "out")
    assert [(f.effect, f.joint) for f in found.findings] == [("log_time_shift", 1)]
    (value,) = found.findings[0].parameters
    assert value.interval[0] < 0.015 < value.interval[1]  # type: ignore[operator]
    (note,) = [n for n in found.notes if "augmented loop" in n]
    assert f"log_shift_s: {value.value:.6g}" in note
    assert float(note.split(" to ")[1].split(" of ")[0]) < 1e-12


def test_nothing_is_named_on_a_plant_that_is_complete(tmp_path: Path) -> None:
    found = discover(vendor_case(tmp_path))
    assert (found.verdict, found.findings) == ("nothing", [])


OWN = sorted(
    name
    for name, effect in EFFECTS.items()
    if isinstance(effect, TorqueEffect) and acts_on_own_joint(effect, "revolute")
)


def test_which_effects_can_be_put_before_a_black_box() -> None:
    assert {"stribeck", "asymmetric_viscous", "torque_offset", "spring", "presliding", "contact_stop"} <= set(OWN)
    assert not {"load_dependent_friction", "wrist_friction", "payload_change", "motor_inertia"} & set(OWN)


@pytest.mark.parametrize("name", OWN)
def test_component_takes_the_torque_of_the_effect_away(name: str) -> None:
    effect = EFFECTS[name]
    assert isinstance(effect, TorqueEffect)
    block = torque_part(effect).block("revolute", 0.005)
    rng = np.random.default_rng(3)
    u, q, dq = rng.normal(size=3)
    states = rng.uniform(0, 1e-3, len(effect.states("revolute")))
    amplitudes, shapes = effect.parameters("revolute"), effect.shapes("revolute")
    sizes = rng.uniform(0.5, 1.5, len(amplitudes))
    time = 1.3
    at = Surroundings(
        joint=0, joint_type="revolute", all_q=ca.SX(q), all_dq=ca.SX(dq), all_ddq=ca.SX(0), time=ca.SX(time),
        state=tuple(ca.SX(z) for z in states),
    )  # fmt: skip
    columns = effect.columns(at, {v.name: ca.SX(v.start) for v in shapes})
    expected = u - sum(a * float(ca.evalf(ca.SX(c))) for a, c in zip(sizes, columns, strict=True))
    clock = [time] if "time" in effect.needs else []
    parameters = [*sizes, *(v.start for v in shapes), *([0.0] * len(clock))]
    got = float(block.output([*states, *clock], [u, q, dq], parameters))
    assert got == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_friction_before_the_plant_is_friction_in_the_plant(tmp_path: Path) -> None:
    """With short enough steps the loop gives the torque of a robot that has the effect; one a period is too long."""
    base = load_case(vendor_case(tmp_path, "stribeck", 2, Fs=0.08, vs=0.15)).model
    assert base is not None
    shop = LoopModelBuilder(base, None)
    model = shop.build(base, [Proposal(EffectAtJoint("stribeck", 2), {"Fs": 0.08, "vs": 0.15})])
    assert model.subdivision > 1
    misfit = [
        np.std(replace(model, subdivision=m).residual(model.start), axis=0)[1] / NOISE[1]
        for m in (1, model.subdivision)
    ]
    assert misfit[0] > 1.1
    assert misfit[1] == pytest.approx(1.0, abs=0.05)
