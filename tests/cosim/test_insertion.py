"""Components put into the wiring of a loop: where they act, in which order, and what the log shows."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.components import Component, ModelComponent, wrap_control
from fmu_didim.components.inserted import inserted_component
from fmu_didim.cosim import (
    Connection,
    Recording,
    System,
    insert_after_output,
    insert_before_input,
    insert_effect,
    logged_torque,
    simulate,
)
from fmu_didim.data.signals import trajectory
from fmu_didim.dynamics.effects.actuator_lag import ActuatorLag
from fmu_didim.dynamics.effects.controller_gain import ControllerGain
from fmu_didim.dynamics.effects.dead_zone import DeadZone
from fmu_didim.dynamics.effects.delay import Delay
from fmu_didim.dynamics.effects.drive_gain import DriveGain
from fmu_didim.dynamics.effects.encoder_eccentricity import EncoderEccentricity
from fmu_didim.dynamics.effects.torque_saturation import TorqueSaturation
from fmu_didim.dynamics.effects.voltage_limit import VoltageLimit
from tests.helpers import PERIOD, Mock, component, loop, ports, reference, scara, scara_pd, sledge

MOTION = reference(1.5)
SIGNALS = ("plant.q1", "plant.dq2", "plant.ddq2", "controller.command1", "controller.command2")
IN_THE_DRIVE = (ActuatorLag(), Delay(), DeadZone(), TorqueSaturation(), DriveGain(), ControllerGain())


def scara_loop(plant: str = "model", controller: str = "model", **options: Any) -> System:
    return loop(component(plant, scara().block()), component(controller, scara_pd()), MOTION, **options)


def gain(value: float = 1.0) -> Component:
    return inserted_component(DriveGain(), "revolute", PERIOD, {"drive_gain": value})


def difference(first: Recording, second: Recording) -> float:
    """Largest difference of any signal, as a part of its range."""
    return max(np.abs(first.applied[n] - second.applied[n]).max() / np.ptp(first.applied[n]) for n in SIGNALS)


class TestWiring:
    def test_a_gain_of_one_changes_no_bit(self) -> None:
        for compiled in (None, False):
            for system in (scara_loop("fmu", "fmu"), scara_loop("fmu", "fmu", delay_samples=1.4)):
                changed = insert_before_input(system, "one", gain(), at="plant.tau2")
                changed = insert_after_output(changed, "two", gain(), of="plant.q1")
                before, after = (simulate(s, MOTION, compiled=compiled) for s in (system, changed))
                assert before.compiled == after.compiled == (compiled is None)
                assert all(np.array_equal(before.applied[name], after.applied[name]) for name in SIGNALS)

    @pytest.mark.gate
    @pytest.mark.parametrize("plant", ["model", pytest.param("control", marks=pytest.mark.slow), "fmu"])
    @pytest.mark.parametrize("controller", ["model", "control", "fmu"])
    def test_every_kind_of_component_gives_the_same_motion(self, plant: str, controller: str) -> None:
        values = {"T": 0.004}
        systems = [
            insert_effect(scara_loop(*kinds), ActuatorLag(), 2, "revolute", values=values)
            for kinds in ((plant, controller), ("fmu", "fmu"))
        ]
        first, second = (simulate(system, MOTION) for system in systems)
        assert difference(first, second) < 1e-9
        assert difference(simulate(scara_loop(plant, controller), MOTION), first) > 1e-3

    def test_all_connections_keep_their_gains_and_the_order_fits(self) -> None:
        parts: dict[str, Component] = {
            name: Mock(name, ports(*inputs), ports("out", causality="output"))
            for name, inputs in {"a": (), "b": (), "c": ("in", "other")}.items()
        }
        wires = (Connection("a.out", "c.in", 2.0), Connection("b.out", "c.in", -3.0), Connection("a.out", "c.other"))
        system = System(parts, wires, ("a", "b", "c"), 0.1, delays={"c": 2.0})
        first = insert_before_input(system, "first", gain(), at="c.in")
        assert first.order == ("a", "b", "first", "c")
        assert set(first.connections) == {
            Connection("a.out", "first.u", 2.0), Connection("b.out", "first.u", -3.0),
            Connection("a.out", "c.other"), Connection("first.y", "c.in"),
        }  # fmt: skip
        assert first.delays == system.delays
        second = insert_before_input(first, "second", gain(), at="c.in")
        assert second.order == ("a", "b", "first", "second", "c")
        assert {Connection("first.y", "second.u"), Connection("second.y", "c.in")} < set(second.connections)
        behind = insert_after_output(system, "behind", gain(), of="a.out")
        assert behind.order == ("a", "b", "behind", "c")
        assert set(behind.connections) == {
            Connection("behind.y", "c.in", 2.0), Connection("b.out", "c.in", -3.0),
            Connection("behind.y", "c.other"), Connection("a.out", "behind.u"),
        }  # fmt: skip
        assert system.order == ("a", "b", "c")  # untouched

    def test_of_a_chain_the_newest_is_nearest_to_the_input(self) -> None:
        inner = insert_before_input(
            scara_loop(), "zone", inserted_component(DeadZone(), "revolute", PERIOD), at="plant.tau2"
        )
        inner = inner.replace("zone", inner.components["zone"].with_parameters({"dead_zone": 0.1}))
        outer = simulate(insert_before_input(inner, "double", gain(2.0), at="plant.tau2"), MOTION)
        command = outer.applied["controller.command2"]
        zoned = outer.applied["zone.y"]
        assert np.allclose(outer.inputs["plant.tau2"], 2 * zoned, rtol=1e-15)
        far = np.abs(command) > 0.3
        assert np.abs(zoned - (command - 0.1 * np.sign(command)))[far].max() < 1e-4

    def test_refusals(self) -> None:
        system = scara_loop()
        two = ModelComponent(scara_pd())
        with pytest.raises(InputError, match="one input and one output"):
            insert_before_input(system, "two", two, at="plant.tau1")
        with pytest.raises(InputError, match="has a component of this name"):
            insert_before_input(system, "plant", gain(), at="plant.tau1")
        with pytest.raises(UnknownNameError, match="'tau3'"):
            insert_before_input(system, "x", gain(), at="plant.tau3")
        with pytest.raises(UnknownNameError, match="component named 'motor'"):
            insert_before_input(system, "x", gain(), at="motor.u")
        with pytest.raises(InputError, match="Nothing is connected"):
            insert_after_output(system, "x", gain(), of="plant.ddq1")
        with pytest.raises(InputError, match="parallel"):
            insert_before_input(scara_loop(jacobi=True), "x", gain(), at="plant.tau1")


class TestLag:
    def test_the_sampled_lag_is_the_analytic_solution(self) -> None:
        """1/(T s + 1) behind a hold: y is its mean over each period, here by the exact response at a fine step."""
        lag, fine = 0.007, 200
        force = np.random.default_rng(1).normal(size=60)
        time = np.arange(force.size * fine + 1) * PERIOD / fine
        held = np.append(np.repeat(force, fine), force[-1])
        # forward simulation with the input held exactly: a discrete system at the fine step
        system = control.c2d(control.ss(-1 / lag, 1 / lag, [[1.0], [0.0]], [[0.0], [1.0]]), PERIOD / fine)
        response = control.forced_response(system, time, held, initial_state=[force[0]]).outputs[0]
        mean = np.add.reduceat((response[:-1] + response[1:]) / 2, np.arange(0, force.size * fine, fine)) / fine
        part = inserted_component(ActuatorLag(), "revolute", PERIOD, {"T": lag})
        y = run_alone(part, force)
        assert np.abs(y - mean).max() < 5e-6  # trapezoidal rule at 25 us: (dt/T)^2/12 of a step of about 2

    def test_in_the_loop_it_is_a_continuous_lag_to_first_order_in_its_hold(self) -> None:
        """A sledge of 2 kg behind the lag, against the same two equations integrated together."""
        motion, lag, stiffness, damping = reference(2.0, joints=1), 0.004, 800.0, 60.0
        rule = control.ss([], [], [], [[stiffness, damping, -stiffness, -damping]], dt=PERIOD)
        rule = control.ss(rule, inputs=["q_ref1", "dq_ref1", "q1", "dq1"], outputs=["command1"])
        system = loop(ModelComponent(sledge(3.0).block()), wrap_control(rule, origin="test"), motion, joints=1)
        ours = simulate(insert_effect(system, ActuatorLag(), 1, "prismatic", values={"T": lag}), motion)
        q, dq = motion.select(["q1"])[:, 0], motion.select(["dq1"])[:, 0]
        joint = control.c2d(
            control.ss([[0, 1, 0], [0, -1.5, 0.5], [0, 0, -1 / lag]], [[0], [0], [1 / lag]], np.eye(3), 0), PERIOD
        )
        state = np.array([q[0], dq[0], 0.0])
        positions = []
        for k in range(q.size):
            command = stiffness * (q[k] - state[0]) + damping * (dq[k] - state[1])
            positions.append(state[0])
            state = joint.A @ state + joint.B[:, 0] * command
        worst = np.abs(ours.applied["plant.q1"] - positions).max()
        without = np.abs(simulate(system, motion).applied["plant.q1"] - positions).max()
        assert worst < 0.02 * without  # the force varies within a period, its impulse is right

    def test_it_begins_as_after_a_constant_command(self) -> None:
        part = inserted_component(ActuatorLag(), "revolute", PERIOD, {"T": 0.05})
        assert np.array_equal(run_alone(part, np.full(20, 3.0)), np.full(20, 3.0))


class TestOtherEffects:
    @pytest.mark.parametrize("periods", [0, 1, 3, 8])
    def test_whole_periods_of_delay_are_those_of_the_loop(self, periods: int) -> None:
        soft = {"Kp1": 90.0, "Kd1": 20.0, "Kp2": 1.5, "Kd2": 0.3}
        system = scara_loop()
        system = system.replace("controller", system.components["controller"].with_parameters(soft))
        changed = system
        for joint in (1, 2):
            changed = insert_effect(changed, Delay(), joint, "revolute", values={"delay": periods * PERIOD})
        ours, theirs = simulate(changed, MOTION), simulate(system.with_delay("plant", periods), MOTION)
        assert np.abs(ours.applied["plant.q2"] - theirs.sampled["plant.q2"]).max() < 1e-12
        assert np.abs(ours.inputs["delay2.u"] - theirs.inputs["plant.tau2"]).max() < 1e-10

    def test_a_fraction_of_delay_has_the_impulse_of_the_shifted_command(self) -> None:
        force = np.random.default_rng(2).normal(size=50)
        part = inserted_component(Delay(), "revolute", PERIOD, {"delay": 2.3 * PERIOD})
        line = np.concatenate([np.full(3, force[0]), force])
        assert np.allclose(run_alone(part, force), 0.7 * line[1:-2] + 0.3 * line[:-3], atol=1e-14)

    def test_saturation_clips_what_is_logged(self) -> None:
        free = simulate(scara_loop(), MOTION).inputs["plant.tau2"]
        limit = 0.6 * np.abs(free).max()
        system = insert_effect(scara_loop(), TorqueSaturation(), 2, "revolute", values={"limit": limit})
        recorded = simulate(system, MOTION)
        torque = recorded.inputs[logged_torque(system, 2)]
        assert torque.max() == limit
        assert (torque == np.clip(recorded.applied["controller.command2"], -limit, limit)).all()

    @pytest.mark.parametrize("compiled", [None, False])
    def test_a_limit_falls_with_the_speed_that_the_plant_gives(self, compiled: bool | None) -> None:
        system, values = limited(scara_loop("fmu", "fmu"))
        assert Connection("plant.dq2", "voltage_limit2.dq") in system.connections
        assert system.order == ("controller", "voltage_limit2", "plant")
        recorded = simulate(system, MOTION, compiled=compiled)
        assert recorded.compiled == (compiled is None)
        torque, dq = recorded.inputs[logged_torque(system, 2)], recorded.applied["plant.dq2"]
        left, command = dq / values["no_load_speed"], recorded.applied["controller.command2"]
        expected = np.clip(command, -values["stall"] * (1 + left), values["stall"] * (1 - left))
        assert np.abs(torque - expected).max() < 1e-12
        at_limit = np.abs(torque - command) > 1e-3
        assert np.ptp(np.abs(dq[at_limit])) > 0.1 * np.abs(dq).max()  # at several speeds

    def test_without_velocities_it_takes_the_difference_of_positions(self) -> None:
        whole, values = limited(scara_loop())
        system, _ = limited(blind(scara_loop(), "q"))
        assert Connection("plant.q2", "voltage_limit2.q") in system.connections
        first, second = simulate(whole, MOTION), simulate(system, MOTION)
        q = second.applied["plant.q2"]
        left = np.concatenate([[0.0], np.diff(q) / PERIOD]) / values["no_load_speed"]
        expected = np.clip(
            second.applied["controller.command2"], -values["stall"] * (1 + left), values["stall"] * (1 - left)
        )
        assert np.abs(second.inputs["plant.tau2"] - expected).max() < 1e-10
        torques = [run.inputs["plant.tau2"] for run in (first, second)]
        free = simulate(scara_loop(), MOTION).inputs["plant.tau2"]
        late, limit = (np.sqrt(np.mean((torques[0] - other) ** 2)) for other in (torques[1], free))
        assert 0 < late < 0.1 * limit  # by half a period

    def test_what_the_plant_does_not_give_is_told(self) -> None:
        with pytest.raises(InputError, match="depends on the velocity of its joint") as told:
            insert_effect(blind(scara_loop()), VoltageLimit(), 2, "revolute")
        assert "an output dq2 or q2" in str(told.value) and "dq2: name in the plant" in str(told.value)
        with pytest.raises(InputError, match="depends on the velocity"):  # a velocity that is mapped as a position
            insert_effect(blind(scara_loop(), "q", unit="rad/s"), VoltageLimit(), 2, "revolute")

    def test_the_difference_of_positions_asks_for_one_period(self) -> None:
        given = VoltageLimit()
        differs = given.fed_by({"q1": "rad"}, 1)
        assert differs is not None and given.fed_by({"q1": "rad", "dq1": "rad/s"}, 1) is given
        assert given.fed_by({"q1": "rad"}, 1) is differs  # so that it is compiled once
        assert not given.depends_on_period("revolute") and differs.depends_on_period("revolute")

    def test_the_controller_is_told_the_eccentric_position(self) -> None:
        values = {"eccentricity_cosine": 2e-4, "eccentricity_sine": -3e-4, "eccentricity_number": 2.0}
        system = insert_effect(scara_loop(), EncoderEccentricity(), 2, "revolute", values=values)
        recorded = simulate(system, MOTION)
        q = recorded.applied["plant.q2"]
        told = recorded.inputs["controller.q2"]
        assert np.abs(told - (q + 2e-4 * np.cos(2 * q) - 3e-4 * np.sin(2 * q))).max() < 1e-15
        assert system.order == ("encoder_eccentricity2", "controller", "plant")

    def test_a_reference_in_the_same_input_is_left_alone(self) -> None:
        """Behind the plant's output, not before the controller's input, which may be a sum."""
        rule = control.ss([], [], [], [[500.0, 40.0, -40.0]], dt=PERIOD)
        rule = control.ss(rule, inputs=["e", "dq_ref1", "dq1"], outputs=["command1"])
        controller = wrap_control(rule, origin="test")
        named = tuple(
            type(v)("q_ref1 - q1" if v.name == "e" else v.name, v.unit, v.causality) for v in controller.inputs
        )
        motion = reference(1.0, joints=1)
        system = loop(
            ModelComponent(sledge(3.0).block()), controller.with_names(named, controller.outputs), motion, joints=1
        )
        values = {"eccentricity_cosine": 1e-3}
        recorded = simulate(insert_effect(system, EncoderEccentricity(), 1, "prismatic", values=values), motion)
        q, q_ref = recorded.applied["plant.q1"], motion.select(["q1"])[:, 0]
        assert np.abs(recorded.inputs["controller.q_ref1 - q1"] - (q_ref - q - 1e-3 * np.cos(q))).max() < 1e-15


class TestOrderOfADrive:
    def test_it_does_not_depend_on_the_order_of_adding(self) -> None:
        for effects in (IN_THE_DRIVE, IN_THE_DRIVE[::-1], IN_THE_DRIVE[::2] + IN_THE_DRIVE[1::2]):
            system = scara_loop()
            for effect in effects:
                system = insert_effect(system, effect, 2, "revolute")
            assert system.order == (
                "controller", "controller_gain2", "torque_saturation2",
                "drive_gain2", "dead_zone2", "delay2", "actuator_lag2", "plant",
            )  # fmt: skip
            assert logged_torque(system, 2) == "drive_gain2.u"
            assert logged_torque(system, 1) == "plant.tau1"

    def test_the_log_shows_the_command_before_the_drive(self) -> None:
        system = insert_effect(scara_loop(), ControllerGain(), 2, "revolute", values={"controller_gain": 0.8})
        system = insert_effect(system, ActuatorLag(), 2, "revolute", values={"T": 0.01})
        recorded = simulate(system, MOTION)
        logged = recorded.inputs[logged_torque(system, 2)]
        assert np.allclose(logged, 0.8 * recorded.applied["controller.command2"], rtol=1e-15)
        assert np.abs(recorded.inputs["plant.tau2"] - logged).max() > 0.01

    def test_an_effect_is_added_once_and_survives_pickling(self) -> None:
        system = insert_effect(scara_loop(), ActuatorLag(), 1, "revolute", values={"T": 0.01})
        with pytest.raises(InputError, match="has a component of this name"):
            insert_effect(system, ActuatorLag(), 1, "revolute")
        assert logged_torque(pickle.loads(pickle.dumps(system)), 1) == "actuator_lag1.u"
        assert system.describe()["components"]["actuator_lag1"]["parameters"] == {"T": 0.01}


def limited(system: System) -> tuple[System, dict[str, float]]:
    """A loop whose second joint meets a limit that falls with the speed, and its values."""
    free = simulate(scara_loop(), MOTION)
    torque, dq = free.inputs["plant.tau2"], free.applied["plant.dq2"]
    speed = 2 * float(np.abs(dq).max())
    at_rest = np.maximum(torque / (1 - dq / speed), -torque / (1 + dq / speed))
    values = {"stall": 0.75 * float(at_rest.max()), "no_load_speed": speed}
    return insert_effect(system, VoltageLimit(), 2, "revolute", values=values), values


def blind(system: System, *kept: str, unit: str = "rad") -> System:
    """The loop with a plant that names its motion otherwise, but for some signals."""
    plant = system.components["plant"]
    names = {v.name: v.name if v.name[:-1] in kept else f"m{v.name}" for v in plant.outputs}
    outputs = tuple(
        replace(v, name=names[v.name], unit=unit if v.name.startswith("q") else v.unit) for v in plant.outputs
    )
    changed = plant.with_names(plant.inputs, outputs)
    wires = tuple(
        replace(c, source=f"plant.{names[c.source[6:]]}") if c.source.startswith("plant.") else c
        for c in system.connections
    )
    return replace(system, components={**system.components, "plant": changed}, connections=wires)


def run_alone(part: Component, inputs: np.ndarray) -> np.ndarray:
    """Outputs of a component driven by a list of inputs, one a control period."""
    source = trajectory(np.arange(inputs.size) * PERIOD, {"u": inputs})
    return simulate(System({"it": part}, (Connection("reference.u", "it.u"),), ("it",), PERIOD), source).applied["it.y"]
