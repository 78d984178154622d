"""Torques from outside during some time: when they begin and end, and how large they are.

The loop reacts to an external torque within milliseconds, so the log does not simply show it. Steps of the torque are
found to first order (:mod:`fmu_didim.discovery.external_torques.search`); their times and sizes are then fitted in the
closed loop, together with the model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.external_torques.search import linear_external_torques, step_response
from fmu_didim.discovery.selection.beside_others import fit_of_smaller
from fmu_didim.discovery.selection.plausible import LONGEST
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.derivatives.differences import STEP
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import bic_gain, delta_bic, explained
from fmu_didim.fit.log_noise import motion_period, noise_beside_fit
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.external_torque import EXTERNAL_TORQUE, ExternalTorque
from fmu_didim.model.free_parameter import FreeParameter, delay_parameter
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.workers import side_by_side

LINEAR_SHARE = 0.5
"""[1] Fraction of the gap that external torques must explain to first order, with edges at control periods."""
UNBOUNDED = 0.5
"""[1] Fraction of their time that may lie in those without a visible edge."""
STAIRCASE = 0.25
"""[1] Fraction of the external torques that may follow each other without a pause: more only copy another effect."""
COMES_BACK = 0.5
"""[1] Fraction of the impulse that is there again one period later, from which it belongs to the machine."""
SAME_PHASE = 0.05
"""[1] Fraction of a period within which two phases are the same,"""
SAME_PHASE_S = 0.1
"""[s] but no longer than this: the edges of what a smooth load along the motion leaves lie farther apart (0.1 to 0.3 s
for a spring, period 8 s), but there what repeats explains more than the external torques."""
SHARE = 0.6
"""[1] Fraction of the gap that external torques must explain to be accepted."""
DELAY_START = 0.1
"""[control periods] Added to the known delay of the loop where its fit starts."""
DELAY_ROOM = 3.0
"""[control periods] By which the delay of the loop may be longer than known."""
FIRST_STEPS = 12
"""[steps] Of the fit of times and torques, and after an edge was moved."""
FURTHER_STEPS = 8
"""[steps] Once more, with the noise that is left."""
UPDATES = 2
"""[sensitivities] Taken anew at most in each of those fits."""
LAST_STEPS = 6
"""[steps] Of the last fit, beside the effects that were found."""
EDGE_MOVES = (-0.6, -0.3, 0.3, 0.6)
"""[control periods] Tried of each edge: its instant has a minimum in each control period."""
EDGE_GAIN = 1.0
"""[chi-square] Least gain of a move."""
EDGE_ROOM = 4.0
"""[samples or control periods] How far a fit may take an edge; the longer of the two."""
EDGE_SLOPE = 0.5
"""[control periods] Over which slopes of edges are taken: at an instant they change abruptly."""


@dataclass(frozen=True)
class FittedExternalTorques:
    """External torques that were found, fitted with the parameters of the model.

    Attributes:
        fit: of the model with the external torques held; free: with a delay of the loop and the times and torques of
            the external torques as the last free parameters. Both with the noise of the data without them.
        label: of the experiment in which they act.
        delta_bic: over the model without them; share: of the gap.
    """

    fit: Fit
    free: Fit
    label: str
    delta_bic: float
    share: float

    @property
    def external_torques(self) -> tuple[ExternalTorque, ...]:
        """In the order of time."""
        return self.fit.model.experiments[self.label].external_torques

    @property
    def joint(self) -> int:
        """On which they act, all of them: that where they explain most, counted from 1."""
        return self.external_torques[0].joint

    def superfluous_beside(self, final: Fit) -> Fit | None:
        """A final model without the external torques, all else fitted anew, where it is no worse by BIC; else None."""
        without = fit_of_smaller(final.model.pushed(self.label, ()), final)
        cost = float(len(self.free.values) - len(self.fit.values))
        return None if without is None or bic_gain(without, final, cost, final.noise) > 0 else without

    def refitted(self, final: Fit) -> tuple[Fit, Fit]:
        """A final model with the external torques fitted again, and the same with them as its last parameters."""
        model, label = final.model, self.label
        count = len(model.free_parameters)
        try:
            further = external_torque_parameters(final, label, model.experiments[label].external_torques)
            free = minimise(
                model.with_free((*model.free_parameters, *further)),
                final.noise,
                stopping=Stopping(LAST_STEPS, updates=1),
            )
        except SimulationError:
            return final, self.free
        held = model.pushed(label, free.simulation(label).external_torques).with_values(free.values[:count])
        fixed = replace(free, model=held, values=free.values[:count], jacobian=free.jacobian[:, :, :count])
        return fixed, free


def find_external_torques(fit: Fit, *, say: Callable[[str], None] = lambda text: None) -> FittedExternalTorques | None:
    """The external torques that explain most of the residual of a fit; None without any.

    A torque that comes back with each period of the motion belongs to the machine.
    """
    best: tuple[float, str, list[ExternalTorque]] | None = None
    for label in fit.model.estimation_labels:
        for joint in range(1, fit.model.joint_count + 1):
            response = step_response(fit, label, joint)
            if response is None:
                continue
            for is_logged in (False, True):
                answer = response + 1.0 if is_logged else response
                found = linear_external_torques(fit, label, joint, answer, is_logged)
                if found is not None and (best is None or found[0] > best[0]):
                    best = (found[0], label, found[1])
    if best is None or best[0] < LINEAR_SHARE:
        return None
    _, label, torques = best
    time, period = fit.model.experiments[label].reference.time, motion_period(fit.model, label)
    repeats = 0.0 if period is None else repeating_share(fit, label, torques[0].joint, period)
    if _is_staircase(torques) or _comes_back(torques, period, best[0], repeats) or _is_lasting(torques, time):
        return None
    say(f"{len(torques)} torques from outside on joint {torques[0].joint}")
    fitted = _fitted(fit, label, torques)
    return None if fitted is None or _comes_back(fitted.external_torques, period, fitted.share, repeats) else fitted


def _is_staircase(external_torques: list[ExternalTorque]) -> bool:
    following = sum(a.end_s == b.begin_s for a, b in pairwise(external_torques))
    return following > STAIRCASE * len(external_torques)


def _is_lasting(external_torques: list[ExternalTorque], time: Array) -> bool:
    """Whether they act most of the time, or most of them have no visible start or end."""
    lengths = np.array([p.end_s - p.begin_s for p in external_torques])
    bounded = np.array([p.begin_s > time[0] and p.end_s <= time[-1] for p in external_torques])
    long = lengths.sum() > LONGEST * (time[-1] - time[0])
    return bool(long or lengths[~bounded].sum() > UNBOUNDED * lengths.sum())


def _comes_back(external_torques: Sequence[ExternalTorque], period: float | None, share: float, repeats: float) -> bool:
    """Whether most of the impulse comes back one period of the motion later, or was there one before.

    Args:
        share: of the gap that the external torques explain; repeats: that repeats with the motion. Where that is more,
            it is enough that they overlap.
    """
    if period is None or not external_torques:
        return False
    begins = np.array([p.begin_s for p in external_torques])
    near = min(SAME_PHASE * period, SAME_PHASE_S)
    alike = [any(np.abs(begins - (b + k * period)).min() < near for k in (-1, 1)) for b in begins]
    impulses = [abs(p.torque) * (p.end_s - p.begin_s) for p in external_torques]
    again = float(np.average(alike, weights=impulses))
    return max(again, _overlap(external_torques, period) if repeats > share else 0.0) >= COMES_BACK


def _overlap(external_torques: Sequence[ExternalTorque], period: float) -> float:
    """Fraction of the impulse that acts in the same direction one period of the motion later, or did one before."""
    edges = np.unique([at + k * period for p in external_torques for at in (p.begin_s, p.end_s) for k in (-1, 0, 1)])
    middles, lengths = (edges[:-1] + edges[1:]) / 2, np.diff(edges)

    def torque(time: Array) -> Array:
        acts = [np.where((p.begin_s <= time) & (time < p.end_s), p.torque, 0.0) for p in external_torques]
        return np.asarray(np.sum(acts, axis=0))

    own = torque(middles)
    again = np.max([torque(middles + k * period) * np.sign(own) for k in (-1, 1)], axis=0)
    return float(np.minimum(np.abs(own), np.maximum(again, 0.0)) @ lengths / (np.abs(own) @ lengths))


def repeating_share(fit: Fit, label: str, joint: int, period: float) -> float:
    """Share of the gap of a joint, from 1, that is the same in each period of the motion of an experiment."""
    rows, time = fit.model.experiments.rows[label], fit.model.experiments[label].time
    residual, variance = fit.residual[rows, joint - 1], float(fit.noise.deviation[joint - 1]) ** 2
    gap = float(np.sum(residual**2)) - residual.size * variance
    most = int(np.ptp(time) // period)
    shifted = [np.interp(time + k * period, time, residual, left=np.nan, right=np.nan) for k in range(-most, most + 1)]
    count = np.sum(np.isfinite(shifted), axis=0)
    mean = np.nansum(shifted, axis=0) / count
    several = count > 1
    same = float(np.sum(mean[several] ** 2 - variance / count[several]))
    return same / gap if gap > 0 else 0.0


def _fitted(fit: Fit, label: str, external_torques: list[ExternalTorque]) -> FittedExternalTorques | None:
    """Times and torques fitted in the closed loop, with all free parameters of the model."""
    model = fit.model
    count = len(model.free_parameters)
    # Edges are so sharp that an unknown delay of the loop would go into the torques: it is free while they are fitted.
    known = float(model.loop.systems[label].delays.get(model.loop.plant_name, 0.0))
    delay = replace(
        delay_parameter(known + DELAY_START), name="loop_delay", scale=DELAY_START, lowest=known,
        highest=known + DELAY_ROOM, is_shape=True,
    )  # fmt: skip
    further = (delay, *external_torque_parameters(fit, label, external_torques))
    try:
        pushed = model.pushed(label, external_torques).with_free((*model.free_parameters, *further))
        free = minimise(pushed, fit.noise, stopping=Stopping(FIRST_STEPS, updates=UPDATES))
        noise = noise_beside_fit(free)  # until now external torques that do not repeat counted as noise
        again = Stopping(FURTHER_STEPS, updates=UPDATES)
        free = minimise(free.model, noise, outputs=free.outputs, stopping=again)
        moved = _edges_moved(free, label)
        if moved is not None:
            better = minimise(moved, noise, stopping=Stopping(FIRST_STEPS))
            free = better if better.chi_square < free.chi_square else free
        held = model.pushed(label, free.simulation(label).external_torques)
        fixed = minimise(held.with_values(free.values[:count]), noise, stopping=Stopping(updates=1))
    except SimulationError:
        return None
    gain = delta_bic(fit.residual, fixed.residual, float(len(further)), noise)
    _, share = explained(fit.residual, fixed.residual, noise)
    explains = gain > 0 and share >= SHARE
    return FittedExternalTorques(fixed, free, label, gain, share) if explains else None


def _edges_moved(free: Fit, label: str) -> LoopModel | None:
    """The model with edges moved to a neighbouring control period where that fits better; None if nowhere.

    An instant has a minimum in each period: the slope of a torque that is held changes from period to period.
    """
    model, weight = free.model, free.noise.weight
    step = model.experiments[label].reference.step
    edges = [i for i, k in enumerate(model.free_parameters) if k.owner == EXTERNAL_TORQUE and k.is_shape]
    table = (free.jacobian * weight[:, None]).reshape(-1, free.values.size)
    measured, places = model.measured, np.arange(free.values.size)
    tried = [(i, part * step) for i in edges for part in EDGE_MOVES]
    tasks = [partial(model.torque, free.values + change * (places == i)) for i, change in tried]
    torques = side_by_side(tasks, model.allowed_workers(free.values))
    values, best = free.values.copy(), dict.fromkeys(edges, free.chi_square - EDGE_GAIN)
    for (i, change), torque in zip(tried, torques, strict=True):
        rest = BaseProjection.of(np.delete(table, i, axis=1)).rest_of(((measured - torque) * weight).ravel())
        cost = float(rest @ rest)
        if cost < best[i]:
            best[i], values[i] = cost, free.values[i] + change
    return None if np.array_equal(values, free.values) else model.with_values(values)


def external_torque_parameters(fit: Fit, label: str, external_torques: Sequence[ExternalTorque]) -> list[FreeParameter]:
    """Times and torques of external torques as free parameters of an experiment."""
    model, experiment = fit.model, fit.model.experiments[label]
    time, rate = experiment.reference.time, experiment.rate_hz
    step, size = experiment.reference.step, max(abs(p.torque) for p in external_torques)
    unit = model.parameters.torque_units[external_torques[0].joint - 1]
    room = max(EDGE_ROOM / rate, EDGE_ROOM * step)
    found: list[FreeParameter] = []
    for i, external in enumerate(external_torques):
        torque, key = external.torque, f"{i}.torque"
        found.append(FreeParameter(f"F[{i + 1}]", unit, EXTERNAL_TORQUE, key, torque, size, experiment=label))
        for shown, name in (("t_on", "begin_s"), ("t_off", "end_s")):
            at = float(getattr(external, name))
            if float(time[0]) < at < float(time[-1]) + step:  # an edge outside the data cannot be fitted
                half = EDGE_SLOPE * step / STEP
                found.append(
                    FreeParameter(
                        f"{shown}[{i + 1}]", "s", EXTERNAL_TORQUE, f"{i}.{name}", at, half, at - room, at + room,
                        is_shape=True, experiment=label,
                    )
                )  # fmt: skip
    return found
