"""Values that say nothing, and values that no machine can have."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from fmu_didim.base.diagnostics import DOUBT
from fmu_didim.data.signals import Trajectory, Variable
from fmu_didim.discovery.selection.plausible import chance_of_none, implausible, unusual_values
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.model.free_parameter import FreeParameter
from fmu_didim.model.loop_model import EffectAtJoint

CATALOGUE = SimpleNamespace(effect=lambda at: EFFECTS[at.effect], effects=EFFECTS)


def fit(effect: str, values: dict[str, tuple[float, float]], joint: int = 2) -> Any:
    """A fit with a base parameter and the values and deviations of an effect."""
    free = [FreeParameter("ZZ1", "kg.m2", "base", "ZZ1", 1.0, 1.0)]
    free += [FreeParameter(f"{n}{joint}", "1", "plant", n, v, 1.0, effect=0) for n, (v, _) in values.items()]
    model = SimpleNamespace(free_parameters=free, added_effects=(EffectAtJoint(effect, joint),))
    deviations = [0.1, *(s for _, s in values.values())]
    return SimpleNamespace(
        model=model, values=np.array([p.value for p in free]), covariance=np.diag(np.square(deviations))
    )


@pytest.mark.parametrize(
    ("effect", "values", "link", "reason"),
    [
        ("stribeck", {"Fs": (1.0, 0.1)}, {}, ""),
        ("stribeck", {"Fs": (0.1, 1.5)}, {}, "may be absent: Fs = 0.1 ± 1.5 (p = 0.9"),
        ("stribeck", {"Fs": (-1.0, 0.1)}, {}, "physically impossible: Fs = -1 ± 0.1 below 0"),
        ("stribeck", {"Fs": (-0.1, 0.1)}, {}, "may be absent"),
        ("spring", {"k": (-50.0, 2.0)}, {}, "physically impossible: k = -50 ± 2 below 0"),
        ("torque_offset", {"offset": (-1.0, 0.1)}, {}, ""),
        ("asymmetric_coulomb", {"Fca": (-1.0, 0.1)}, {}, ""),
        ("controller_gain", {"controller_gain": (1.05, 0.01)}, {}, ""),
        ("controller_gain", {"controller_gain": (0.1, 1.5)}, {}, "may be absent: controller_gain = 0.1 ± 1.5"),
        ("controller_gain", {"controller_gain": (1.01, 0.01)}, {}, "may be absent"),
        ("payload_change", {"dM": (-336.0, 5.0)}, {"M": 36.0}, "physically impossible: dM = -336 ± 5 kg taken off"),
        ("payload_change", {"dM": (-5.0, 0.1)}, {"M": 36.0}, ""),
        ("payload_change", {"dM": (-336.0, 5.0)}, {}, ""),
        ("payload_change", {"dM": (0.0, 1.0), "dMX": (2.0, 0.1)}, {}, ""),
        ("payload_change", {"dMX": (2.0, 0.1)}, {"M": 36.0}, ""),  # of a joint whose torque shows no mass
        ("joint_elasticity", {"K": (1e4, 100.0)}, {}, ""),
        ("joint_elasticity", {"K": (1e6, 0.7e6)}, {}, "may be absent"),
        ("actuator_lag", {"T": (0.002, 0.0001)}, {}, ""),
        ("actuator_lag", {"T": (0.0, 0.0001)}, {}, "may be absent"),
    ],
)  # fmt: skip
def test_values(effect: str, values: dict[str, tuple[float, float]], link: dict[str, float], reason: str) -> None:
    found = implausible(fit(effect, values), 0, EFFECTS[effect], link)
    assert found.startswith(reason) if reason else found == ""


@pytest.mark.parametrize(
    ("deviation", "reason"),
    [(110.0, "its form is not told: Fgc = 35 ± 1.1e+02, kgc = -900 ± 3e+03"), (100.0, "")],
)
def test_amplitudes_none_of_which_is_known_are_those_of_another_form(deviation: float, reason: str) -> None:
    """Together they are anything but nothing: a gravity compensator has imitated an offset beside a tilted base."""
    found = fit("gravity_compensator", {"Fgc": (35.0, deviation), "kgc": (-900.0, 3000.0)})
    found.covariance[1, 2] = found.covariance[2, 1] = -(1 - 1e-9) * deviation * 3000.0
    told = implausible(found, 0, EFFECTS["gravity_compensator"], {})
    assert told.startswith(reason) if reason else told == ""


@pytest.mark.parametrize(("end", "reason"), [(11.9, ""), (13.0, "lasts 55 % of the data")])
def test_a_torque_from_outside_that_lasts_is_something_else(end: float, reason: str) -> None:
    """Beside a drift that settles one of 13 s in 20 s was named, in a valid answer: it made up for the form."""
    found = fit("external_force", {"Fext": (0.6, 0.04), "t_on_": (2.0, 0.03), "t_off_": (end, 0.03)})
    found.model.free_parameters[2:] = [replace(p, is_shape=True) for p in found.model.free_parameters[2:]]
    found.model.experiments = {"a": SimpleNamespace(time=np.arange(0, 20, 0.01))}
    found.model.estimation_labels = ("a",)
    told = implausible(found, 0, EFFECTS["external_force"], {})
    assert told.startswith(reason) if reason else told == ""


@pytest.mark.parametrize(
    ("effect", "frequency", "moved", "reason"),
    [
        ("torque_ripple", 6.2, 1.95, "repeats 1.9 times over the range in which the joint moved"),
        ("current_ripple", 6.0, 2.0, "repeats 1.9 times"),
        ("torque_ripple", 6.6, 2.0, ""),
        ("torque_ripple", 6.2, 2.5, ""),
        ("torque_ripple", 6.2, 0.0, ""),  # no reference says how it moved
    ],
)
def test_a_ripple_repeats(effect: str, frequency: float, moved: float, reason: str) -> None:
    """A notch was named as a ripple that repeats 1.9 times and a stop."""
    found = fit(effect, {"Rsin": (0.6, 0.04), "Rcos": (0.3, 0.04), "nr_": (frequency, 0.1)})
    found.model.free_parameters[3:] = [replace(p, is_shape=True) for p in found.model.free_parameters[3:]]
    time = np.arange(0, 10, 0.01)
    position = moved * (1 - np.cos(np.pi * time)) / 2
    found.model.experiments = {
        "a": SimpleNamespace(reference=Trajectory(time, position[:, None], (Variable("q2", "rad"),)))
    }
    found.model.estimation_labels = ("a",)
    told = implausible(found, 0, EFFECTS[effect], {})
    assert told.startswith(reason) if reason else told == ""


@pytest.mark.parametrize(
    ("effect", "place", "moved", "told"),
    [
        ("contact_stop", 0.1, 2.0, ""),
        ("contact_stop", -0.1, 2.0, "acts at 55 % of the positions of the motion: usual is at its end."),
        ("contact_stop", -3.0, 2.0, "acts at 100 % of the positions"),
        ("contact_stop_lower", -0.1, 2.0, ""),
        ("contact_stop_lower", 0.1, 2.0, "acts at 55 % of the positions"),
        ("contact_stop", -3.0, 0.0, ""),  # no reference says how it moved
    ],
)
def test_a_stop_is_at_the_end_of_the_motion(effect: str, place: float, moved: float, told: str) -> None:
    """A constant torque was told as a stop that begins beyond the positions of the motion."""
    side = effect.removeprefix("contact_stop").strip("_") or "upper"
    found = fit(effect, {f"k{side}": (3.6, 0.1), f"q{side}_": (place, 0.03)})
    found.model.free_parameters[2:] = [replace(p, is_shape=True) for p in found.model.free_parameters[2:]]
    position = moved * np.linspace(-0.5, 0.5, 1001)
    time = np.arange(position.size) / 100
    found.model.experiments = {
        "a": SimpleNamespace(reference=Trajectory(time, position[:, None], (Variable("q2", "rad"),)))
    }
    found.model.estimation_labels = ("a",)
    doubts = unusual_values(found, CATALOGUE)  # type: ignore[arg-type]
    assert [one.text[: len(told)] for one in doubts] == ([told] if told else [])


@pytest.mark.parametrize(
    ("torque", "deviation", "span", "friction", "reason"),
    [
        (-6.0, 0.2, (6.1, 9.0), 8.0, "joint 2 stands still for 100 % of the time in which it acts, where its Coulomb"),
        (8.3, 0.2, (6.1, 9.0), 8.0, "joint 2 stands still"),  # perhaps 8
        (9.0, 0.2, (6.1, 9.0), 8.0, ""),  # more than friction holds
        (-6.0, 0.2, (6.1, 9.0), 0.0, ""),  # without friction
        (-6.0, 0.2, (5.0, 7.0), 8.0, ""),  # half of the time on the move
        (-6.0, 0.2, (1.0, 4.0), 8.0, ""),
    ],
)
def test_what_acts_on_a_joint_at_rest_may_be_its_friction(
    torque: float, deviation: float, span: tuple[float, float], friction: float, reason: str
) -> None:
    """A measured TX40 rests at the end of its log, held by friction: a torque from outside of 6.2 N.m was named."""
    found = fit("external_force", {"Fext": (torque, deviation), "t_on_": (span[0], 0.03), "t_off_": (span[1], 0.03)})
    found.model.free_parameters[2:] = [replace(p, is_shape=True) for p in found.model.free_parameters[2:]]
    found.model.free_parameters[0] = FreeParameter("Fc2", "N.m", "base", "Fc2", friction, 1.0)
    found.values[0] = friction
    time = np.arange(0, 10, 0.01)
    position = np.where(time < 6, 1 - np.cos(np.pi * time), 0.0)
    reference = Trajectory(time, position[:, None], (Variable("q2", "rad"),))
    found.model.experiments = {"a": SimpleNamespace(time=time, reference=reference)}
    found.model.estimation_labels = ("a",)
    told = implausible(found, 0, EFFECTS["external_force"], {})
    assert told.startswith(reason) if reason else told == ""


@pytest.mark.parametrize(
    ("torques", "begin", "reason"),
    [
        ((0.1, 5.0, 0.0), 6.1, "joint 2 stands still for 100 % of the time in which it acts"),  # joint 1: noise
        ((4.0, 5.0, 0.0), 6.1, "joints 1, 2 stand still for 100 % of the time in which it acts"),
        ((4.0, 9.0, 0.0), 6.1, ""),  # more than friction holds on joint 2
        ((0.1, 5.0, 2.0), 6.1, ""),  # joint 3 moves
        ((0.1, 5.0, 0.0), 3.0, ""),  # while it moves
        ((0.1, 0.0, 0.0), 6.1, ""),  # nothing that shows: other rules
    ],
)
def test_a_payload_that_changes_at_rest_may_be_friction(
    torques: tuple[float, float, float], begin: float, reason: str
) -> None:
    """What a load adds to each joint, of which 1 and 2 rest from 6 s on; friction 8 N.m, noise 1 N.m."""
    found = fit("payload_change", {"dM": (2.0, 0.0), "t_load_": (begin, 0.03)}, joint=3)
    found.model.free_parameters[2] = replace(found.model.free_parameters[2], is_shape=True)
    found.model.free_parameters += [FreeParameter(f"Fc{j}", "N.m", "base", f"Fc{j}", 8.0, 1.0) for j in (1, 2, 3)]
    found.values = np.array([p.value for p in found.model.free_parameters])
    time = np.arange(0, 10, 0.01)
    rests, moves = np.where(time < 6, 1 - np.cos(np.pi * time), 0.0), 1 - np.cos(np.pi * time)
    variables = tuple(Variable(f"q{j}", "rad") for j in (1, 2, 3))
    reference = Trajectory(time, np.column_stack([rests, rests, moves]), variables)
    found.model.experiments = {"a": SimpleNamespace(time=time, reference=reference)}
    found.model.estimation_labels = ("a",)
    jacobian = np.zeros((time.size, 3, found.values.size))
    jacobian[time >= begin, :, 1] = np.array(torques) / 2.0
    found.jacobian, found.deviation, found.torque_alone = jacobian, np.ones(3), found
    found.covariance = np.zeros((found.values.size, found.values.size))
    told = implausible(found, 0, EFFECTS["payload_change"], {})
    assert told.startswith(reason) if reason else told == ""


def test_chance_is_that_of_noise() -> None:
    """Estimates of nothing are called something in 5 % of the draws, however they are correlated."""
    rng = np.random.default_rng(0)
    root = np.array([[1.0, 0.0], [0.9, 0.1]])
    draws = np.array([3.0, -1.0]) + rng.normal(size=(2000, 2)) @ root.T
    chances = [chance_of_none(draw, root @ root.T, np.array([3.0, -1.0])) for draw in draws]
    assert abs(np.mean(np.array(chances) < 0.05) - 0.05) < 0.015
    assert stats.kstest(chances, "uniform").pvalue > 0.01


def test_effects_that_cannot_be_negative_say_so_for_amplitudes_they_have() -> None:
    for name, effect in EFFECTS.items():
        for parameter in effect.own_parameters:
            if parameter.least is not None:
                low = effect.limits.get(parameter.name, (-np.inf, np.inf))[0]
                assert low <= parameter.least, name


@pytest.mark.parametrize(
    ("effect", "values", "told"),
    [
        ("load_dependent_friction", {"Fl": (0.12, 0.01)}, ""),
        ("load_dependent_friction", {"Fl": (0.32, 0.02)}, ""),  # perhaps 0.3
        ("load_dependent_friction", {"Fl": (0.32, 0.005)}, "Fl = 0.32 ± 0.005, usual is 0 to 0.3."),
        ("directional_efficiency", {"Fldrive": (0.1, 0.01), "Flback": (0.5, 0.01)}, "Flback = 0.5 ± 0.01"),
        ("quadratic_viscous", {"Fq": (0.5, 0.01)}, ""),
        ("quadratic_viscous", {"Fq": (-0.01, 0.02)}, ""),
        ("quadratic_viscous", {"Fq": (-0.52, 0.02)}, "Fq = -0.52 ± 0.02, usual is 0 or more."),
        ("cubic_viscous", {"Fcube": (-0.1, 0.01)}, "Fcube = -0.1"),
        ("power_viscous", {"Fp": (-0.1, 0.01)}, "Fp = -0.1"),
        ("asymmetric_viscous", {"Fva": (-0.1, 0.01)}, ""),
    ],
)
def test_values_that_hardly_any_machine_has(effect: str, values: dict[str, tuple[float, float]], told: str) -> None:
    found = unusual_values(fit(effect, values), CATALOGUE)  # type: ignore[arg-type]
    assert [one.place for one in found] == ([f"{effect.replace('_', ' ')}, joint 2"] if told else [])
    assert all(one.text.startswith(told) and one.code.severity is DOUBT for one in found)


@pytest.mark.parametrize(
    ("beside", "told"),
    [
        ((), True),
        (("added", 2), False),
        (("added", 1), True),
        (("present", 2), False),
        (("present", 1), True),
    ],
)
def test_a_spring_that_hardens_has_a_linear_part(beside: tuple[Any, ...], told: bool) -> None:
    """Found before, or in the model from the start, on its joint."""
    found = fit("cubic_spring", {"kcube": (3.0, 0.1)})
    if beside:
        how, joint = beside
        index = 1 if how == "added" else None
        found.model.free_parameters.append(FreeParameter(f"k{joint}", "1", "plant", "k", 5.0, 1.0, effect=index))
        found.values, found.covariance = np.append(found.values, 5.0), np.diag([*np.diag(found.covariance), 0.01])
        if how == "added":
            found.model.added_effects = (*found.model.added_effects, EffectAtJoint("spring", joint))
    doubts = unusual_values(found, CATALOGUE)  # type: ignore[arg-type]
    wanted = ["acts without a spring or cable stiffness, whose law it bends."] * told
    assert [one.text for one in doubts] == wanted


def test_what_bends_a_law_and_where_one_rests_are_in_the_catalogue() -> None:
    for effect in EFFECTS.values():
        for name in filter(None, (effect.bends, effect.rest)):
            assert len(EFFECTS[name].own_parameters) == len(effect.own_parameters) == 1
