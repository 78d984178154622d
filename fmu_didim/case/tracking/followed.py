"""From a case with ``controller: {kind: tracking}`` to its virtual controller and what that follows in each run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.case.document import CaseDocument
from fmu_didim.case.runs.temperatures import read_temperatures
from fmu_didim.case.runs.torque_log import read_torque_log
from fmu_didim.case.sources import ExperimentSource
from fmu_didim.case.tracking.law import (
    FEEDBACK,
    NO_LOADS,
    POSTURES,
    Measured,
    VirtualLaw,
    planned_law,
    virtual_law,
)
from fmu_didim.case.tracking.positions import (
    HIGHEST,
    HIGHEST_STATED,
    LogBand,
    Positions,
    Smooth,
    bandwidth_of,
    read_positions,
)
from fmu_didim.checks.data.log import REFERENCE_STEP
from fmu_didim.components import Component
from fmu_didim.cosim import System, closed_loop
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.data.tables import Selected
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.model.parameters import RobotParameters

BORDER = 2.0
"""[periods of the bandwidth] At both ends of the positions that are not fitted: a low-pass sees the border there, and
the loop begins."""
FINE_HZ = 1000.0
"""[Hz] Least control rate where none is stated: that of most drives, at which a held torque is nearly a continuous
one."""


@dataclass(frozen=True)
class Tracking:
    """The virtual controller of a case.

    Attributes:
        law: gains and feedforward; controller: the component; bandwidth_hz: up to which positions are followed.
        runs: label -> measured positions; logs: label -> torque of each fitted one, with the motion that it belongs to.
        loads: label of a run with a load -> label of the run that describes it.
        compared_hz: to which both torques are filtered before they are compared; None where the log is too slow for it.
        reason: what sets the bandwidth, in words.
        border_hz: bandwidth by which the borders of the runs are left out; states_rate: whether the case says at which
            rate the real controller runs.
    """

    law: VirtualLaw
    controller: Component
    bandwidth_hz: float
    runs: Mapping[str, Positions]
    logs: Mapping[str, Measured]
    border_hz: float
    states_rate: bool
    compared_hz: float | None = None
    loads: Mapping[str, str] = field(default_factory=dict)
    reason: str = ""

    @classmethod
    def of(
        cls, parameters: RobotParameters, runs: Mapping[str, Positions], logs: Mapping[str, Measured], *,
        bandwidth_hz: float, step: float, border_hz: float, states_rate: bool, loads: Mapping[str, str] = NO_LOADS,
        reason: str = "",
    ) -> Tracking:  # fmt: skip
        """The virtual controller for measured positions and torques."""
        logs = {label: replace(log, motion=runs[label].smooth(bandwidth_hz)) for label, log in logs.items()}
        law = virtual_law(parameters, logs, bandwidth_hz, step, loads)
        compared = _band(logs).compared_hz(max(bandwidth_hz, border_hz))
        return cls(law, law.component(), bandwidth_hz, runs, logs, border_hz, states_rate, compared, loads, reason)

    @property
    def chosen(self) -> str:
        """The choice, in words."""
        why = f" ({self.reason})" if self.reason else ""
        return f"a bandwidth of {self.bandwidth_hz:.3g} Hz{why} and a torque held for {1000 * self.step:.3g} ms"

    def others(self) -> dict[str, Tracking]:
        """Other choices that are as good a guess, in words: half and twice the bandwidth, as far as the positions allow
        it, and where the control rate is not known a torque that is held as long as positions are apart.

        With half of it, torques are compared up to where they are with the whole, which shows what the low-pass of the
        positions takes off; with twice of it up to twice of that, which shows what their noise does.
        """
        rate = min(run.rate_hz for run in self.runs.values())
        found = {
            f"a bandwidth of {b:.3g} Hz": self._at(bandwidth_hz=b)
            for b in (self.bandwidth_hz / 2, min(2 * self.bandwidth_hz, HIGHEST_STATED * rate))
        }
        if not self.states_rate and 1 / rate > self.step * (1 + REFERENCE_STEP):
            found[f"a torque held for {1000 / rate:.3g} ms"] = self._at(step=1 / rate)
        return found

    def _at(self, *, bandwidth_hz: float | None = None, step: float | None = None) -> Tracking:
        return self.of(
            self.law.parameters, self.runs, self.logs, bandwidth_hz=bandwidth_hz or self.bandwidth_hz,
            step=step or self.step, border_hz=self.border_hz, states_rate=self.states_rate, loads=self.loads,
        )  # fmt: skip

    @property
    def step(self) -> float:
        """Control period, s."""
        return self.law.step

    @property
    def is_planned(self) -> bool:
        """Whether nothing was measured yet, so that a motion can be planned and no more."""
        return not self.runs

    def planned(self, values: Array, loaded: Mapping[str, Array], drive_gains: Array) -> Tracking:
        """The virtual controller of the same runs if the robot had these base parameters (b,), with these loads
        (label -> (b,)), and its drives these gains (n,)."""
        own = self.law
        law = planned_law(
            own.parameters, values, _postures(own.parameters), own.step, self.bandwidth_hz, loaded=loaded,
            drive_gains=drive_gains,
        )  # fmt: skip
        return replace(self, law=law, controller=law.component())

    def followed(self, reference: Trajectory, label: str) -> Trajectory:
        """What the loop follows in a run whose motion (``q<j>``) is planned: with the torque that is fed forward."""
        from scipy.interpolate import make_interp_spline  # few cases need it

        names = [f"q{j}" for j in range(1, self.law.inertia.size + 1)]
        spline = make_interp_spline(reference.time, reference.select(names), k=5)
        return self.law.reference(Smooth(spline, float(reference.time[0]), float(reference.time[-1])), label)

    def motion(self, label: str) -> Selected:
        """What the loop follows in a run; raises InputError where nothing was measured yet."""
        if self.is_planned:
            raise InputError(
                "A virtual controller follows measured positions, and those of this run are not there yet.",
                where=label, next_step="Run the machine first; fmu-didim excite plans the motion.",
            )  # fmt: skip
        run = self.runs[label]
        reference = self.law.reference(run.smooth(self.bandwidth_hz), label, run.starts)
        reference = replace(reference, source=run.source)
        return Selected(reference, run.told)

    def inside(self, source: ExperimentSource, label: str, *, borders: bool = True) -> ExperimentSource:
        """The entry of a run without the borders of its positions, and with a start on the reference; or of all of it
        in which positions at even instants are known."""
        if borders:
            return _inside(source, self.runs[label], self.border_hz)
        first, last = _part(source, *(float(self.runs[label].time[k]) for k in (0, -1)))
        return source.model_copy(update={"from_s": first, "to_s": last})

    def loop(self, plant: Component, reference: Trajectory) -> System:
        """The loop of the plant and the virtual controller."""
        return closed_loop(
            plant, self.controller, joint_count=self.law.inertia.size, step_size=self.step,
            injections=self.law.injections(), reference_names=reference.names,
        )  # fmt: skip


def tracking_of(
    document: CaseDocument, folder: Path, model: RobotModel | None, signals: Mapping[str, Trajectory]
) -> Tracking:
    """The virtual controller of a case.

    Raises:
        InputError: there is no robot description, positions or torque are missing, or they cannot be followed.
    """
    assert document.controller is not None
    parameters = _robot_of(model)
    units = parameters.torque_units
    runs = {
        label: read_positions(run, folder, signals, torque_units=units, label=label)
        for label, run in document.runs.items()
    }
    for label, run in document.runs.items():
        found = read_temperatures(run, folder, runs[label].time, len(units), label, signals)
        runs[label] = replace(runs[label], starts=found.starts)
    fitted = {label: run for label, run in document.runs.items() if run.role == "estimation"}
    step = 1 / (document.loop.rate_hz or _fine(max(run.rate_hz for run in runs.values())))
    measured = dict[str, Measured]()
    for label, run in fitted.items():
        positions, source = runs[label], _inside(run, runs[label], math.inf)
        table = Trajectory(positions.time, positions.q[:, :0], ())
        log = read_torque_log(
            source, folder, table, step=step, drive_gains=document.loop.drive_gains, torque_units=units, label=label,
            signals=signals,
        )  # fmt: skip
        time = log.times - (0.0 if source.torque is None else source.torque.log_shift_s)
        cutoff_hz = None if source.torque is None else source.torque.cutoff_hz
        smooth = positions.smooth(HIGHEST * positions.rate_hz)
        measured[label] = Measured(time, log.torque, smooth, cutoff_hz, positions.starts)
    bandwidth = bandwidth_of([runs[label] for label in fitted], document.controller.bandwidth_hz, _band(measured))
    measured = {label: log.inside(*_borders(runs[label], bandwidth.hz)) for label, log in measured.items()}
    return Tracking.of(
        parameters, runs, measured, bandwidth_hz=bandwidth.hz, step=step, border_hz=bandwidth.hz,
        states_rate=document.loop.rate_hz is not None, reason=bandwidth.reason,
        loads=_loads(document),
    )  # fmt: skip


def _band(logs: Mapping[str, Measured]) -> LogBand:
    """What all of these logs show."""
    cutoffs = [log.cutoff_hz for log in logs.values() if log.cutoff_hz is not None]
    return LogBand(min(log.rate_hz for log in logs.values()), min(cutoffs, default=None))


def planned_tracking(document: CaseDocument, model: RobotModel | None) -> Tracking:
    """The virtual controller of runs that nobody measured yet, with the values of the robot description.

    Raises:
        InputError: there is no robot description.
    """
    parameters = _robot_of(model)
    assert document.controller is not None
    step = 1 / (document.loop.rate_hz or FINE_HZ)
    bandwidth = document.controller.bandwidth_hz or FEEDBACK / step
    law = planned_law(parameters, parameters.nominal(), _postures(parameters), step, bandwidth, loaded={})
    return Tracking(
        law, law.component(), bandwidth, {}, {}, bandwidth, document.loop.rate_hz is not None, None, _loads(document)
    )


def _robot_of(model: RobotModel | None) -> RobotParameters:
    if model is None:
        raise InputError(
            "controller: {kind: tracking} takes its gains from a robot description, and the case has none.",
            where="robot", next_step="Give robot: (a description); without one the real controller is needed.",
        )  # fmt: skip
    return RobotParameters(model, base_parameters(model))


def _loads(document: CaseDocument) -> dict[str, str]:
    """Label of a run with a load -> label of the run that describes it."""
    return {k: run.load.same_as or k for k, run in document.runs.items() if run.load is not None}


def _postures(parameters: RobotParameters) -> Array:
    """(K, n) postures from anywhere in the range of each joint, the first in its middle; rad or m."""
    joints = parameters.model.description.joints
    low, high = np.array([joint.limits or (-np.pi, np.pi) for joint in joints], dtype=float).T
    return np.vstack([(low + high) / 2, np.random.default_rng(0).uniform(low, high, size=(POSTURES, low.size))])


def _fine(rate_hz: float) -> float:
    """The least whole multiple of the rate of the positions that is fine."""
    return rate_hz * max(math.ceil(FINE_HZ / rate_hz - 1e-6), 1)


def _borders(run: Positions, bandwidth_hz: float) -> tuple[float, float]:
    """First and last instant that is fitted, s."""
    border = BORDER / bandwidth_hz
    return float(run.time[0]) + border, float(run.time[-1]) - border


def _part(source: ExperimentSource, first: float, last: float) -> tuple[float, float]:
    """What an entry takes of the time from ``first`` to ``last``, s."""
    return (
        first if source.from_s is None else max(first, source.from_s),
        last if source.to_s is None else min(last, source.to_s),
    )


def _inside(source: ExperimentSource, run: Positions, bandwidth_hz: float) -> ExperimentSource:
    first, last = _part(source, *_borders(run, bandwidth_hz))
    if first >= last:
        raise InputError(
            "The run is too short for positions to be followed.", where=run.label,
            got=f"{float(run.time[-1] - run.time[0]):.3g} s, of which {BORDER / bandwidth_hz:.3g} s at both ends are "
            "not fitted",
            next_step="Give a longer run, or positions at a higher rate.",
        )  # fmt: skip
    start = "reference" if source.initial_state == "detected" else source.initial_state
    return source.model_copy(update={"from_s": first, "to_s": last, "initial_state": start})
