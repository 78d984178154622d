"""The report of an unfinished search."""

from __future__ import annotations

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.errors import listed
from fmu_didim.base.imports import without_folder
from fmu_didim.checks.judgement import diagnostic_result, judgement
from fmu_didim.discovery.selection.candidates import Outcome, TriedCandidate
from fmu_didim.discovery.selection.rounds import Discovery, Ending
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.results.findings import ANSWER_TEXT, FindingsDocument, UnfinishedResult

SHOWN_UNTRIED = 4
"""[candidates] Named in the sentence; findings.json lists all of them."""
NOT_TO_ITS_END = (
    "The time limit of {0:g} s ended the search in round {1}, none of whose candidates was accepted, before all was "
    "tried that follows then: gears with play in the whole range of its parameters, gears with an error of their "
    "teeth, and effects two by two or in the place of others."
)
"""Of a search in which all single candidates were tried."""

SEARCH_RUNNING = CATALOGUE(
    "search-running", DOUBT, rank=1,
    meaning="The findings were written while the search went on; if it no longer runs, it was stopped from outside.",
    next_step="Wait for it, or run discover once more.",
)  # fmt: skip
SEARCH_CUT = CATALOGUE(
    "search-cut", DOUBT, rank=1,
    meaning="The time limit ended the search: effects that were not tried may explain the data better.",
    next_step="Give it more time (--time-limit), or fewer effects to try (--forbid).",
)  # fmt: skip


def unfinished_search(
    discovery: Discovery, limit_s: float | None
) -> tuple[Diagnostic, UnfinishedResult] | tuple[None, None]:
    """The diagnostic of an unfinished search and its entry in the document; None, None if it is complete."""
    if discovery.ending is Ending.COMPLETE:
        return None, None
    if discovery.ending is Ending.RUNNING:
        accepted = ", ".join(_named(step.effect_at) for step in discovery.steps) or "no effect"
        text = f"The search was still running when this was written, with {accepted} accepted; others may follow."
        return _result(Diagnostic(SEARCH_RUNNING, text), len(discovery.tried), [])
    last = discovery.tried[-1]
    untried = [t.effect_at for t in last if t.outcome is Outcome.NOT_TRIED]
    number = len(discovery.tried)
    if not untried:
        text = NOT_TO_ITS_END.format(limit_s or 0.0, number)
        return _result(Diagnostic(SEARCH_CUT, text, value=limit_s, unit="s"), number - 1, untried)
    shown = listed([_named(effect_at) for effect_at in untried], SHOWN_UNTRIED)
    text = (
        f"The time limit of {limit_s or 0.0:g} s ended the search in round {number}: {len(untried)} of its "
        f"{len(last)} candidates were not tried ({shown}){_leader(last)}."
    )
    return _result(Diagnostic(SEARCH_CUT, text, value=limit_s, unit="s"), number - 1, untried)


def ended_before(document: FindingsDocument, limit_s: float | None, what: str) -> FindingsDocument:
    """The document of a search that the time limit ended before ``what`` was looked for."""
    if (known := document.unfinished) is not None:
        text = f"{known.text} {what[0].upper()}{what[1:]} were not looked for either."
        return document.model_copy(update={"unfinished": known.model_copy(update={"text": text})})
    text = f"The time limit of {limit_s or 0.0:g} s ended the search before {what} were looked for."
    cut = Diagnostic(SEARCH_CUT, text, value=limit_s, unit="s")
    _, more = _result(cut, len(document.findings), [])
    reasons = [diagnostic_result(cut), *document.reasons]
    update = {
        "answer": "unfinished", "text": ANSWER_TEXT["unfinished"], "unfinished": more,
        "verdict": judgement([], settled=False).verdict, "reasons": reasons,
        "conditions": [], "power": None,
    }  # fmt: skip
    return document.model_copy(update=update)


def _result(found: Diagnostic, rounds: int, untried: list[EffectAtJoint]) -> tuple[Diagnostic, UnfinishedResult]:
    return found, UnfinishedResult(
        code=found.code.name, text=found.text, next_step=found.advice, rounds=rounds,
        untried=[(a.effect, a.joint) for a in untried],
    )  # fmt: skip


def _leader(tried: tuple[TriedCandidate, ...]) -> str:
    """The best fitted candidate that is not among the findings."""
    fitted = [(t.delta_bic, t.effect_at) for t in tried if t.outcome is Outcome.FITTED and t.delta_bic is not None]
    if not fitted:
        return ""
    gain, best = max(fitted, key=lambda f: f[0])
    return f"; of those that were, {_named(best)} leads with a BIC difference of {gain:.0f}"


def _named(effect_at: EffectAtJoint) -> str:
    return f"{without_folder(effect_at.effect)} on joint {effect_at.joint}"
