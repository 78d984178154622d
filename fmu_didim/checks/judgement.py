"""The judgement of an answer, the same for all verbs: whether it may be used, and the reasons if not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from pydantic import Field

from fmu_didim.base.diagnostics import DOUBT, PROBLEM, REMARK, Diagnostic, by_weight
from fmu_didim.base.documents import Number, Saved

Verdict = Literal["valid", "doubtful", "not_settled", "refused"]
IN_FULL = 3
"""[diagnostics] Of those that are one reason, whose texts are given; of further ones the places."""
MATTERS = 0.3
"""[standard deviations] Of a value, by which a thing that is named may move it before that is a doubt: a 95 % interval
that is off by less still holds the truth 94 times of 100. What moves no value by more is a remark."""

CONDITIONAL = 4.0
"""[standard deviations] Of a value, by which something that the data would not show may move it before the verdict says
what it rests on: noise brings no value so far. It is no doubt: all data hide something, those of right models, too."""

RESTS_ON = "what a valid verdict rests on that the data do not show: clauses after 'provided that'"
"""Description of the conditions in a saved document."""


class DiagnosticResult(Saved):
    """A diagnostic as it is saved.

    Attributes:
        unit: FMI unit string of value and bound.
    """

    code: str = Field(description="stable name of its kind")
    place: str = Field(description="experiment, joint, parameter or file; empty where it is about all of them")
    text: str = Field(description="a sentence with the figures")
    value: Number = Field(description="the figure found, in the unit; null without one")
    bound: Number = Field(description="the figure it is compared with")
    unit: str
    next_step: str = Field(description="what to do about it")


class AcknowledgedResult(DiagnosticResult):
    """A doubt that the user has checked, as it is saved.

    Attributes:
        sentence: what the user says of it.
    """

    sentence: str


@dataclass(frozen=True)
class Judgement:
    """Whether an answer may be used.

    Attributes:
        verdict: ``valid``; ``doubtful``, usable with the reasons in mind; ``not_settled``; ``refused``.
        reasons: why it is not valid, the most important first; remarks: further diagnostics.
        acknowledged: doubts that the user has checked, each with the sentence about it: they are no reasons any more.
        unused: codes that the user has checked, of which none was found.
    """

    verdict: Verdict
    reasons: tuple[Diagnostic, ...] = ()
    remarks: tuple[Diagnostic, ...] = ()
    acknowledged: tuple[tuple[Diagnostic, str], ...] = ()
    unused: tuple[str, ...] = ()

    def acknowledging(self, sentences: Mapping[str, str]) -> Judgement:
        """The judgement where the user has checked all doubts of some codes; problems stay, and so does what has not
        settled.

        Args:
            sentences: code -> what the user says of it.
        """
        known = [d for d in self.reasons if d.code.severity is DOUBT and d.code.name in sentences]
        left = tuple(d for d in self.reasons if d not in known)
        found = {d.code.name for d in known}
        return replace(
            self, verdict="valid" if self.verdict == "doubtful" and not left else self.verdict, reasons=left,
            acknowledged=tuple((d, sentences[d.code.name]) for d in known),
            unused=tuple(name for name in sentences if name not in found),
        )  # fmt: skip

    @property
    def conditions(self) -> list[str]:
        """What a valid verdict rests on that the data do not show: clauses after "provided that", as ordered."""
        return [d.condition for d in self.remarks if d.condition] if self.verdict == "valid" else []

    def saved_acknowledged(self, case: str = "") -> list[AcknowledgedResult]:
        """The acknowledged doubts as they are saved; ``case``: as of :meth:`saved`."""
        return [
            AcknowledgedResult(**diagnostic_result(found, case).model_dump(), sentence=sentence)
            for found, sentence in self.acknowledged
        ]

    @property
    def acknowledged_remarks(self) -> list[str]:
        """What reports say of acknowledged doubts."""
        return [
            *(f"Acknowledged in the case: {d} [{d.code.name}] {sentence}" for d, sentence in self.acknowledged),
            *(f"Nothing was found of what the case acknowledges as {name}: take it out." for name in self.unused),
        ]

    def saved(self, case: str = "") -> list[DiagnosticResult]:
        """The reasons as they are saved; ``case``: its file, for the commands that they name."""
        return [diagnostic_result(reason, case) for reason in self.reasons]


def judgement(found: Iterable[Diagnostic], *, settled: bool = True) -> Judgement:
    """The judgement of an answer by its diagnostics; ``settled``: whether the iterations came to an end."""
    ordered = by_weight(found)
    reasons = tuple(_at_once([d for d in ordered if d.code.severity is not REMARK]))
    verdict: Verdict = "valid"
    if any(d.code.severity is PROBLEM for d in reasons):
        verdict = "refused"
    elif not settled:
        verdict = "not_settled"
    elif reasons:
        verdict = "doubtful"
    return Judgement(verdict, reasons, tuple(d for d in ordered if d.code.severity is REMARK))


def _at_once(ordered: Sequence[Diagnostic]) -> Iterator[Diagnostic]:
    """The same, with one diagnostic for all of each code that one look settles, such as units."""
    done = set[str]()
    for first in ordered:
        alike = [d for d in ordered if d.code is first.code] if first.code.at_once else [first]
        if first.code.name in done:
            continue
        if first.code.at_once:
            done.add(first.code.name)
        texts = [d.text if d.place == first.place else str(d) for d in alike[:IN_FULL]]
        more = list(dict.fromkeys(d.place for d in alike[IN_FULL:]))
        if more:
            texts.append(f"And {len(alike) - IN_FULL} more: {', '.join(more)}.")
        yield replace(first, text=" ".join(texts))


CASE = "CASE.yaml"
"""Stands for the file of the case in the commands that diagnostics name."""


def diagnostic_result(found: Diagnostic, case: str = "") -> DiagnosticResult:
    """A diagnostic as it is saved; ``case``: file of the case, for the commands that it names."""
    return DiagnosticResult(
        code=found.code.name, place=found.place, text=found.text, value=found.value, bound=found.bound,
        unit=found.unit, next_step=found.advice.replace(CASE, case or CASE),
    )  # fmt: skip
