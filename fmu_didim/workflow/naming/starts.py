"""Where the fit of a law begins: at a linear fit over the frequencies of the motion, and at fits of simpler laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fmu_didim.workflow.naming.catalogue import EXTRAS, Candidate, Extra, Law
from fmu_didim.workflow.naming.regression import JointProblem

START_TIMES = (0.5, 2.0)
"""[control periods] Of a filter, a lag and a delay at the start: from one of them the least may be none at all, where
the gain of the velocity takes its place."""
START_LIMIT = 0.98
"""[quantile] Of the size of the torque, at which a limit begins: some of the samples are at it."""
LEAST = 1e-6
"""[1] Of the largest size, what a gain has at least at the start."""


def law_starts(problem: JointProblem, law: Law) -> list[dict[str, float]]:
    """Gains of linear fits over the frequencies of the motion.

    parallel  tau = Kp e + Kd (dq_ref - dq) + Ki I(e)
    cascade   tau = r q_ref - s q + b dq_ref - c dq + d I(e),  c = Kp, b = Kp feedforward, s = Kp Kv + Ki, d = Ki Kv
    """
    if not law.is_cascade:
        names = {"Kp": "e", "Kd": "rate", "Ki": "integral"}
        found = _linear(problem, [names[gain] for gain in law.gains])
        return [{gain: found[names[gain]] for gain in law.gains}]
    wanted = ["dq_ref"] if law.fixed.get("feedforward", 1.0) else []
    columns = ["e", *wanted, "dq", *(["integral", "q"] if law.integrates else [])]
    found = _linear(problem, columns)
    c = found["dq"] if found["dq"] > 0 else LEAST * max(abs(found["e"]), 1.0)
    share = found.get("dq_ref", 0.0) / c
    if not law.integrates:
        starts = [{"Kv": found["e"] / c, "Kp": c}]
    else:  # c Kv^2 - s Kv + d = 0 has two solutions; more than these where noise makes them complex
        both, d = found["e"] + found["q"], found["integral"]
        root = np.sqrt(max(both * both - 4 * c * d, 0.0))
        starts = [{"Kv": kv, "Kp": c, "Ki": both - kv * c} for kv in ((both + root) / (2 * c), (both - root) / (2 * c))]
    return [{name: float({**one, "feedforward": share}[name]) for name in law.gains} for one in starts]


def extra_start(problem: JointProblem, extra: Extra, periods: float) -> float:
    """Value of an extra's parameter at the start; that of a time in control periods."""
    if extra in ("filter", "lag", "delay"):
        return periods * problem.runs[0].step
    torque = np.concatenate([run.torque for run in problem.runs])
    if extra == "limit":
        return float(np.quantile(np.abs(torque), START_LIMIT))
    wanted = np.concatenate([run.ddq_ref for run in problem.runs])
    return 0.05 * float(np.std(torque)) / (float(np.std(wanted)) or 1.0)


def with_extras(
    problem: JointProblem, candidate: Candidate, known: Sequence[Mapping[str, float]]
) -> list[dict[str, float]]:
    """Starts of a candidate from values of simpler ones, or of itself with another velocity: as they are, and with
    times that are fresh."""
    found = [dict(start) for start in known if set(candidate.names) <= set(start)]
    for periods in START_TIMES if candidate.times else START_TIMES[:1]:
        fresh = {EXTRAS[extra][0]: extra_start(problem, extra, periods) for extra in candidate.extras}
        own = {name: fresh[name] for name in candidate.times}
        found += [{**fresh, **start, **own} for start in known]
    ordered = [{name: one[name] for name in candidate.names} for one in found]
    return [one for k, one in enumerate(ordered) if one not in ordered[:k]]


def _linear(problem: JointProblem, names: Sequence[str]) -> dict[str, float]:
    """Factors of the columns of these names, at the frequencies of the motion."""
    tables, targets = [], []
    for run, moving in zip(problem.runs, problem.moving, strict=True):
        error = run.q_ref - run.q
        known = {
            "e": error, "rate": run.dq_ref - run.dq, "dq_ref": run.dq_ref, "dq": -run.dq, "q": -run.q,
            "integral": run.step * np.concatenate([[0.0], np.cumsum(error[:-1])]),
        }  # fmt: skip
        table = np.column_stack([*(known[name][run.rows] for name in names), run.torque])
        spectra = np.fft.rfft(table, axis=0)[1:][:moving]
        both = np.vstack([spectra.real, spectra.imag])
        tables.append(both[:, :-1])
        targets.append(both[:, -1])
    table, target = np.vstack(tables), np.concatenate(targets)
    scale = np.linalg.norm(table, axis=0) + np.finfo(float).tiny
    found = np.linalg.lstsq(table / scale, target, rcond=None)[0] / scale
    return dict(zip(names, map(float, found), strict=True))
