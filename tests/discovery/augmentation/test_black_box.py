"""Discovery on plants of which only an FMU is known: effects are put before them as components."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from fmu_didim import discover
from fmu_didim.case import load_case
from fmu_didim.components import load_fmu
from fmu_didim.discovery.augmentation.black_box import acts_on_own_joint, torque_part
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.dynamics.effects import EFFECTS, Surroundings, TorqueEffect
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.vendor import NOISE, vendor_case


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "joint", "values", "kind"),
    [
        ("actuator_lag", 1, {"T": 0.006}, "lag"),
        ("stribeck", 2, {"Fs": 0.08, "vs": 0.15}, "stribeck"),
        ("voltage_limit", 1, {"stall": 41.0, "no_load_speed": 9.0}, "saturation"),
    ],
)
def test_hidden_effect_is_named_and_spliced_in(
    tmp_path: Path, hidden: str, joint: int, values: dict[str, float], kind: str
) -> None:
    found = discover(vendor_case(tmp_path, hidden, joint, **values), tmp_path / "out")
    assert [(f.class_, f.joint) for f in found.findings] == [(kind, joint)]
    assert found.answer == "named"
    truth = {name: value for name, value in values.items() if name in ("T", "Fs", "vs", "stall", "no_load_speed")}
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
    inputs = {"actuator_lag": ["u"], "stribeck": ["u", "q", "dq"], "voltage_limit": ["u", "dq"]}
    assert [v.name for v in part.inputs] == inputs[hidden]


@pytest.mark.slow
def test_late_log_is_named_and_told_to_the_case(tmp_path: Path) -> None:
    found = discover(vendor_case(tmp_path, late=3), tmp_path / "out")
    assert [(f.effect, f.joint) for f in found.findings] == [("log_time_shift", 1)]
    (value,) = found.findings[0].parameters
    assert value.interval[0] < 0.015 < value.interval[1]  # type: ignore[operator]
    (note,) = [n for n in found.notes if "augmented loop" in n]
    assert f"log_shift_s: {value.value:.6g}" in note
    assert float(note.split(" to ")[1].split(" of ")[0]) < 1e-12


@pytest.mark.gate
def test_nothing_is_named_on_a_plant_that_is_complete(tmp_path: Path) -> None:
    found = discover(vendor_case(tmp_path))
    assert (found.answer, found.findings) == ("nothing", [])


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


@pytest.mark.gate
def test_friction_before_the_plant_is_friction_in_the_plant(tmp_path: Path) -> None:
    """With short enough steps the loop gives the torque of a robot that has the effect; one a period is too long."""
    base = load_case(vendor_case(tmp_path, "stribeck", 2, Fs=0.08, vs=0.15)).model
    assert base is not None
    shop = LoopModelBuilder(base, None)
    model = shop.build(base, [Proposal(EffectAtJoint("stribeck", 2), {"Fs": 0.08, "vs": 0.15})])
    assert model.loop.subdivision > 1
    misfit = [
        np.std(model.with_loop(subdivision=m).residual(model.start), axis=0)[1] / NOISE[1]
        for m in (1, model.loop.subdivision)
    ]
    assert misfit[0] > 1.1
    assert misfit[1] == pytest.approx(1.0, abs=0.05)
