"""The contest of the laws in the closed loop, where positions were logged too slowly to show what the controller saw.

    values = (base parameters of the robot, gains of all joints)  ->  closed-loop simulation  ->  torque, positions
    BIC = sum over outputs of N log(variance of the residual) + (free values) log(all samples)

Each law with its gains runs in the loop with the robot of the case; both are fitted to torque and positions at once.
Whatever is named depends on the robot description: a law that fits none may be a robot that lacks something.

A regression along a spline through the positions, which costs a hundredth, says where to begin and what is hopeless: it
misses what happens between the samples, alike for all laws.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fmu_didim.base.distributions import chi2_sf
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.case import Case
from fmu_didim.controllers import LAWS as KINDS
from fmu_didim.data.signals import Array
from fmu_didim.estimators import no_progress
from fmu_didim.estimators.joint import motion_minimum
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.fit.solver.accuracy import integrated, with_fitting_substeps
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.workflow.naming.catalogue import EQUAL_EFFECT, LAWS, TIMES, Candidate, Extra, simpler, takes
from fmu_didim.workflow.naming.contest import Contest
from fmu_didim.workflow.naming.logs import Logs
from fmu_didim.workflow.naming.named import Member, gains_of
from fmu_didim.workflow.naming.regression import JointProblem

IN_LOOP: tuple[Extra, ...] = ("acceleration", "filter", "lag")
"""Extras that are tried in the loop; a delay of a slow log is one with its lag."""
LEADERS, MOST_EXTRAS = 3, 2
"""[candidates, extras] Whose neighbours are tried, and how many extras one has at most."""
FIRST = 4
"""[candidates] The first ones of the regression, which are tried in any case."""
HOPELESS = 2.0
"""[1] What a law leaves in the regression along the spline, over what the best one leaves there, at a joint: above it
the law is not tried in the loop. What the spline misses is left by all, the right one among them."""
LEAST_TIME = 0.2
"""[control periods] Of a time, at least: it acts by exp(-1 / this) there, less than a log shows, and at zero its column
is zero, by which a fit ends: a step that took the filter of one joint of six there lost the right law."""
LAGS = 10
"""[samples] Over which neighbouring residuals are compared."""


@dataclass(frozen=True)
class LoopEntry:
    """A candidate that was fitted in the loop.

    Attributes:
        fit: its minimum; names: of the gains among its values, joint by joint; cost: -2 log likelihood but for a
            constant.
    """

    candidate: Candidate
    fit: Fit
    cost: float

    @property
    def count(self) -> int:
        """Free values."""
        return int(self.fit.values.size)

    @property
    def bic(self) -> float:
        """Bayesian information criterion."""
        return float(self.cost + self.count * np.log(self.fit.model.output_counts.sum()))

    @property
    def akaike(self) -> float:
        """-2 log likelihood + 2 (free values)."""
        return self.cost + 2 * self.count

    def values(self, joints: int, found: Array | None = None) -> list[dict[str, float]]:
        """Values of the law, a mapping for each joint; ``found``: (p,) others than those of the fit."""
        known = dict(zip(self.fit.model.names, self.fit.values if found is None else found, strict=True))
        return [{name: float(known[f"{name}{j}"]) for name in self.candidate.names} for j in range(1, joints + 1)]

    @property
    def whiteness(self) -> Array:
        """(m,) chance of residuals as alike as these by white noise, output by output."""
        return np.array([white_chance(column[np.isfinite(column) & (column != 0)]) for column in self.fit.residual.T])


def white_chance(residual: Array) -> float:
    """Chance of neighbouring samples (N,) as alike as these in white noise (Ljung, Box, Biometrika 65, 1978)."""
    count = residual.size
    centred = residual - residual.mean()
    power = float(centred @ centred)
    if count <= 2 * LAGS or power == 0:
        return 1.0
    alike = np.array([centred[lag:] @ centred[:-lag] / power for lag in range(1, LAGS + 1)])
    statistic = count * (count + 2) * np.sum(alike**2 / (count - np.arange(1, LAGS + 1)))
    return float(chi2_sf(statistic, LAGS))


@dataclass
class LoopContest:
    """Candidates in the loop of a case, each fitted once."""

    logs: Logs
    entries: dict[Candidate, LoopEntry] = field(default_factory=dict)
    failed: dict[Candidate, str] = field(default_factory=dict)
    progress: Callable[[str], None] = lambda text: None

    def __post_init__(self) -> None:
        problems = [JointProblem.of(runs) for runs in self.logs.joints]
        self.problems = [replace(p, noise=replace(p.noise, position=0.0)) for p in problems]
        self.rough = Contest(self.problems)
        self.case = with_measured(self.logs.case)

    def run(self) -> list[LoopEntry]:
        """All entries, the best first."""
        self.progress("regression along the positions")
        self.rough.search()
        known = [_in_loop(entry.candidate) for entry in self.rough.ranked]
        self.least = self._left(known[0])
        firsts = list(dict.fromkeys(known))[:FIRST]
        of_laws = {candidate.law.name: candidate for candidate in reversed(known)}
        for candidate in [*firsts, *filter(self._has_hope, reversed(of_laws.values()))]:
            self.fit(candidate)
        looked: set[Candidate] = set()
        while new := [e.candidate for e in self.ranked[:LEADERS] if e.candidate not in looked]:
            looked.update(new)
            for candidate in new:
                for other in filter(self._has_hope, self._neighbours(candidate)):
                    self.fit(other)
        return self.ranked

    def _left(self, candidate: Candidate) -> Array:
        """(n,) RMS that a law leaves in the regression, over the noise of the torque."""
        joints = self.rough.fit(candidate).joints
        return np.array([np.sqrt(fit.cost / fit.samples) for fit in joints])

    def _has_hope(self, candidate: Candidate) -> bool:
        return bool(np.all(self._left(candidate) <= HOPELESS * np.maximum(self.least, 1.0)))

    @property
    def ranked(self) -> list[LoopEntry]:
        """The best first."""
        return sorted(self.entries.values(), key=lambda entry: entry.bic)

    def _neighbours(self, candidate: Candidate) -> list[Candidate]:
        found = [Candidate(candidate.law, rate, candidate.extras) for rate in candidate.law.rates]
        found += [Candidate(law, candidate.rate, candidate.extras) for law in LAWS if law.name in EQUAL_EFFECT
                  and candidate.law.name in EQUAL_EFFECT and candidate.rate in law.rates]  # fmt: skip
        found += [*simpler(candidate), *(candidate.without(extra) for extra in candidate.extras)]
        if len(candidate.extras) < MOST_EXTRAS:
            found += [candidate.with_extra(extra) for extra in IN_LOOP if takes(candidate, extra)]
        return found

    def fit(self, candidate: Candidate) -> None:
        """A candidate from where the regression leaves it."""
        if candidate in self.entries or candidate in self.failed:
            return
        self.progress(f"fitting {candidate.words}")
        found = self.fit_from(candidate, self._start(candidate))
        if found is not None:
            self.entries[candidate] = found

    def fit_from(self, candidate: Candidate, start: Sequence[Mapping[str, float]]) -> LoopEntry | None:
        """A candidate from these values; None where it cannot be simulated or has what is not tried in the loop."""
        if set(candidate.extras) - set(IN_LOOP):
            return None
        try:
            return self._fitted(candidate, start)
        except FmuDidimError as error:
            self.failed[candidate] = error.what
            return None

    def _fitted(self, candidate: Candidate, start: Sequence[Mapping[str, float]]) -> LoopEntry:
        model = self.model(candidate, start).model
        model = with_fitting_substeps(model, model.start)
        # What is left may be far less than at the start, and the steps then too long for it.
        fit = integrated(minimise(model, NoiseOfResidual(model)))
        counts = model.output_counts
        variance = np.nansum(fit.residual**2, axis=0) / counts
        return LoopEntry(candidate, fit, float(np.sum(counts * np.log(variance))))

    def model(self, candidate: Candidate, start: Sequence[Mapping[str, float]]) -> Case:
        """The case with a law whose gains are free."""
        block, least = _block(candidate, self.logs), LEAST_TIME * self.logs.step
        free: dict[str, Any] = {
            f"{name}{j}": {"of": "controller", "start": value, **({"minimum": least} if name in TIMES else {})}
            for j, values in enumerate(start, start=1)
            for name, value in values.items()
        }
        plant = {n: e for n, e in (self.case.content.get("identify") or {}).items() if e.get("of", "plant") == "plant"}
        return self.case.with_(controller=block, identify={**plant, **free}, loop={"rate_hz": 1 / self.logs.step})

    def _start(self, candidate: Candidate) -> list[dict[str, float]]:
        """From the regression, joint by joint; a time that is none there begins at the least one."""
        least = dict.fromkeys(TIMES, LEAST_TIME * self.logs.step)
        fits = self.rough.fit(candidate).joints
        return [{name: max(value, least.get(name, -np.inf)) for name, value in fit.values.items()} for fit in fits]

    def settled(self, entry: LoopEntry) -> Member:
        """The same as ``member``; without a standard deviation where the loop does not determine all gains, as of a
        filter that is none."""
        try:
            return self.member(entry)
        except FmuDidimError:
            found = entry.values(len(self.problems))
            return Member(entry.candidate, gains_of(found, [dict.fromkeys(one, np.inf) for one in found]))

    def member(self, entry: LoopEntry) -> Member:
        """The law of an entry with its gains at the end of an efficient fit, and their standard deviations.

        Raises:
            FmuDidimError: the loop cannot be fitted.
        """
        minimum = motion_minimum(entry.fit.model.with_values(entry.fit.values), tolerance=1e-6, progress=no_progress)
        found, n = LoopEntry(entry.candidate, minimum.fit, entry.cost), len(self.problems)
        return Member(entry.candidate, gains_of(found.values(n), found.values(n, minimum.known.deviation)))


def _in_loop(candidate: Candidate) -> Candidate:
    """A candidate without what is not tried in the loop."""
    return replace(candidate, extras=tuple(extra for extra in candidate.extras if extra in IN_LOOP)[:MOST_EXTRAS])


def _block(candidate: Candidate, logs: Logs) -> Any:
    ones = [dict.fromkeys(candidate.names, 1.0)] * len(logs.kinds)
    description = candidate.description(
        ones, name="named_controller", joints=logs.kinds, rate_hz=1 / logs.step, unit="N.m"
    )  # fmt: skip
    return KINDS[candidate.law.kind].model_validate(description).block()


def with_measured(case: Case) -> Case:
    """The case with positions as what is fitted beside the torque, and without runs that are held out."""
    content = case.content

    def changed(run: Mapping[str, Any]) -> dict[str, Any]:
        positions = run.get("positions")
        return {} if positions is None else {"positions": None, "measured": dict(positions)}

    changes: dict[str, Any] = {"estimator": {"kind": "clie"}, "validation": None, "low_pass": None}
    if "train" in content:
        changes["train"] = changed(content["train"])
    if "experiments" in content:
        changes["experiments"] = {
            label: changed(run) if run.get("role", "estimation") == "estimation" else None
            for label, run in content["experiments"].items()
        }
    return case.with_(**changes)  # type: ignore[typeddict-item]
