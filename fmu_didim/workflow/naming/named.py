"""What ``name_controller`` returns and writes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.checks.judgement import Judgement, diagnostic_result
from fmu_didim.report.numbers import significant
from fmu_didim.report.sections import Table, numbers, words
from fmu_didim.report.terminal import table_lines, wrapped
from fmu_didim.workflow.export import export_fmu
from fmu_didim.workflow.naming.catalogue import TIMES, Candidate
from fmu_didim.workflow.output.exit_codes import EXIT_CODES
from fmu_didim.workflow.output.result_folder import check_writable, write_whole

CONTROLLER_FILE, NAMED_FILE = "controller.yaml", "law.json"
SHOWN = 6
"""[candidates] In the table of the contest."""
INTERVAL = 1.959964
"""[standard deviations] Half of a 95 % interval."""


@dataclass(frozen=True)
class Gain:
    """A value of a law at a joint, with its standard deviation; unit: s of times, none of gains.

    Attributes:
        rivals: the same value of the same law with other extras, or another way to the velocity, which the data do not
            exclude: the interval spans theirs, too.
    """

    name: str
    joint: int
    value: float
    deviation: float
    unit: str
    rivals: tuple[Gain, ...] = ()

    @property
    def interval(self) -> tuple[float, float]:
        """Of 95 %, whichever law of the set it is; times are not negative."""
        low, high = self.value - INTERVAL * self.deviation, self.value + INTERVAL * self.deviation
        own = (max(low, 0.0) if self.unit == "s" else low), high
        lows, highs = zip(own, *(rival.interval for rival in self.rivals), strict=True)
        return min(lows), max(highs)


@dataclass(frozen=True)
class Member:
    """A law that the data do not exclude, with its gains at all joints."""

    candidate: Candidate
    gains: tuple[Gain, ...]

    @property
    def values(self) -> list[dict[str, float]]:
        """Joint by joint."""
        count = max(gain.joint for gain in self.gains)
        return [{g.name: g.value for g in self.gains if g.joint == j} for j in range(1, count + 1)]

    def beside(self, others: Sequence[Member]) -> Member:
        """The same, its intervals spanning those of others of the same law."""
        alike = [gain for other in others if other.candidate.law is self.candidate.law for gain in other.gains]
        return replace(self, gains=tuple(
            replace(one, rivals=tuple(g for g in alike if (g.name, g.joint) == (one.name, one.joint)))
            for one in self.gains
        ))  # fmt: skip


@dataclass(frozen=True)
class Ranked:
    """A candidate of the contest.

    Attributes:
        law: its name in the catalogue; words: all of it; bic: above that of the winner; leaves: of the torque, RMS over
            that of its noise, at the worst joint.
    """

    law: str
    words: str
    bic: float
    leaves: float


@dataclass(frozen=True, repr=False)
class NamedController:
    """A control law that was named.

    Attributes:
        name: of the case.
        members: the law that was named, and after it those that the data cannot tell from it, each with its gains.
        ranked: the contest, the best first; leaves: (n,) RMS of the residual over that of the noise.
        controller: its description, as ``controller: {source: ...}`` reads it; delay_samples: of the loop, beside it.
        judgement: verdict and reasons; way: how the gains were found; provenance: versions and files.
    """

    name: str
    members: tuple[Member, ...]
    ranked: tuple[Ranked, ...]
    leaves: tuple[float, ...]
    controller: Mapping[str, Any]
    delay_samples: float
    judgement: Judgement
    way: str
    provenance: Mapping[str, Any]

    def __repr__(self) -> str:
        return f"NamedController({self.name!r}, {self.candidate.words}, {self.verdict})"

    @property
    def candidate(self) -> Candidate:
        """The law that was named."""
        return self.members[0].candidate

    @property
    def gains(self) -> tuple[Gain, ...]:
        """Of all joints; their intervals span those of the same law with other extras that the data do not exclude."""
        return self.members[0].beside(self.members[1:]).gains

    @property
    def tied(self) -> tuple[str, ...]:
        """Laws that the data cannot tell from each other, in words, the named one first."""
        return tuple(member.candidate.words for member in self.members)

    @property
    def tied_laws(self) -> tuple[str, ...]:
        """Their names in the catalogue, each once."""
        return tuple(dict.fromkeys(member.candidate.law.name for member in self.members))

    @property
    def verdict(self) -> str:
        """``valid``, ``doubtful`` or ``refused``."""
        return self.judgement.verdict

    @property
    def ok(self) -> bool:
        """Whether a law was named."""
        return self.verdict != "refused"

    @property
    def exit_code(self) -> int:
        """0; 4 with doubts, 1 where no law is named."""
        return EXIT_CODES[self.judgement.verdict]

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """All that was found, the most important first."""
        return (*self.judgement.reasons, *self.judgement.remarks)

    def values(self, joint: int) -> dict[str, float]:
        """Values of a joint, counted from 1."""
        return {gain.name: gain.value for gain in self.gains if gain.joint == joint}

    def save(self, folder: Path | str, *, fmu: bool = True) -> list[Path]:
        """Write ``law.json`` and, where a law was named, ``controller.yaml`` and its FMU; what an earlier run left of
        them is removed otherwise. Returns what was written.

        Raises:
            InputError: a file cannot be written; BuildError: the FMU cannot be built.
        """
        folder = Path(folder)
        check_writable(folder)
        name = f"{self.controller['name']}.fmu"
        for old in (CONTROLLER_FILE, name):
            (folder / old).unlink(missing_ok=True)
        content = json.dumps(self.saved(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        written = [folder / NAMED_FILE]
        write_whole(written[0], lambda path: path.write_text(content, encoding="utf-8"))
        if self.ok:
            text = yaml.safe_dump(dict(self.controller), sort_keys=False, allow_unicode=True)
            written.append(folder / CONTROLLER_FILE)
            write_whole(written[-1], lambda path: path.write_text(text, encoding="utf-8"))
            if fmu:
                written.append(export_fmu(folder / CONTROLLER_FILE, folder))
        return written

    def saved(self) -> dict[str, Any]:
        """The content of ``law.json``."""
        return {
            "case": self.name,
            "verdict": self.verdict,
            "law": self.candidate.law.name,
            "words": self.candidate.words,
            "velocity": self.candidate.rate,
            "extras": list(self.candidate.extras),
            "way": self.way,
            "gains": _saved(self.gains),
            "tied": list(self.tied),
            "set": [
                {"law": m.candidate.law.name, "words": m.candidate.words, "gains": _saved(m.gains)}
                for m in self.members
            ],
            "contest": [
                {"law": r.law, "words": r.words, "bic": r.bic, "leaves": r.leaves} for r in self.ranked
            ],
            "leaves": list(self.leaves),
            "controller": dict(self.controller) if self.ok else None,
            "delay_samples": self.delay_samples,
            "diagnostics": [
                {"severity": d.code.severity.value, **diagnostic_result(d, "").model_dump(mode="json")}
                for d in self.diagnostics
            ],
            "provenance": dict(self.provenance),
        }  # fmt: skip

    def summary(self) -> str:
        """The tables and what must be known, at most 100 columns wide."""
        lines = [*wrapped(self.name), ""]
        head = f"Law: {self.candidate.words}" if self.ok else f"No law is named. Nearest: {self.candidate.words}"
        lines += wrapped(head, hanging="  ")
        lines += wrapped(f"Gains: {self.way}", hanging="  ")
        if len(self.tied) > 1:
            lines += ["Or, as the data cannot tell them apart:"]
            lines += [line for text in self.tied[1:] for line in wrapped(text, "  ", "    ")]
            if any(gain.rivals for gain in self.gains):
                lines += wrapped("Intervals span those of all laws in this set that have the same gains.")
        lines += ["", *self._gain_lines(), "", *self._contest_lines(), ""]
        for d in self.diagnostics:
            lines += wrapped(f"{d.code.severity.value.upper()} {d.code.name}: {d}", "", "  ")
            lines += wrapped(d.advice, "  Next: ", "    ") if d.advice else []
        lines.append(self.verdict.upper())
        return "\n".join(lines) + "\n"

    def _gain_lines(self) -> list[str]:
        columns = [
            words("value", [f"{g.name}{g.joint}" for g in self.gains]),
            numbers("", [significant(g.value) for g in self.gains]),
            numbers("σ", [significant(g.deviation, 2) for g in self.gains]),
            numbers("95 % from", [significant(g.interval[0]) for g in self.gains]),
            numbers("to", [significant(g.interval[1]) for g in self.gains]),
            words("unit", [g.unit for g in self.gains]),
        ]
        return table_lines(Table(columns), width=None)

    def _contest_lines(self) -> list[str]:
        shown = self.ranked[:SHOWN]
        columns = [
            words("candidate", [r.words for r in shown]),
            numbers("BIC above the best", [f"{r.bic:.1f}" for r in shown]),
            numbers("leaves, noise = 1", [f"{r.leaves:.2f}" for r in shown]),
        ]
        return table_lines(Table(columns), width=None)


def gains_of(values: Sequence[Mapping[str, float]], deviations: Sequence[Mapping[str, float]]) -> tuple[Gain, ...]:
    """All gains, joint by joint."""
    return tuple(
        Gain(name, j, value, deviation[name], "s" if name in TIMES else "")
        for j, (found, deviation) in enumerate(zip(values, deviations, strict=True), start=1)
        for name, value in found.items()
    )


def _saved(gains: Sequence[Gain]) -> list[dict[str, Any]]:
    return [
        {"name": g.name, "joint": g.joint, "value": g.value, "deviation": _finite(g.deviation),
         "low": _finite(g.interval[0]), "high": _finite(g.interval[1]), "unit": g.unit}
        for g in gains
    ]  # fmt: skip


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
