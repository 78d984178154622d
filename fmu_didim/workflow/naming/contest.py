"""The contest of the laws: one law with its extras for all joints, gains of each joint; the best by BIC, and who ties.

    BIC = sum over joints of J + (free values) log N,    J with the noise that the winner leaves

First every law alone, then the best of each law with each extra, then what differs from the leaders by an extra or by
the way to the velocity, until the leaders stay. Where the noise that the winner leaves is of the other kind, all again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.workflow.naming.catalogue import EXTRAS, Candidate, Extra, candidates, simpler, takes
from fmu_didim.workflow.naming.regression import JointFit, JointProblem
from fmu_didim.workflow.naming.starts import law_starts, with_extras

LEADERS = 3
"""[candidates] Whose neighbours are tried."""
REFITTED = 24
"""[candidates] The first ones, that are fitted again with the noise that the winner shows."""
MOST_EXTRAS = 3
"""[1] Of a candidate: more would fit anything."""
PLATEAU = 6
"""[samples] In a row within the noise of the largest torque, from which a limit is tried."""


@dataclass(frozen=True)
class Entry:
    """A candidate that was fitted at all joints."""

    candidate: Candidate
    joints: tuple[JointFit, ...]

    @property
    def bic(self) -> float:
        """Bayesian information criterion; the least is the best."""
        return float(sum(fit.cost + fit.count * np.log(fit.samples) for fit in self.joints))

    @property
    def akaike(self) -> float:
        """J + 2 (free values)."""
        return float(sum(fit.cost + 2 * fit.count for fit in self.joints))


@dataclass
class Contest:
    """Candidates at all joints, each fitted once for the levels of noise at hand."""

    problems: list[JointProblem]
    entries: dict[Candidate, Entry] = field(default_factory=dict)
    progress: Callable[[str], None] = lambda text: None

    @property
    def extras(self) -> tuple[Extra, ...]:
        """Those that are tried: a limit only where the torque stays at its largest."""
        limited = any(stays_at_its_largest(run.torque, p.noise.torque) for p in self.problems for run in p.runs)
        return tuple(extra for extra in EXTRAS if extra != "limit" or limited)

    def run(self) -> list[Entry]:
        """All entries, the best first."""
        self.search()
        problems = [p.with_noise_of(fit) for p, fit in zip(self.problems, self.ranked[0].joints, strict=True)]
        other = any(
            new.noise.position == 0 < old.noise.position for new, old in zip(problems, self.problems, strict=True)
        )
        self.problems = problems
        if other:
            self.entries = {}
            self.search()
        else:
            self._again()
        return self.ranked

    def _again(self) -> None:
        """The first entries with the noise at hand; the others are forgotten."""
        first = self.ranked[:REFITTED]
        self.entries = {}
        for entry in first:
            self.fit(entry.candidate, [[fit.values] for fit in entry.joints])

    @property
    def ranked(self) -> list[Entry]:
        """The best first."""
        return sorted(self.entries.values(), key=lambda entry: entry.bic)

    def search(self) -> None:
        """Fit all that may be the best, with the levels of noise at hand."""
        for candidate in candidates():
            self.fit(candidate)
        for entry in self._of_each_law():
            for extra in self.extras:
                if extra != "limit" and takes(entry.candidate, extra):
                    self.fit(entry.candidate.with_extra(extra))
        looked: set[Candidate] = set()
        while new := [e.candidate for e in self.ranked[:LEADERS] if e.candidate not in looked]:
            looked.update(new)
            for candidate in new:
                for other in self._neighbours(candidate):
                    self.fit(other)

    def _of_each_law(self) -> list[Entry]:
        """The best entry of each law."""
        found: dict[str, Entry] = {}
        for entry in self.ranked:
            found.setdefault(entry.candidate.law.name, entry)
        return list(found.values())

    def _neighbours(self, candidate: Candidate) -> list[Candidate]:
        """What differs by one extra, or by the way to the velocity, and simpler laws that it contains."""
        found = [Candidate(candidate.law, rate, candidate.extras) for rate in candidate.law.rates]
        found += [*simpler(candidate), *(candidate.without(extra) for extra in candidate.extras)]
        if len(candidate.extras) < MOST_EXTRAS:
            found += [candidate.with_extra(extra) for extra in self.extras if takes(candidate, extra)]
        return found

    def fit(self, candidate: Candidate, starts: Sequence[Sequence[Mapping[str, float]]] | None = None) -> Entry:
        """A candidate at all joints."""
        if candidate not in self.entries:
            begin = starts or [self._starts(candidate, j) for j in range(len(self.problems))]
            fits = [problem.fit(candidate, begin[j]) for j, problem in enumerate(self.problems)]
            self.entries[candidate] = Entry(candidate, tuple(fits))
            if "limit" in candidate.extras and not any(map(JointProblem.is_limited, self.problems, fits)):
                self.entries[candidate] = Entry(candidate, tuple(replace(fit, cost=np.inf) for fit in fits))
        return self.entries[candidate]

    def _starts(self, candidate: Candidate, joint: int) -> list[dict[str, float]]:
        """From the linear fit, or from the same law with an extra less."""
        problem = self.problems[joint]
        before: Iterable[Entry] = (
            self.entries[one]
            for one in (candidate, *(candidate.without(extra) for extra in candidate.extras))
            for one in (Candidate(one.law, rate, one.extras) for rate in one.law.rates)
            if one in self.entries
        )
        best = sorted(before, key=lambda entry: entry.bic)[:1]
        known: list[Mapping[str, float]] = [entry.joints[joint].values for entry in best]
        return with_extras(problem, candidate, known or law_starts(problem, candidate.law))


def stays_at_its_largest(torque: Array, variance: float) -> bool:
    """Whether a torque with noise of a variance stays within it at its largest or at its least for ``PLATEAU`` samples
    in a row, more often than the top of a smooth motion would."""
    for signal in (torque, -torque):
        top = np.quantile(signal, 0.999)
        near = np.abs(signal - top) <= 3 * np.sqrt(variance)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
        runs = edges[1::2] - edges[::2]
        if runs.size and runs.max() >= PLATEAU:
            return True
    return False
