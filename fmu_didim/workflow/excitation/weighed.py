"""Which weight, hung where, splits drives, friction and load: the weights that were tried, ranked, and what is said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.checks.data.expected_accuracy import ExpectedAccuracy
from fmu_didim.checks.load import GAIN_KNOWN, GAIN_UNKNOWN
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.load import PREFIX
from fmu_didim.report.numbers import percent_std
from fmu_didim.report.sections import Table, numbers, words
from fmu_didim.report.terminal import table_lines, wrapped

OF_MASS = 0.5
"""[1] Part of the variance of the best known gain that comes from the mass of the weight, from which weighing it more
exactly helps more than a heavier one."""
AXES = "XYZ"

TOO_HEAVY = CATALOGUE(
    "weight-beyond-limits", REMARK, rank=74,
    meaning="A weight that was offered cannot be moved within the limits: its torque at rest, or along each motion "
    "that was found, is beyond them, or something else stands against its motion.",
    next_step="Leave it out, hang it nearer to the axes, or give other positions.",
)  # fmt: skip
GAIN_ASSUMED = CATALOGUE(
    "weight-gain-assumed", DOUBT, rank=46,
    meaning="A gain of a drive is taken for one, as if the log were in N.m at the joint. Of a log in amperes or per "
    "cent the noise is then of another size than torque_std says, and all predicted deviations with it.",
    next_step="Give identify: {...: {start: ...}}, the torque of the joint for a unit of the log, by the data sheet: "
    "a tenth is near enough.",
)  # fmt: skip
TAKEN_EXACT = CATALOGUE(
    "weight-taken-exact", REMARK, rank=74,
    meaning="The case states no mass_std: of the load, so that the predicted deviations have nothing of the "
    "uncertainty of its mass, to which every gain is proportional, nor of a centre: that it states.",
    next_step="Give load: {mass_std: ...} with the accuracy of the scale, kg, and leave out centre: if it is not sure.",
)  # fmt: skip
MASS_IS_MOST = CATALOGUE(
    "weight-mass-uncertain", REMARK, rank=74,
    meaning="Most of the predicted variance of a gain is that of the mass of the weight: no motion makes it smaller.",
    next_step="Weigh the weight more exactly, or take a heavier one.",
)  # fmt: skip
NOT_AMONG_LINKS = CATALOGUE(
    "weight-without-shape", REMARK, rank=73,
    meaning="Links and boxes are compared, but not the weight that hangs on the last link: it may collide.",
    next_step="Give capsules: among the limits, one on the last link that encloses the weight.",
)  # fmt: skip


@dataclass(frozen=True)
class Offer:
    """A weight that may be hung.

    Attributes:
        mass: kg; place: (3,) of its centre, m, in the frame of the last link.
        load: the entry ``load`` of a run with it, in the form in which the case has it.
        taken_from: where the place is from, in words; "" where it was given.
    """

    mass: float
    place: tuple[float, float, float]
    load: Mapping[str, Any]
    taken_from: str = ""

    @property
    def at(self) -> str:
        """The place, in words."""
        return f"({', '.join(f'{x:g}' for x in self.place)})"

    def size_of(self, stem: str) -> float:
        """Natural size of a parameter of a load: mass times distance to the power of its order."""
        order = 0 if stem == "M" else 1 if len(stem) == 2 and stem[0] == "M" else 2
        return self.mass * float(np.linalg.norm(self.place)) ** order


@dataclass(frozen=True)
class Tried:
    """What an offer would tell.

    Attributes:
        offer: the weight and its place.
        prospect: predicted deviations of both runs on the best motion; None where they do not determine all, or cannot
            be made.
        peaks: (n,) largest torque, N.m or N; limits: (n,) of it, infinite without one; empty where there is no motion.
        problem: why it cannot be run, in words; "" where nothing stands against it.
        is_final: whether its motion was designed from all starts, and not only roughly.
    """

    offer: Offer
    prospect: ExpectedAccuracy | None
    peaks: Array
    limits: Array
    problem: str = ""
    is_final: bool = True

    def percent(self, names: Sequence[str]) -> dict[str, float]:
        """Name -> predicted standard deviation, percent, of those whose value is not zero; those of loads relative to
        the natural size of the parameter."""
        if self.prospect is None:
            return {}
        found = {}
        for name, value, deviation in zip(
            self.prospect.names, self.prospect.values, self.prospect.deviation, strict=True
        ):
            size = self.offer.size_of(_stem(name)) if name.startswith(PREFIX) else abs(float(value))
            if name in names and size > 0:
                found[name] = 100 * float(deviation) / size
        return found

    def mean(self, names: Sequence[str]) -> float:
        """Mean of these; NaN without any."""
        found = self.percent(names)
        return float(np.mean(list(found.values()))) if found else float("nan")


def _stem(name: str) -> str:
    """``load_MXR[loaded]`` -> ``MX``."""
    return name.removeprefix(PREFIX).partition("[")[0].removesuffix("R")


@dataclass(frozen=True)
class Weighing:
    """All weights that were tried.

    Attributes:
        empty, loaded: labels of the runs without (None: an earlier result stands for it) and with the weight.
        tried: in the order in which they were offered; best: place of the one that is taken.
        gains, friction, load: names of the parameters that are to be split.
        ranked: names of those whose mean relative deviation ranks the weights; said: the same in words.
        mass_std: standard deviation of the mass, kg; None where it is taken for exact.
    """

    empty: str | None
    loaded: str
    tried: tuple[Tried, ...]
    best: int
    gains: tuple[str, ...]
    friction: tuple[str, ...]
    load: tuple[str, ...]
    ranked: tuple[str, ...]
    said: str
    mass_std: float | None

    @property
    def chosen(self) -> Tried:
        """The one that is taken."""
        return self.tried[self.best]

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Head of a column -> names of the parameters whose mean %σ it shows, the one that ranks first."""
        parts = {"gains": self.gains, "friction": self.friction, "load": self.load}
        return {"mean %σ": self.ranked} | {head: names for head, names in parts.items() if names}

    def worst_gain(self, one: Tried) -> tuple[str, float] | None:
        """The gain that is known worst, and its relative deviation, percent."""
        found = one.percent(self.gains)
        return max(found.items(), key=lambda item: item[1]) if found else None

    def largest_torque(self, one: Tried) -> tuple[int, float] | None:
        """Joint, from 1, of the largest torque over its limit, and that ratio; None without limits."""
        ratio = one.peaks / one.limits
        if not (ratio > 0).any():
            return None
        joint = int(np.nanargmax(ratio))
        return joint + 1, float(ratio[joint])

    def diagnostics(self, *, with_shapes: bool, assumed: Sequence[str] = ()) -> list[Diagnostic]:
        """What is to be said of the weight that is taken, and of the others.

        Args:
            with_shapes: whether links and boxes are compared; assumed: gains that are taken for one.
        """
        told, best = [], self.chosen
        for name, percent in best.percent(self.gains).items():
            if percent > 100 * GAIN_KNOWN:
                text = (
                    f"{name} would be known to {percent:.2g} %: {best.offer.mass:g} kg at {best.offer.at} m puts "
                    "hardly any torque on this joint."
                )
                told.append(Diagnostic(GAIN_UNKNOWN, text, name, percent / 100, GAIN_KNOWN, "1"))
        for one in self.tried:
            if one.problem and one is not best:
                text = f"{one.offer.mass:g} kg at {one.offer.at} m: {one.problem}"
                told.append(Diagnostic(TOO_HEAVY, text))
        if assumed:
            text = f"Taken for one: {', '.join(assumed)}. torque_std is then in N.m or N."
            told.append(Diagnostic(GAIN_ASSUMED, text))
        if self.gains and self.mass_std is None:
            what = "mass and the centre of the weight are" if "centre" in best.offer.load else "mass of the weight is"
            told.append(Diagnostic(TAKEN_EXACT, f"The {what} taken for exact."))
        elif self.gains and self.mass_std is not None and (found := best.percent(self.gains)):
            least, own = min(found.values()), 100 * self.mass_std / best.offer.mass
            if own**2 > OF_MASS * least**2:
                text = f"The mass is known to {own:.2g} %, and the best known gain would be known to {least:.2g} %."
                told.append(Diagnostic(MASS_IS_MOST, text, value=own, bound=float(np.sqrt(OF_MASS) * least), unit="%"))
        if with_shapes:
            told.append(Diagnostic(NOT_AMONG_LINKS, "The weight itself is compared with nothing."))
        return told

    def lines(self) -> list[str]:
        """What to hang, and the table of all that was tried."""
        best = self.chosen.offer
        head = f"Hang {best.mass:g} kg at {best.at} m in the frame of the last link, and move so."
        runs = f"Without it: {self.empty or 'the earlier result'}; with it: {self.loaded}."
        runs += f" No place was given: it is {best.taken_from}." if best.taken_from else ""
        rows = [self.tried[i] for i in self.order]
        worst, torque = [self.worst_gain(one) for one in rows], [self.largest_torque(one) for one in rows]
        columns = [
            words("hang", [f"{one.offer.mass:g} kg" for one in rows]),
            words("at, m", [one.offer.at for one in rows]),
            *(numbers(name, [_shown(one.mean(of)) for one in rows]) for name, of in self.groups.items()),
        ]
        if self.gains:
            columns.append(words("worst gain", ["–" if w is None else f"{w[0]} {_shown(w[1])} %" for w in worst]))
        if any(t is not None for t in torque):
            texts = ["–" if t is None else f"{100 * t[1]:.0f} % (joint {t[0]})" for t in torque]
            columns.append(words("torque of limit", texts))
        columns.append(words("can run", ["no" if one.problem else "yes" for one in rows]))
        count = sum(one.is_final for one in self.tried)
        rough = "" if count == len(self.tried) else f" (of the first {count} designed from all starts, else roughly)"
        last = (
            f"Each on its own best motion{rough}; the first is taken, by the mean %σ of {self.said}. %σ of a load is "
            "relative to its mass, times the distance from the origin of the frame or the square of it. All hold for "
            "white noise and these values, and are the least that there can be."
        )
        bears = "Whether the flange and the gears bear the weight is not looked at."
        return [
            *wrapped(head),
            *wrapped(runs),
            "",
            *table_lines(Table(columns), width=None),
            *wrapped(f"{last} {bears}"),
            "",
        ]

    @property
    def order(self) -> list[int]:
        """Places of all that were tried, the one that is taken first, then those whose motions were designed from all
        starts, the best first."""
        return sorted(range(len(self.tried)), key=lambda i: (i != self.best, not self.tried[i].is_final, self.key(i)))

    def key(self, place: int) -> tuple[bool, bool, float, int]:
        """By which the offers are ranked: those that can be run first, then those that are known, then by how well."""
        one = self.tried[place]
        mean = one.mean(self.ranked)
        return bool(one.problem), not np.isfinite(mean), mean if np.isfinite(mean) else 0.0, place

    def document(self) -> dict[str, Any]:
        """What ``excite.json`` says of it."""
        return {
            "hang": {"mass_kg": self.chosen.offer.mass, "at_m": list(self.chosen.offer.place)},
            "load": dict(self.chosen.offer.load),
            "runs": {"empty": self.empty, "loaded": self.loaded},
            "ranked_by": list(self.ranked),
            "mass_std_kg": self.mass_std,
            "tried": [self._row(one) for one in self.tried],
        }

    def _row(self, one: Tried) -> dict[str, Any]:
        worst, torque = self.worst_gain(one), self.largest_torque(one)
        means = {f"{head.split()[0]}_percent": _number(one.mean(names)) for head, names in self.groups.items()}
        return {
            "mass_kg": one.offer.mass,
            "at_m": list(one.offer.place),
            "load": dict(one.offer.load),
            **means,
            "worst_gain": None if worst is None else {"name": worst[0], "percent": worst[1]},
            "percent": one.percent((*self.gains, *self.friction, *self.load)),
            "largest_torque": [_number(float(value)) for value in one.peaks],
            "torque_of_limit": None if torque is None else {"joint": torque[0], "ratio": torque[1]},
            "can_be_run": not one.problem,
            "problem": one.problem,
            "designed": "from all starts" if one.is_final else "roughly",
        }


def _shown(percent: float) -> str:
    return percent_std(percent) if np.isfinite(percent) else "–"


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
