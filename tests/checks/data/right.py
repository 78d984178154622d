"""Right data of some robots, made by their own loops: random motions, noise, start values off by up to 2.5."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from fmu_didim.campaigns.planning.truth import unit_noise
from fmu_didim.case import Case, load_case
from fmu_didim.cosim import sample_operator
from fmu_didim.data.excitation import Fourier
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel

CASES = {
    "scara": "examples/scara/identify.yaml",
    "arm": "examples/arm2r/discover.yaml",
    "tx40": "examples/tx40/discover_load.yaml",
    "tx40_5khz": "examples/tx40/discover_load.yaml",
    "axis": "tests/tools/verdict/robots/axis_case.yaml",
    "puma560": "tests/tools/verdict/robots/puma560_case.yaml",
    "rv2sq": "tests/tools/verdict/robots/rv2sq_case.yaml",
}
CONTROLLERS = {"tx40_5khz": "controllers/tx40_pd.yaml"}
"""Of cases that have another one."""
RATES = {"scara": 50.0} | dict.fromkeys(("arm", "axis", "tx40", "tx40_5khz", "puma560", "rv2sq"), 100.0)
OFF = 2.5
"""Largest factor by which start values are wrong, up or down."""
NOISE = 0.03
"""Standard deviation of the noise, of that of the torque."""
RANGE = 1.25
"""[1] Of a converter of the torque, over the largest torque of a joint."""
MEMORY_S = 0.05
"""Memory of the coloured part of the noise."""


@cache
def loaded(robot: str) -> LoopModel:
    """The loop of a robot along the motions of its example, with the true values."""
    return case_of(robot).model


@cache
def case_of(robot: str) -> Case:
    """The case of a robot."""
    case = load_case(CASES[robot])
    if robot not in CONTROLLERS:
        return case
    return case.with_(controller={"kind": "model", "source": str(Path(CONTROLLERS[robot]).resolve())})


def motion(robot: str, seed: int, label: str = "estimation") -> Trajectory:
    """The Fourier series of the example with other phases: as wide and as fast, and within the range of the robot."""
    rng = np.random.default_rng([seed, len(label)])
    case = case_of(robot)
    source = case.document.runs[label].reference
    assert isinstance(source, Fourier)
    joints = []
    for joint in source.joints:
        size = np.hypot(joint.cosine, joint.sine)
        angle = rng.uniform(0, 2 * np.pi, size=size.size)
        joints.append(
            joint.model_copy(update={"cosine": tuple(size * np.cos(angle)), "sine": tuple(size * np.sin(angle))})
        )
    duration = min(source.duration_s, 10.0)
    return source.model_copy(update={"joints": tuple(joints), "duration_s": duration}).trajectory(1 / case.step_size)


@cache
def right(
    robot: str,
    seed: int,
    *,
    rate_hz: float | None = None,
    change: Callable[[LoopModel], LoopModel] | None = None,
    noise: float = NOISE,
    coloured: float = 0.0,
) -> LoopModel:
    """The loop with logs of its own, a share of noise, and start values that are wrong.

    Args:
        change: what the real loop is other than the model says: the logs are then wrong.
        noise: its standard deviation, of that of the torque; coloured: share of its variance that is autoregressive.
    """
    truth = loaded(robot)
    rng = np.random.default_rng([seed, 7])
    model = truth
    for label in truth.experiments:
        run = logged(truth, label, motion(robot, seed, label), rate_hz or RATES[robot])
        real = run if change is None else change(run.on(label))
        torque = real.torque(real.start, label)
        unit = unit_noise(rng, run.experiments[label].time, torque.shape[1], coloured=coloured, memory_s=MEMORY_S)
        errors = noise * torque.std(axis=0) * unit
        model = model.with_experiment(label, replace(run.experiments[label], torque=torque + errors))
    while True:
        values = truth.start * np.exp(rng.uniform(-1, 1, size=truth.start.size) * np.log(OFF))
        if not mass_matrix_problem(model, values):
            return model.with_values(values)


def logged(model: LoopModel, label: str, reference: Trajectory, rate_hz: float) -> LoopModel:
    """The model along another reference, its log still empty, to the last sample that the rate allows."""
    time = np.arange(int(reference.time[-1] * rate_hz + 1e-9)) / rate_hz
    step = model.loop.systems[label].step_size
    operator = sample_operator(time, start=0.0, step=step, tick_count=reference.time.size)
    torque = np.zeros((time.size, model.joint_count))
    return model.with_experiment(
        label,
        replace(
            model.experiments[label], reference=reference, time=time, torque=torque, operator=operator, stamps=time
        ),
    )


def with_log(model: LoopModel, change: Callable[[Array], Array], label: str = "estimation") -> LoopModel:
    """The model with a changed torque in a log."""
    experiment = model.experiments[label]
    return model.with_experiment(label, replace(experiment, torque=change(experiment.torque.copy())))


def with_columns(model: LoopModel, change: Callable[[str, Array], Array], label: str = "estimation") -> LoopModel:
    """The model with changed columns in a reference."""
    experiment = model.experiments[label]
    old = experiment.reference
    values = np.column_stack([change(name, old.column(name).copy()) for name in old.names])
    return model.with_experiment(label, replace(experiment, reference=replace(old, values=values)))


def with_experiment(model: LoopModel, label: str = "estimation", **changes: object) -> LoopModel:
    """The model with other entries of an experiment."""
    experiment: Experiment = replace(model.experiments[label], **changes)  # type: ignore[arg-type]
    return model.with_experiment(label, experiment)


def quantised(model: LoopModel, bits: int) -> LoopModel:
    """The model with the torques of its logs as a converter gives them, whose range is ``RANGE`` times the largest."""
    largest = np.max([np.abs(experiment.torque).max(axis=0) for experiment in model.experiments.values()], axis=0)
    step = 2 * RANGE * largest / 2**bits
    for label, experiment in model.experiments.items():
        model = model.with_experiment(label, replace(experiment, torque=np.rint(experiment.torque / step) * step))
    return model
