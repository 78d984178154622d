"""Histories of results that are drawn, not identified: how often ``watch`` calls a log changed that is not.

One alarm in a thousand logs shows in tens of thousands of them, more than can be identified. So one log of each machine
is identified, and the results of all further ones are drawn about what is true of them, as identification with noise
that is as it says would give them:

    v ~ N(v_true, C),       log s ~ N(log s_0, 1 / 2 f)

with the covariance C and the residuals s_0 (of f independent samples) of the one identified. The machine varies from
day to day beside that. Where C or s_0 were wrong, these histories would not show it; those of simulated logs would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from fmu_didim import identify
from fmu_didim.discovery.change.answers import Answer
from fmu_didim.discovery.change.difference import CHANGED
from fmu_didim.discovery.change.watched import Entry, watched
from fmu_didim.fit.statistics import CONFIDENCE
from tests.figures import table
from tests.tools.changes.draw import DAY_TO_DAY, PLAN, Pair, draw, write
from tests.tools.changes.run import case_of

Array = np.ndarray
MOVING = ("payload", "temperature", "friction")
"""Causes that are a change of values alone, which needs no log."""
REFERENCE, STILL, LATER = 10, 30, 5
"""[logs] Of a history: of the reference, of the same machine after it, and of the changed one."""
PARTS = (0.03, 1.0)
"""[1] Least and most of the change of a pair that happens in a history, as likely in each decade: some show in one log,
some do not show at all."""


@dataclass(frozen=True)
class Machine:
    """A machine before and after a change.

    Attributes:
        answer: what was identified from one log of it; before, after: name -> true value.
    """

    answer: Answer
    before: dict[str, float]
    after: dict[str, float]

    @staticmethod
    def of(pair: Pair, folder: Path) -> Machine:
        """That of a pair, whose first log is identified; without what the model lacks, of which each log would be
        doubted."""
        first, second = (replace(plant, clutter=False) for plant in (pair.before, pair.after))
        write(replace(pair, before=first, after=second), folder)
        found = identify(case_of(folder, "before"), folder / "result")
        answer = Answer("before", "", found.document, (), found.robot)
        return Machine(answer, dict(pair.before.design.true), dict(pair.after.design.true))

    def drawn(self, rng: np.random.Generator, true: dict[str, float]) -> Answer:
        """The result of one more log."""
        document, names = self.answer.document, list(self.answer.document.parameters)
        covariance = np.array(document.covariance, dtype=float)
        today = {name: v * (1 + DAY_TO_DAY * rng.normal() * name.startswith("Fc")) for name, v in true.items()}
        values = rng.multivariate_normal([today[name] for name in names], covariance)
        free = self.answer.independent()
        noise = np.array(document.noise_std, dtype=float) * np.exp(rng.normal(size=free.size) / np.sqrt(2 * free))
        parameters = {
            name: document.parameters[name].model_copy(update={"value": float(value)})
            for name, value in zip(names, values, strict=True)
        }  # fmt: skip
        own = document.model_copy(update={"parameters": parameters, "noise_std": noise.tolist()})
        return Answer("", "", own, (), self.answer.robot)


@dataclass
class Counts:
    """Of histories of one machine, or more.

    Attributes:
        still, false, doubted: logs of the machine as in the reference, those called changed, those whose
            residual is doubted.
        later, seen: logs of the changed machine, those called changed.
        told, near: histories of which an onset of a change that has happened is told, and is right within one log.
        held: those in which the true first log lies in the interval of 95 % that is told.
    """

    still: int = 0
    false: int = 0
    doubted: int = 0
    later: int = 0
    seen: int = 0
    told: int = 0
    near: int = 0
    held: int = 0


def count(machine: Machine, rng: np.random.Generator, histories: int, into: Counts) -> None:
    """Judge histories of a machine."""
    first, place = datetime(2024, 1, 1), REFERENCE + STILL
    for _ in range(histories):
        part = np.exp(rng.uniform(*np.log(PARTS)))
        after = {name: v + part * (machine.after[name] - v) for name, v in machine.before.items()}
        answers = [machine.drawn(rng, after if k >= place else machine.before) for k in range(place + LATER)]
        found = watched("axes", [
            Entry(str(k), first + timedelta(days=k), str(k), k < REFERENCE, True, one) for k, one in enumerate(answers)
        ], order="date")  # fmt: skip
        states = [log.state for log in found.logs]
        into.still += STILL
        into.false += states[REFERENCE:place].count("changed")
        into.doubted += sum("the residual of" in log.text for log in found.logs[REFERENCE:place])
        into.later += LATER
        into.seen += states[place:].count("changed")
        if found.onset is not None and "changed" in states[place:]:
            into.told += 1
            into.near += abs(int(found.onset.log) - place) <= 1
            into.held += int(found.onset.earliest) <= place <= int(found.onset.latest)


def figures(found: Counts, machines: int, histories: int, seed: int) -> dict[str, str | list[str]]:
    """For the page: a table of criteria, and counts."""
    rows = [
        ("unchanged logs that were called changed", found.false, found.still, f"{100 * CHANGED:g} %"),
        ("unchanged logs whose residual was doubted", found.doubted, found.still, f"{100 * CHANGED:g} %"),
        ("logs of a changed machine that were called changed", found.seen, found.later, ""),
        ("onset right within one log, of those told", found.near, found.told, ""),
        ("first log in the interval told", found.held, found.told, f"{100 * CONFIDENCE:g} %"),
    ]
    lines = []
    for title, good, count, stated in rows:
        low, high = binomtest(good, count).proportion_ci() if count else (0.0, 1.0)
        share = f"{100 * good / max(count, 1):.2g} %" if good < 0.1 * count else f"{100 * good / max(count, 1):.1f} %"
        lines.append((title, share, f"{good} of {count}", f"{100 * low:.2g} to {100 * high:.3g} %", stated))
    return {
        "criteria": table(("criterion", "reached", "count", "95 % interval", "stated"), lines),
        "machines": str(machines), "histories": str(machines * histories), "seed": str(seed),
    }  # fmt: skip


def numbers(machines: int) -> Sequence[int]:
    """Those of the pairs that are drawn: each cause in turn, at each rate."""
    rounds = range(-(-machines // len(MOVING)))
    return [len(PLAN) * k + PLAN.index(cause) for k in rounds for cause in MOVING][:machines]


def counted(seed: int, machines: int, histories: int, folder: Path) -> Counts:
    """Of so many histories of each of so many machines."""
    found, rng = Counts(), np.random.default_rng([seed, 3])
    for number in numbers(machines):
        count(Machine.of(draw(number, seed), folder / f"r{number:03d}"), rng, histories, found)
        print(number, found, flush=True)
    return found
