"""Wrong inputs, and models that are not those of the machine: what is wrong, on which robots, and which codes tell."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.case import load_case
from fmu_didim.components import Component
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.dynamics.robot import RobotModel, read_robot, write_robot
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from tests.checks.data import right as data
from tests.checks.data.right import CASES, loaded, with_experiment, with_log
from tests.checks.data.test_wrong_inputs import TIMING, WRONG, late
from tests.helpers import with_component
from tests.tools.verdict.run import without_start

ALL = ("scara", "arm", "tx40")
FIT = ("residual-depends-on-motion", "link-length", "gravity", "residual-above-noise", "worse-on-held-out",
       "not-physical", "friction-negative", "mass-matrix-indefinite", "residual-slow")  # fmt: skip
"""Codes of a model that does not explain its data."""

NOISE = 0.01
"""Standard deviation of the noise, of that of the torque."""
right = partial(data.right, noise=NOISE)
Make = Callable[[str, int], LoopModel]
"""(robot, seed) -> the model that is identified, with its logs."""


@dataclass(frozen=True)
class Wrong:
    """One thing that is wrong.

    Attributes:
        codes: any of them among the first two reasons tells it.
        stated: whether the case states the noise of the torque.
    """

    name: str
    make: Make
    codes: tuple[str, ...]
    robots: tuple[str, ...] = ALL
    stated: bool = False


def on_data(change: Callable[[LoopModel], LoopModel]) -> Make:
    """What is wrong with logs or references."""
    return lambda robot, seed: change(right(robot, seed))


def on_machine(change: Callable[[LoopModel], LoopModel], **options: Any) -> Make:
    """What the machine is other than the model says."""
    return lambda robot, seed: right(robot, seed, change=change, **options)


def on_description(change: Callable[[dict[str, Any]], None]) -> Make:
    """What the robot description of the model says other than the machine is."""

    def make(robot: str, seed: int) -> LoopModel:
        own = right(robot, seed)
        return without_start(own, _described(robot, change))

    return make


@cache
def _described(robot: str, change: Callable[[dict[str, Any]], None]) -> LoopModel:
    case = load_case(CASES[robot])
    description = read_robot(case.folder / str(case.document.robot))
    content = description.model_dump(mode="json", by_alias=True)
    change(content)
    path = Path(tempfile.mkdtemp()) / "robot.yaml"
    write_robot(type(description).model_validate(content), path)
    return case.with_(robot=str(path), plant={"kind": "model"}).model


def joint(number: int, **changes: Any) -> Callable[[dict[str, Any]], None]:
    """Changes of the geometry of a joint, or factors of its parameters."""

    def change(content: dict[str, Any]) -> None:
        one = content["joints"][number - 1]
        for name, factor in changes.items():
            if name in one:
                one[name] = one[name] * factor
            else:
                one["parameters"][name] = one["parameters"].get(name, 0.0) * factor

    return change


def gravity_forgotten(content: dict[str, Any]) -> None:
    content["gravity"] = [0.0, 0.0, 0.0]
    content["identified"] = "computed"  # other base parameters than with it


def gravity_turned(content: dict[str, Any]) -> None:
    x, y, z = content["gravity"]
    content["gravity"] = [y, -x, z]


def gravity_smaller(content: dict[str, Any]) -> None:
    content["gravity"] = [0.7 * g for g in content["gravity"]]


def gains(factor: float) -> Callable[[LoopModel], LoopModel]:
    """All gains of the controller of the machine are off by a factor."""

    def change(model: LoopModel) -> LoopModel:
        controller = model.loop.systems[model.first].components["controller"]
        scaled = {
            v.name: factor * v.start for v in controller.parameters if v.name.rstrip("0123456789") in ("Kp", "Kd", "Kv")
        }
        assert scaled, "the controller has no gains"
        other: Component = controller.with_parameters(scaled)
        return with_component(model, "controller", other)

    return change


def with_effect(name: str, number: int, **values: float) -> Callable[[LoopModel], LoopModel]:
    """The machine has an effect that the model lacks."""

    def change(model: LoopModel) -> LoopModel:
        robot = next(r for r in ALL if loaded(r).names == model.names)
        builder = LoopModelBuilder(model, _robot(robot))
        return builder.build(model, [Proposal(EffectAtJoint(name, number), values)])

    return change


@cache
def _robot(robot: str) -> Any:
    case = load_case(CASES[robot])
    return RobotModel(read_robot(case.folder / str(case.document.robot))).description


def other_values(label: str, factors: Mapping[str, float]) -> Make:
    """The machine has other values in one experiment."""

    def make(robot: str, seed: int) -> LoopModel:
        def change(run: LoopModel) -> LoopModel:
            if label not in run.experiments:
                return run
            scale = [factors.get(name.rstrip("0123456789R"), 1.0) for name in run.names]
            return run.with_values(run.start * np.array(scale))

        return right(robot, seed, change=change)

    return make


def scaled(factor: float, *joints: int) -> Callable[[LoopModel], LoopModel]:
    def change(torque: np.ndarray) -> np.ndarray:
        torque[:, [j - 1 for j in joints] if joints else slice(None)] *= factor
        return torque

    def both(model: LoopModel) -> LoopModel:
        for label in model.experiments:
            model = with_log(model, change, label)
        return model

    return both


def left_out(name: str) -> Make:
    """A parameter is held at a wrong value instead of being identified."""

    def make(robot: str, seed: int) -> LoopModel:
        own = right(robot, seed)
        return without_start(own, _described(robot, joint(int(name[-1]), **{name[:-1]: 3.0})))

    return make


def stuck(model: LoopModel) -> LoopModel:
    """The log begins anew half way: two recordings glued together."""
    own = model.experiments[model.first]
    half = own.time.size // 2
    return with_experiment(model, model.first, torque=np.roll(own.torque, half, axis=0))


CLOCK = ("clock-late", "clock-early", "sampling-kind", "command-delay", "reference-foreign")
SCALE = ("torque-scale", "torque-unit")
TWO = ("scara", "arm")

CATALOGUE: list[Wrong] = [
    *(Wrong(f"input: {name}", on_data(change), (code,)) for name, change, code in WRONG),
    *(
        Wrong(f"timing: {name}", on_machine(change), CLOCK, robots=TWO if code == "command-delay" else ALL)
        for name, change, code in TIMING
    ),
    Wrong("timing: clock 8 ms late", on_machine(late(0.008)), CLOCK),
    Wrong("timing: clock 12 ms early", on_machine(late(-0.012)), CLOCK),
    Wrong("timing: half a sample of delay", on_machine(lambda m: m.with_delay(0.5)), (*CLOCK, *FIT), robots=TWO),
    Wrong("timing: log glued together", on_data(stuck), ("reference-foreign", *CLOCK, *FIT)),
    *(
        Wrong(f"controller: gains {100 * (f - 1):+.0f} %", on_machine(gains(f)), (*FIT, *CLOCK, "torque-unit"))
        for f in (1.05, 0.95, 1.2, 0.8, 1.66, 0.34)
    ),
    *(
        Wrong(f"model: {name}", on_description(change), FIT, robots)
        for name, change, robots in (
            # In a horizontal plane only products of the length with MX2 and MY2 act: nothing can tell them apart.
            ("link 20 % too short", joint(2, a=0.8), ("arm",)),
            ("link 20 % too long", joint(2, a=1.2), ("arm",)),
            ("link half as long", joint(2, a=0.5), ("arm",)),
            ("link of the upper arm 20 % too short", joint(3, a=0.8), ("tx40",)),
            ("gravity forgotten", gravity_forgotten, ("arm", "tx40")),
            ("gravity turned", gravity_turned, ("arm",)),
            ("gravity 30 % too small", gravity_smaller, ("arm",)),
            ("friction of joint 1 ten times steeper", joint(1, v0=0.1), TWO),
            ("friction of joint 2 ten times steeper", joint(2, v0=0.1), TWO),
            ("friction of joint 1 ten times flatter", joint(1, v0=10.0), TWO),
            ("friction of joint 2 ten times flatter", joint(2, v0=10.0), TWO),
        )
    ),
    *(
        Wrong(
            f"machine: {name} on joint {number} of {robots[0]}", on_machine(with_effect(name, number, **values)), FIT,
            robots,
        )
        for name, number, values, robots in (
            ("stribeck", 1, {"Fs": 1.0, "vs": 0.1}, ("scara",)),
            ("stribeck", 2, {"Fs": 0.1, "vs": 0.1}, ("scara",)),
            ("stribeck", 1, {"Fs": 2.0, "vs": 0.1}, ("arm",)),
            ("quadratic_viscous", 1, {"Fq": 1.0}, ("scara",)),
            ("quadratic_viscous", 2, {"Fq": 0.4}, ("arm",)),
            ("spring", 2, {"k": 0.3}, ("scara",)),
            ("spring", 1, {"k": 20.0}, ("arm",)),
            ("torque_offset", 1, {"offset": 1.0}, ("scara",)),
            ("torque_offset", 2, {"offset": 1.0}, ("arm",)),
            ("asymmetric_viscous", 2, {"Fva": 0.5}, ("arm",)),
            ("cubic_viscous", 1, {"Fcube": 1.0}, ("scara",)),
            ("presliding", 1, {"Fd": 2.0, "zs": 0.02}, ("arm",)),
            ("torque_ripple", 2, {"Rsin": 0.05, "Rcos": 0.0}, ("scara",)),
            ("load_dependent_friction", 1, {"Fl": 0.15}, ("arm",)),
        )
    ),
    Wrong("pair: validation with inertia + 30 %", other_values("validation", {"ZZ": 1.3, "MX": 1.3}),
          ("worse-on-held-out",), TWO),
    Wrong("pair: validation with twice the friction", other_values("validation", {"Fc": 2.0, "Fv": 2.0}),
          ("worse-on-held-out",)),
    Wrong("scale: torque x 1.2", on_data(scaled(1.2)), (*FIT, *SCALE), ("scara", "arm")),
    Wrong("scale: torque / 1.2", on_data(scaled(1 / 1.2)), (*FIT, *SCALE), ("scara", "arm")),
    *(
        Wrong(f"scale: joint {j} x {f:g}", on_data(scaled(f, j)), (*FIT, *SCALE, "drive-gain"), ("scara", "arm"))
        for j in (1, 2) for f in (2.0, 0.5)
    ),
]  # fmt: skip
"""At least sixty."""
