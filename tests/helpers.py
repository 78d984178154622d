"""Builders that several test files share: robots, references, closed loops, and a component that keeps a log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.documents import validate
from fmu_didim.case import load_case
from fmu_didim.components import Component, Instance, ModelComponent, block_as_control, load_fmu
from fmu_didim.controllers import LAWS
from fmu_didim.cosim import System, closed_loop, sample_operator
from fmu_didim.data.signals import Trajectory, Variable, trajectory
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from fmu_didim.export import build_fmu
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.experiments import Experiments
from fmu_didim.model.free_parameter import base_free_parameters
from fmu_didim.model.loop import Loop
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import Parameters

NEAR = 0.03
"""Standard deviations that two estimates of the same data may be apart, each integrated to 0.02 of them."""
ROOT = Path(__file__).parents[1]
KINDS = ("model", "control", "fmu")
PERIOD = 0.005


@cache
def scara() -> RobotModel:
    """The two-joint SCARA of the DIDIM paper."""
    return RobotModel(read_robot(ROOT / "fmus/scara/robot.yaml"))


@cache
def sledge(viscous: float = 0.0) -> RobotModel:
    """One prismatic joint of 2 kg, with viscous friction or none: linear."""
    joint: dict[str, Any] = {"type": "prismatic", "effects": [], "parameters": {"M": 2.0}}
    if viscous:
        joint |= {"effects": ["viscous"], "parameters": {"M": 2.0, "Fv": viscous}}
    return RobotModel(RobotDescription.model_validate({"name": "sledge", "gravity": (0, 0, 0), "joints": [joint]}))


def random_robot(count: int, seed: int) -> RobotDescription:
    """Joints of both types whose axes are often parallel, perpendicular or intersecting, so that much regroups."""
    rng = np.random.default_rng([count, seed])
    joints = []
    for _ in range(count):
        special = rng.random() < 0.7
        joints.append(
            {
                "type": "revolute" if rng.random() < 0.75 else "prismatic",
                "alpha": float(rng.choice([0.0, np.pi / 2, -np.pi / 2])) if special else rng.uniform(-3, 3),
                "a": float(rng.choice([0.0, 0.4])) if special else rng.normal(),
                "theta": rng.uniform(-3, 3),
                "d": float(rng.choice([0.0, -0.3])) if special else rng.normal(),
            }
        )
    gravity = (0.0, 0.0, -9.81) if seed % 2 else tuple(rng.normal(scale=5, size=3))
    return RobotDescription.model_validate({"name": "random", "gravity": gravity, "joints": joints})


def reference(duration: float = 1.0, *, joints: int = 2, period: float = PERIOD, start: float = 0.0) -> Trajectory:
    """A smooth Fourier motion, sampled with its exact derivatives; it starts neither at zero nor at rest."""
    time = start + np.arange(round(duration / period) + 1) * period
    t = (time - start)[:, None]
    w = 2 * np.pi * np.array([0.5, 1.0, 1.7])
    a = np.array([[0.5, 0.2, -0.06], [-0.4, 0.25, 0.08]])[:joints]
    phase = np.array([[0.3, 1.1, 2.0], [0.9, -0.4, 0.2]])[:joints]
    columns: dict[str, np.ndarray] = {}
    for order, name in enumerate(("q", "dq", "ddq")):
        for j in range(joints):
            columns[f"{name}{j + 1}"] = (a[j] * w**order * np.sin(w * t + phase[j] + order * np.pi / 2)).sum(axis=1)
    return trajectory(time, columns)


def law_block(**options: Any) -> Block:
    """The block of a control law from its options."""
    options = {"name": f"{options['law']}_test", "rate_hz": 1 / PERIOD, **options}
    return validate(LAWS[options["law"]], options, where="controller.yaml").block(folder=ROOT)


def scara_pd() -> Block:
    """PD control of the SCARA at 200 Hz with measured velocity: linear, no state."""
    return law_block(law="pd", joints=["revolute"] * 2, Kp=[3700, 62], Kd=[230, 4])


def scara_cascade() -> Block:
    """Cascade control of the SCARA with saturation and backward difference: nonlinear, with states."""
    return law_block(
        law="cascade_ppi", joints=["revolute"] * 2, Kv=[16, 15], Kp=[200, 4], Ki=[300, 5],
        velocity="backward_difference", saturation=[10, 0.8],
    )  # fmt: skip


def component(kind: str, block: Block) -> Component:
    """The block as one of the KINDS of components."""
    if kind == "model":
        return ModelComponent(block)
    return block_as_control(block) if kind == "control" else load_fmu(build_fmu(block))


def on_reference(plant: Component, motion: Trajectory, joints: int = 2) -> Component:
    """The plant, starting with position and velocity of the reference."""
    row = dict(zip(motion.names, motion.values[0], strict=True))
    start = {f"{n}_start{j}": row[f"{n}{j}"] for n in ("q", "dq") for j in range(1, joints + 1)}
    return plant.with_parameters(start)


def loop(plant: Component, controller: Component, motion: Trajectory, *, joints: int = 2, **options: Any) -> System:
    """Plant and controller wired at 200 Hz, the plant starting on the reference."""
    return closed_loop(
        on_reference(plant, motion, joints), controller,
        joint_count=joints, step_size=PERIOD, reference_names=motion.names, **options,
    )  # fmt: skip


def model_of(case: Path | str) -> LoopModel:
    """The loop of a case file with its data."""
    model = load_case(case).model
    assert model is not None
    return model


def model_on(system: System, parameters: Parameters, motion: Trajectory, times: np.ndarray) -> LoopModel:
    """A loop along a motion, whose base parameters are free; its torque log at these times is still empty."""
    operator = sample_operator(
        times, start=float(motion.time[0]), step=system.step_size, tick_count=motion.time.size
    )  # fmt: skip
    empty = Experiment(motion, times, np.zeros((times.size, parameters.joint_count)), operator)
    return LoopModel(
        Loop({"estimation": system}, parameters, system.components["plant"]), Experiments({"estimation": empty}),
        base_free_parameters(parameters),
    )  # fmt: skip


def with_torque(model: LoopModel, torque: np.ndarray, label: str | None = None) -> LoopModel:
    """The model with another measured torque in an experiment, by default in the first one."""
    label = label or model.first
    return model.with_experiment(label, replace(model.experiments[label], torque=torque))


def with_component(model: LoopModel, name: str, part: Component) -> LoopModel:
    """The model with another component in all its loops; the plant included."""
    systems = {label: system.replace(name, part) for label, system in model.loop.systems.items()}
    return model.with_loop(systems=systems, plant=part if name == model.loop.plant_name else model.loop.plant)


def drive(part: Component, inputs: np.ndarray, period: float, start: float = 0.0) -> np.ndarray:
    """Outputs (N, ny) of a component alone, stepped with the rows of inputs (N, nu)."""
    instance = part.instantiate()
    begin(instance, inputs[0], start)
    try:
        return np.array([advance(instance, row, start + k * period, period) for k, row in enumerate(inputs)])
    finally:
        instance.close()


def begin(instance: Instance, inputs: np.ndarray, start: float = 0.0) -> None:
    """Initialise an instance with these inputs."""
    instance.begin_initialisation(start)
    instance.inputs[:] = inputs
    instance.set()
    instance.get()
    instance.end_initialisation()


def advance(instance: Instance, inputs: np.ndarray, time: float, period: float) -> np.ndarray:
    """Outputs at ``time``, then one step."""
    instance.inputs[:] = inputs
    instance.set()
    instance.get()
    outputs = instance.outputs.copy()
    instance.step(time, period)
    return outputs


@dataclass(frozen=True)
class Mock(Component):
    """Writes ``respond(k, inputs)`` to its outputs, k being the number of steps made, and logs every call."""

    name: str
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    respond: Callable[[int, np.ndarray], Any] = lambda k, u: 0.0
    log: list[tuple[Any, ...]] = field(default_factory=list)
    parameters: tuple[Variable, ...] = ()
    sample_time: float | None = None

    def with_parameters(self, values: Mapping[str, float]) -> Component:
        return replace(self)

    def with_names(self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]) -> Component:
        return replace(self, inputs=inputs, outputs=outputs)

    def instantiate(self) -> Instance:
        return MockInstance(self)

    def describe(self) -> dict[str, Any]:
        return {"kind": "mock"}

    def calls(self, kind: str) -> list[tuple[Any, ...]]:
        """The arguments of the calls of one kind, of this component only."""
        return [entry[2:] for entry in self.log if entry[:2] == (self.name, kind)]


class MockInstance(Instance):
    def __init__(self, owner: Mock) -> None:
        self._owner, self._count, self._initialised = owner, 0, False
        self._held = np.zeros(len(owner.inputs))
        self.bind(np.zeros(len(owner.inputs)), np.zeros(len(owner.outputs)))

    def _note(self, call: str, *values: Any) -> None:
        if self._initialised or call in ("begin", "end", "close"):
            self._owner.log.append((self._owner.name, call, *values))

    def begin_initialisation(self, time: float) -> None:
        self._note("begin", time)

    def end_initialisation(self) -> None:
        self._note("end", self._held.copy())
        self._initialised = True

    def set(self) -> None:
        self._held[:] = self.inputs
        self._note("set", self._held.copy())

    def get(self) -> None:
        self.outputs[:] = self._owner.respond(self._count, self._held)
        self._note("get")

    def step(self, time: float, size: float) -> None:
        self._note("step", time, size)
        self._count += 1

    def save_state(self) -> Any:
        return self._count, self._held.copy()

    def restore_state(self, state: Any) -> None:
        self._count, self._held[:] = state

    def close(self) -> None:
        self._note("close")


def ports(*names: str, causality: str = "input") -> tuple[Variable, ...]:
    """Variables of these names."""
    return tuple(Variable(name, "", causality) for name in names)
