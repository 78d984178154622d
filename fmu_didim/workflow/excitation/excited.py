"""What ``excite`` returns and writes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim.base.diagnostics import DOUBT, PROBLEM, Diagnostic
from fmu_didim.checks.judgement import diagnostic_result
from fmu_didim.data.excitation import Fourier, PointToPoint
from fmu_didim.data.signals import Array, Trajectory, write_csv
from fmu_didim.discovery.excitation.limits import Bounds
from fmu_didim.discovery.excitation.optimum import Criterion
from fmu_didim.dynamics.space.space import Box
from fmu_didim.report.numbers import percent_std, pretty_unit, significant
from fmu_didim.report.sections import Table, numbers, words
from fmu_didim.report.terminal import table_lines, wrapped
from fmu_didim.workflow.excitation.planned import Peaks, Prediction, mean_percent
from fmu_didim.workflow.excitation.space import Compared, nearest, space_document
from fmu_didim.workflow.excitation.weighed import Weighing
from fmu_didim.workflow.output.exit_codes import EXIT_CODES
from fmu_didim.workflow.output.result_folder import check_writable, write_whole

REFERENCE_FILE, TABLE_FILE, EXCITE_FILE = "reference.yaml", "reference.csv", "excite.json"

KINDS = {
    "low": "lowest position", "high": "highest position", "speed": "velocity", "acceleration": "acceleration",
    "torque": "torque",
}  # fmt: skip
"""Attribute of the largest of a motion -> its words."""
PLAY_BACK = (
    "The moves are fifth order polynomials: play reference.csv back. What a drive makes of a point-to-point command of "
    "its own is another motion, which the case would have to state."
)
COLLISIONS = "Collisions of links with each other or with the surroundings are not looked at: watch the first run."
LINKS_ALONE = "Links are not compared with each other: watch the first run."
BOXES_ALONE = "Links are compared with each other, not with the surroundings: watch the first run."
NEAREST = 5
"""[rows] Of the table of clearances that is printed."""


@dataclass(frozen=True)
class Trial:
    """The end of the optimisation from one start.

    Attributes:
        start: its number; status: of IPOPT, or why it was skipped.
        begun, criterion: along the reference, before and after: log det of the information on the parameters asked for,
            or minus the logarithm of their mean relative deviation; None where it was skipped.
    """

    start: int
    status: str
    begun: float | None = None
    criterion: float | None = None


@dataclass(frozen=True, repr=False)
class Excited:
    """A designed motion, and what a log of it will tell.

    Attributes:
        name: of the case; excitation: the motion, as a case takes it; reference: the same, a row a control period.
        prediction, now: what its log would tell, and one of the reference that the case has; None if that cannot run.
        bounds, origin: the limits, and where each kind of them comes from.
        trials: of all starts; diagnostics: the most important first.
        asked: parameters that were to be known best; in_mean: those of them that the mean of the relative deviations is
            taken of: not those so small that a log would not show them, were all others known.
        criterion: ``determinant`` or ``mean``.
        unseen: parameters that the design did not look at.
        rate_hz, deviation: of the log that is planned; seed: of the starts; provenance: versions and files.
        around: which links and boxes are compared.
        weighing: the weights that were tried, where the motion is of a run without and one with a weight.
    """

    name: str
    excitation: Fourier | PointToPoint
    prediction: Prediction
    now: Prediction | None
    bounds: Bounds
    origin: Mapping[str, str]
    trials: tuple[Trial, ...]
    diagnostics: tuple[Diagnostic, ...]
    asked: tuple[str, ...]
    in_mean: tuple[str, ...]
    criterion: Criterion
    unseen: tuple[str, ...]
    rate_hz: float
    deviation: Array
    seed: int
    provenance: Mapping[str, Any]
    around: Compared
    weighing: Weighing | None = None

    @property
    def reference(self) -> Trajectory:
        """The motion, a row a control period."""
        return self.prediction.reference

    @property
    def ok(self) -> bool:
        """Whether nothing stands against running it."""
        return not any(d.code.severity is PROBLEM for d in self.diagnostics)

    @property
    def exit_code(self) -> int:
        """0; 4 with doubts, 1 with problems."""
        doubtful = any(d.code.severity is DOUBT for d in self.diagnostics)
        return EXIT_CODES["refused" if not self.ok else "doubtful" if doubtful else "valid"]

    @property
    def mean_percent(self) -> float:
        """Mean of the predicted relative standard deviations of ``in_mean``, percent; NaN if unknown."""
        return mean_percent(self.prediction.prospect, self.in_mean)

    def __repr__(self) -> str:
        return f"Excited({self.name!r}, {self.mean_percent:.3g} % on average, {len(self.trials)} starts)"

    def save(self, folder: Path | str) -> list[Path]:
        """Write ``excite.json`` and, where nothing stands against running it, ``reference.yaml``, the key ``reference``
        of a case and, where a weight was chosen, the key ``load`` of the run with it, and ``reference.csv``, the motion
        as a table; returns what was written. A reference of an earlier run is removed where there is none now.

        Raises:
            InputError: a file cannot be written.
        """
        folder = Path(folder)
        check_writable(folder)
        found = json.dumps(self.saved(), indent=1, allow_nan=False) + "\n"
        written = [folder / EXCITE_FILE]
        entries = {"reference": self.excitation.model_dump(mode="json")}
        if self.weighing is not None:
            entries["load"] = dict(self.weighing.chosen.offer.load)
        text = yaml.safe_dump(entries, sort_keys=False)
        for name in (REFERENCE_FILE, TABLE_FILE):
            (folder / name).unlink(missing_ok=True)
        if self.ok:
            write_whole(folder / TABLE_FILE, partial(write_csv, self.reference))
            write_whole(folder / REFERENCE_FILE, lambda path: path.write_text(text, encoding="utf-8"))
            written = [folder / REFERENCE_FILE, folder / TABLE_FILE, *written]
        write_whole(folder / EXCITE_FILE, lambda path: path.write_text(found, encoding="utf-8"))
        return written

    def saved(self) -> dict[str, Any]:
        """The content of ``excite.json``."""
        limits, n = self.bounds.limits, self.deviation.size
        return {
            "case": self.name,
            "ready": self.ok,
            "reference": self.excitation.model_dump(mode="json"),
            "torque_rate_hz": self.rate_hz,
            "torque_std": _listed(self.deviation),
            "criterion": self.criterion,
            "asked": list(self.asked),
            "in_mean": list(self.in_mean),
            "not_looked_at": list(self.unseen),
            "parameters": _parameters(self.prediction),
            "parameters_now": _parameters(self.now),
            "mean_percent": _number(self.mean_percent),
            "duration_now_s": None if self.now is None else self.now.length_s,
            "mean_percent_now": _number(mean_percent(None if self.now is None else self.now.prospect, self.in_mean)),
            "condition_number": _number(self.prediction.condition),
            "limits": {
                "position": [_listed(pair) for pair in np.column_stack([limits.low, limits.high])],
                "velocity": _listed(limits.speed),
                "acceleration": _listed(limits.acceleration),
                "torque": _listed(self.bounds.torque),
                "start": None if self.bounds.start is None else _listed(self.bounds.start),
                "from": dict(self.origin),
            },
            "peaks": {
                "reference": _peaks(Peaks.of(self.reference, n)),
                "loop": _peaks(Peaks.of(self.prediction.loop, n)),
            },
            "weighing": None if self.weighing is None else self.weighing.document(),
            "space": space_document(self.around, self.prediction.loop, self.prediction.part_s),
            "starts": [
                {"start": t.start, "status": t.status, "begun": t.begun, "criterion": t.criterion} for t in self.trials
            ],
            "diagnostics": [
                {"severity": d.code.severity.value, **diagnostic_result(d, "").model_dump(mode="json")}
                for d in self.diagnostics
            ],
            "seed": self.seed,
            "provenance": dict(self.provenance),
        }

    def summary(self) -> str:
        """The tables and what must be known, at most 100 columns wide."""
        lines = [
            *wrapped(self.name),
            "",
            *([] if self.weighing is None else self.weighing.lines()),
            *wrapped(
                f"Motion: {_words(self.excitation)}, {self.excitation.length_s:.4g} s, torque logged at "
                f"{self.rate_hz:.6g} Hz"
            ),
            *wrapped(f"Best of {sum(t.criterion is not None for t in self.trials)} of {len(self.trials)} starts"),
            "",
        ]
        if self.prediction.prospect is not None:
            lines += ["Predicted for the simulated loop with these values and white noise:"]
            lines += self._parameter_lines()
            if self.now is not None and not np.isclose(self.now.length_s, self.prediction.length_s):
                lines += wrapped(f"The reference of the case lasts {self.now.length_s:.4g} s.")
            lines.append("")
        lines += ["Largest of the motion (limits of acceleration are those of the reference):", *self._peak_lines(), ""]
        if isinstance(self.excitation, PointToPoint):
            lines += [*_postures(self.excitation), *wrapped(PLAY_BACK), ""]
        lines += self._space_lines()
        lines += wrapped("Limits: " + ", ".join(f"{name}: {place}" for name, place in self.origin.items()))
        lines += wrapped(f"Condition number {significant(self.prediction.condition)}")
        if self.unseen:
            lines += wrapped(
                f"Not looked at by the design, but predicted: {', '.join(self.unseen)}", hanging="  "
            )  # fmt: skip
        left = [name for name in self.asked if name not in self.in_mean]
        mean = f"Mean %σ {significant(self.mean_percent, 3)}"
        if left:
            mean += (
                f", without {', '.join(left)}: zero, or so small that a hundred such logs would not show them, "
                "were all others known"
            )
        if self.prediction.prospect is not None and self.weighing is None:
            lines += wrapped(mean, hanging="  ")
        lines.append("")
        for d in self.diagnostics:
            lines += wrapped(f"{d.code.severity.value.upper()} {d.code.name}: {d}", "", "  ")
            lines += wrapped(d.advice, "  Next: ", "    ") if d.advice else []
        with_boxes = any(isinstance(check.other, Box) for check in self.around.space.checks)
        with_links = self.around.are_links_compared
        if not (with_boxes and with_links):
            lines += wrapped(BOXES_ALONE if with_links else LINKS_ALONE if with_boxes else COLLISIONS)
        return "\n".join(lines) + "\n"

    def _space_lines(self) -> list[str]:
        """The nearest of links and boxes along the simulated motion."""
        found = nearest(self.around.space, self.prediction.loop, self.prediction.part_s)
        around = self.around
        if not found:
            return []
        shown = found[:NEAREST]
        columns = [
            words("nearest", [one.name for one in shown]),
            numbers("clearance", [significant(1000 * one.clearance, 3) for one in shown]),
            words("unit", ["mm"] * len(shown)),
            numbers("at t", [f"{one.time:.3f}" for one in shown]),
            words("", ["s"] * len(shown)),
        ]
        pairs = "1 pair" if len(found) == 1 else f"{len(found)} pairs"
        text = f"Links are {around.shape}; {pairs} of links and boxes compared"
        left = f", left out as always near: {'; '.join(around.left_out)}" if around.left_out else ""
        return [*table_lines(Table(columns), width=None), *wrapped(text + left, hanging="  "), ""]

    def _parameter_lines(self) -> list[str]:
        found = self.prediction.prospect
        assert found is not None
        percent = [100 * d / abs(v) if v else None for v, d in zip(found.values, found.deviation, strict=True)]
        columns = [
            words("parameter", found.names, marks=["" if name in self.asked else " *" for name in found.names]),
            numbers("value", [significant(value) for value in found.values]),
            numbers("σ", [significant(deviation, 2) for deviation in found.deviation]),
            numbers("%σ", [percent_std(value) for value in percent]),
            words("unit", [pretty_unit(unit) for unit in found.units]),
        ]
        own = None if self.now is None else self.now.prospect
        if own is not None:
            known = dict(zip(own.names, own.deviation, strict=True))
            before = [100 * known[n] / abs(v) if v else None for n, v in zip(found.names, found.values, strict=True)]
            columns.insert(4, numbers("%σ of the case's", [percent_std(value) for value in before]))
        last = ["* not asked for"] if set(found.names) != set(self.asked) else []
        return [*table_lines(Table(columns), width=None), *last]

    def _peak_lines(self) -> list[str]:
        n, limits = self.deviation.size, self.bounds.limits
        given, loop = Peaks.of(self.reference, n), Peaks.of(self.prediction.loop, n)
        bounds = Peaks(limits.low, limits.high, limits.speed, limits.acceleration, self.bounds.torque)
        made = [
            (f"{j + 1}", head, *(getattr(of, name)[j] for of in (given, loop, bounds)))
            for j in range(n)
            for name, head in KINDS.items()
        ]
        columns = [
            words("joint", [row[0] for row in made]),
            words("", [row[1] for row in made]),
            numbers("reference", [significant(row[2]) for row in made]),
            numbers("simulated", [significant(row[3]) for row in made]),
            numbers("limit", [significant(row[4]) if np.isfinite(row[4]) else "none" for row in made]),
        ]
        return table_lines(Table(columns), width=None)


def _words(motion: Fourier | PointToPoint) -> str:
    """Which motion it is."""
    if isinstance(motion, Fourier):
        return f"Fourier series of {len(motion.joints[0].cosine)} harmonics, fundamental {motion.fundamental_hz:.4g} Hz"
    rest = f" and {motion.dwell_s:.4g} s of rest" if motion.dwell_s else ""
    return f"{len(motion.points) - 1} moves from point to point of {motion.move_s:.4g} s{rest} each"


def _postures(motion: PointToPoint) -> list[str]:
    """A table of the points of a round, in the order in which they are visited."""
    points = list(dict.fromkeys(motion.points))
    columns = [words("posture", [f"{i}" for i in range(1, len(points) + 1)])]
    for j, values in enumerate(zip(*points, strict=True), start=1):
        columns.append(numbers(f"q{j}", [significant(value) for value in values]))
    return table_lines(Table(columns), width=None)


def _parameters(found: Prediction | None) -> dict[str, Any] | None:
    if found is None or found.prospect is None:
        return None
    own = found.prospect
    return {
        name: {"value": float(value), "deviation": float(deviation), "unit": unit}
        for name, value, deviation, unit in zip(own.names, own.values, own.deviation, own.units, strict=True)
    }


def _peaks(found: Peaks) -> dict[str, list[float | None]]:
    names = ("low", "high", "speed", "acceleration", "torque")
    return {name: _listed(getattr(found, name)) for name in names}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _listed(values: Array) -> list[float | None]:
    return [_number(float(value)) for value in values]
