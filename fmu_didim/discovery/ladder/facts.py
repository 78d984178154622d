"""In what runs differ: motion, speed, load, gains, unit and day, computed from loop and data as far as possible.

A label says nothing. Another motion is one that the fitted runs do not hold; another speed is that of the reference;
another load is one that changes the torque of the joint; other gains are those in the controller that is run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.data.runs import COPIED, copied, during_log
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.discovery.ladder.motions import new_part, velocities
from fmu_didim.fit.fit import Fit
from fmu_didim.model.experiment import Experiment, Role
from fmu_didim.model.loop_model import LoopModel

OTHER_SPEED = 1.5
"""[1] Ratio of RMS velocities from which one run is faster than another: what grows with the velocity then differs by a
half, what grows with its square by more than twice."""
OTHER_LOAD = 0.1
"""[1] Of the RMS torque of a joint, by which a load must change it to be another load for that joint."""
OTHER_GAIN = 0.1
"""[1] Change of a parameter of the controller from which its gains are others: less hardly moves a loop."""
INERTIAL = frozenset({"kg", "kg.m", "kg.m2"})
"""Units of base parameters that a load moves."""
OF_MOTION = ("q", "dq", "ddq")


@dataclass(frozen=True)
class RunFacts:
    """What is known of a run beside those of the fit.

    Attributes:
        role: whether it is fitted; seconds: of its log.
        new: part of its motion that no other fitted run holds.
        is_copied: whether its log is that of another fitted run, or a part of it.
        injected: columns beside the motion that are not zero here and are in no fitted run.
        speed: (n,) RMS velocity of each joint over that of the first fitted run; NaN where that one stood still.
        load: (n,) by how much its load changes the RMS torque of each joint against that of the first fitted run.
        gains: parameters of the controller that differ from those of the first fitted run -> ratio.
        unit: of the machine, as the case states it, else empty; day: of the log, None where it is not known.
    """

    role: Role
    seconds: float
    new: float = 1.0
    is_copied: bool = False
    injected: tuple[str, ...] = ()
    speed: Array = field(default_factory=lambda: np.ones(1))
    load: Array = field(default_factory=lambda: np.zeros(1))
    gains: Mapping[str, float] = field(default_factory=dict)
    unit: str = ""
    day: date | None = None

    def speed_of(self, joint: int | None) -> float:
        """Its speed as a ratio: of a joint, from 1, or of all of them, by their geometric mean."""
        known = self.speed[np.isfinite(self.speed) & (self.speed > 0)] if joint is None else self.speed[[joint - 1]]
        return float(np.exp(np.mean(np.log(known)))) if known.size and (known > 0).all() else float("nan")

    def load_of(self, joint: int | None) -> float:
        """By how much its load changes the torque of a joint, from 1, or of that where it changes most."""
        return float(self.load.max() if joint is None else self.load[joint - 1])


def facts_of(fit: Fit) -> dict[str, RunFacts]:
    """Label of each run -> what is known of it; ``fit``: of the model whose torques tell how much a load matters."""
    model = fit.model
    experiments, n = model.experiments, model.joint_count
    fitted = experiments.estimation_labels
    logged = {label: during_log(one) for label, one in experiments.items()}
    at_home = _speed(logged[fitted[0]], n)
    extra = {name for label in fitted for name in _injected(experiments[label])}
    loads, found = _loads(fit), {}
    for label, one in experiments.items():
        others = [other for other in fitted if other != label]
        found[label] = RunFacts(
            role=one.role, seconds=float(np.ptp(one.time)),
            new=new_in(model, label),
            is_copied=any(copied(one.torque, experiments[other].torque) > COPIED for other in others),
            injected=tuple(name for name in _injected(one) if name not in extra),
            speed=_speed(logged[label], n) / np.where(at_home > 0, at_home, np.nan),
            load=loads[label], gains=_gains(model, fit.values, label, fitted[0]), unit=one.unit, day=one.day,
        )  # fmt: skip
    return found


def new_in(model: LoopModel, label: str) -> float:
    """The part of the motion of a run that no fitted run but itself holds."""
    experiments = model.experiments
    own, others = experiments[label], (experiments[one] for one in experiments.estimation_labels if one != label)
    parts = (new_part(during_log(own), during_log(other), model.joint_count) for other in others)
    return min(parts, default=1.0)


def _speed(motion: Trajectory, n: int) -> Array:
    return np.asarray(np.sqrt(np.mean(velocities(motion, n) ** 2, axis=0)))


def _injected(one: Experiment) -> list[str]:
    """Columns of a reference beside positions and their derivatives that are not zero."""
    names = [name for name in one.reference.names if name.rstrip("0123456789") not in OF_MOTION]
    return [name for name in names if one.reference.select([name]).any()]


def _loads(fit: Fit) -> dict[str, Array]:
    """Label -> (n,) RMS change of the torque by the load of a run, to first order, over the RMS torque."""
    model, n = fit.model, fit.model.joint_count
    first = model.estimation_labels[0]
    units = np.array([k.unit in INERTIAL for k in model.free_parameters.shared_base], dtype=bool)
    found = {}
    for label, one in model.experiments.items():
        change = np.where(units, model.theta(fit.values, label) - model.theta(fit.values, first), 0.0)
        size = np.zeros(n)
        if change.any():
            size = _moved(fit, label, change) / np.maximum(
                np.sqrt(np.mean(one.torque**2, axis=0)), np.finfo(float).tiny
            )
        found[label] = size
    return found


def _moved(fit: Fit, label: str, change: Array) -> Array:
    """(n,) RMS change of the torque in a run by a change (b,) of its base parameters; zero where it does not run."""
    model, places = fit.model, fit.model.free_parameters.places(label)
    try:
        columns = columns_in(fit, label)
    except SimulationError:
        return np.zeros(model.joint_count)
    own = columns[:, : model.joint_count, :][:, :, places] @ change
    return np.asarray(np.sqrt(np.mean(own**2, axis=0)))


def columns_in(fit: Fit, label: str) -> Array:
    """(M, m, p) sensitivity of all outputs in one experiment, fitted or held out; raises SimulationError."""
    experiments = fit.model.experiments
    if label in experiments.estimation_labels:
        return fit.jacobian[experiments.output_rows[label]]
    begin = 0
    for other in experiments.validation_labels:
        count = experiments[other].instants.size if experiments.channels else experiments[other].time.size
        if other == label:
            return fit.held_out_jacobian[begin : begin + count]
        begin += count
    return np.zeros((0, *fit.jacobian.shape[1:]))


def _gains(model: LoopModel, values: Array, label: str, first: str) -> dict[str, float]:
    """Parameter of a component beside the plant, of those that a case may state for a run -> ratio to the first one."""
    own, other = (_controllers(model, values, one) for one in (label, first))
    ratios = {name: value / other[name] for name, value in own.items() if other.get(name)}
    return {name: r for name, r in ratios.items() if r <= 0 or abs(np.log(r)) > np.log1p(OTHER_GAIN)}


def _controllers(model: LoopModel, values: Array, label: str) -> dict[str, float]:
    """``component.parameter`` -> value, of all components but the plant, those that are free as they are fitted."""
    loop, free = model.loop, model.free_parameters.others(values, label)
    return {
        f"{name}.{v.name}": free.get(name, {}).get(v.name, v.start)
        for name, component in loop.systems[label].components.items()
        if name != loop.plant_name and name not in loop.added_components
        for v in component.parameters
    }
