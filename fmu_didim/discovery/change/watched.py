"""The history of a machine over many logs: each judged by those of a reference, and when a change began."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

import numpy as np
from scipy.linalg import block_diag

from fmu_didim.base.constants import recorded
from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.distributions import normal_isf
from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.base.version import __version__
from fmu_didim.checks.judgement import judgement
from fmu_didim.data.signals import Array
from fmu_didim.discovery.change import contest, difference, log_fit, period, watch_doubts, worlds
from fmu_didim.discovery.change import onset as onsets
from fmu_didim.discovery.change.answers import (
    CHANGE_PRIOR,
    SAME_ROWS,
    Answer,
    experiments_of,
    machine,
    refuse_other_models,
    same_rows,
)
from fmu_didim.discovery.change.difference import CHANGED, Difference
from fmu_didim.discovery.change.explain import explained, shows_effect
from fmu_didim.discovery.change.log_fit import Known, LogFit
from fmu_didim.discovery.change.onset import After, onset
from fmu_didim.discovery.change.period import LogValues, Period
from fmu_didim.discovery.change.watch_doubts import OTHER_MOTION, OTHER_RATE, of_logs, of_reference
from fmu_didim.discovery.change.words import cause_text
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import decide
from fmu_didim.fit.statistics import CONFIDENCE
from fmu_didim.results.watch import LogValue, OnsetResult, WatchDocument, WatchedLog, WatchedValue

DECIDING = (
    (difference, ("CHANGED",)),
    (period, ("FEWEST_FOR_SPREAD", "WIDE")),
    (watch_doubts, ("ORDERED", "FEWEST_ORDERED")),
    (contest, ("LACK", "PAIRED")),
    (onsets, ("FEWEST_OF_DRIFT", "MOST_ENDS")),
    (decide, ("BIC", "NEAR")),
    (worlds, worlds.DECIDE),
    (log_fit, log_fit.DECIDE),
)
"""Constants on which a history depends, by module."""
NAMED = 12
"""[logs] The latest that are changed, whose causes are looked for: seconds each where none explains a change alone."""
NAMED_WITH_EFFECTS = 4
"""[logs] The same where effects are looked for, too: some ten seconds each."""
DAY_S = 86400.0
"""[s] Of a day."""
APART = 1e-8
"""[days] Between logs of one date, a millisecond, so that time increases."""
EFFECTS_NOT_TRIED = (
    "Effects that have come or gone, such as backlash, another gain of the controller or a late clock, are not among "
    "these causes: {0}."
)
NOT_ASKED = "that was not asked for"
SAME_RATE = 1e-3
"""[1] Relative difference of two rates, up to which they are one: clocks drift by less."""
KNOWN_ROWS = 1e4
"""[samples] By which the noise of a residual counts as known where it is stated."""


@dataclass(frozen=True)
class Entry:
    """A log of a history.

    Attributes:
        name: of its file; date: by which logs are in order; digest: of the file.
        is_reference: whether it is one of the reference; new: identified in this run.
        answer: what was identified; None where nothing was, for the reason in ``why``.
        result: folder of the identification.
    """

    name: str
    date: datetime
    digest: str
    is_reference: bool
    new: bool
    answer: Answer | None
    why: str = ""
    result: str = ""


@dataclass
class EffectSearch:
    """How effects are looked for in logs.

    Attributes:
        fit_of: the log of this digest, from which this was identified, with its loop; raises FmuDidimError where there
            is none, or it tells nothing.
        progress: how far it is; failed: why they were not looked for in a log, of the last one; empty where they were.
    """

    fit_of: Callable[[str, Answer], LogFit]
    progress: Progress
    failed: str = ""
    _before: LogFit | None = field(default=None, init=False)

    def logs(self, before: Entry, after: Entry) -> tuple[LogFit, LogFit] | None:
        """A log of the reference, and one that is judged; None where effects cannot be looked for."""
        try:
            if self._before is None:
                self._before = self._of(before)
            return self._before, self._of(after)
        except FmuDidimError as error:
            self.failed = f"{error.what.rstrip('.')} ({error.got})" if error.got else error.what.rstrip(".")
            return None

    def _of(self, entry: Entry) -> LogFit:
        assert entry.answer is not None
        return self.fit_of(entry.digest, entry.answer)


@dataclass(frozen=True)
class _Reference:
    """The reference, and what of each log is compared with it."""

    entries: tuple[Entry, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    period: Period
    residuals: Period | None
    motions: frozenset[str]
    rates: tuple[float, ...]
    search: EffectSearch | None

    @property
    def first(self) -> Answer:
        assert self.entries[0].answer is not None
        return self.entries[0].answer


def watched(
    name: str,
    entries: Sequence[Entry],
    *,
    order: str,
    search: EffectSearch | None = None,
    why_no_effects: str = NOT_ASKED,
) -> WatchDocument:
    """The history of a machine.

    Args:
        name: of the case; entries: in order of their dates, those of the reference first; order: by what.
        search: for effects that have come, gone or grown; why_no_effects: why they are not looked for without one.

    Raises:
        InputError: no log of the reference gives values.
    """
    entries = _without_repeated(entries)
    reference = _reference(entries, search)
    lines = [_line(entry, reference) for entry in entries]
    for k in _asked(entries, lines, reference):
        lines[k] = _line(entries[k], reference, named=True)
    later = [line for line, entry in zip(lines, entries, strict=True) if not entry.is_reference]
    begun = _began(entries, lines, reference)
    times = _days(reference.entries)
    found = judgement([
        *of_reference(reference.period, [entry.name for entry in reference.entries], times), *of_logs(lines, later),
        *_prior(reference.first),
    ])  # fmt: skip
    changed = [line for line in later if line.state == "changed"]
    why = why_no_effects if search is None else search.failed
    remarks = [*map(str, found.remarks), _expected(later), EFFECTS_NOT_TRIED.format(why) if changed and why else ""]
    return WatchDocument(
        name=name, answer="changed" if changed else "unchanged", text=_text(later, begun), verdict=found.verdict,
        reasons=found.saved(), conditions=found.conditions, order=order, false_alarms=CHANGED,
        reference=[entry.name for entry in reference.entries], values=_values(reference), logs=lines, onset=begun,
        remarks=[remark for remark in remarks if remark],
        provenance={
            "made": datetime.now(UTC).isoformat(timespec="seconds"), "fmu_didim": __version__,
            "thresholds": recorded(DECIDING),
        },
    )  # fmt: skip


def _prior(first: Answer) -> list[Diagnostic]:
    """That all values are pulled to the same ones."""
    prior = first.document.prior
    return [] if prior is None else [Diagnostic(CHANGE_PRIOR, f"The values rest on a prior ({prior.source}).", "case")]


def _without_repeated(entries: Sequence[Entry]) -> list[Entry]:
    """The same, where a log that is an earlier one has no answer."""
    kept = list[Entry]()
    for entry in entries:
        twin = next((e for e in kept if e.digest == entry.digest or _same(e.answer, entry.answer)), None)
        kept.append(entry if twin is None else replace(entry, answer=None, why=f"it is the same log as {twin.name}"))
    return kept


def _same(one: Answer | None, other: Answer | None) -> bool:
    if one is None or other is None:
        return False
    shares = [s for v in one.fitted for w in other.fitted if (s := same_rows(v, w)) is not None]
    return max(shares, default=0.0) >= SAME_ROWS


def _asked(entries: Sequence[Entry], lines: Sequence[WatchedLog], reference: _Reference) -> list[int]:
    """The latest logs whose causes are looked for: those whose values are far, and where effects are looked for, those
    whose residual is, or whose identification is doubtful."""
    far = []
    for k, (entry, line) in enumerate(zip(entries, lines, strict=True)):
        is_far = line.p_value is not None and line.p_value < CHANGED
        if line.p_value is not None and entry.answer is not None and reference.search is not None:
            is_far |= not entry.is_reference and bool(_doubts(line, entry.answer, reference))
        if is_far:
            far.append(k)
    return far[-(NAMED if reference.search is None else NAMED_WITH_EFFECTS) :]


def _reference(entries: Sequence[Entry], search: EffectSearch | None) -> _Reference:
    usable = [e for e in entries if e.is_reference and e.answer is not None and not _why_no_values(e.answer)]
    if not usable:
        why = [
            f"{e.name}: {e.why or (_why_no_values(e.answer) if e.answer else '')}" for e in entries if e.is_reference
        ]
        raise InputError(
            "No log of the reference gives values, so that there is nothing to compare later ones with.",
            where="reference", got="; ".join(why[:3]) + (" ..." if len(why) > 3 else ""),
            next_step="Try fmu-didim identify with one of these logs, or choose another reference (--reference, "
            "--until).",
        )  # fmt: skip
    answers = [e.answer for e in usable if e.answer is not None]
    for answer in answers[1:]:
        refuse_other_models(answers[0], answer)
    names = tuple(
        name for name, p in answers[0].shared.items()
        if np.isfinite(p.std) and p.std > 0 and all(_has(answer, name) for answer in answers)
    )  # fmt: skip
    if not names:
        raise InputError(
            "The logs of the reference have no value in common.", where="reference",
            got="; ".join(f"{e.name}: {', '.join(a.shared)}" for e, a in zip(usable[:3], answers, strict=False)),
            next_step="Identify the same parameters from all of them.",
        )  # fmt: skip
    residuals = [_residual(answer) for answer in answers]
    known = [r for r in residuals if r is not None]
    labels = tuple(answers[0].document.labels)
    return _Reference(
        tuple(usable), names, tuple(answers[0].shared[n].unit for n in names),
        Period(names, [_known(answer, names) for answer in answers]),
        Period(labels, known) if len(known) == len(residuals) else None,
        frozenset(motion for answer in answers for motion in _motions(answer)),
        tuple(rate for answer in answers if (rate := _rate(answer)) is not None), search,
    )  # fmt: skip


def _has(answer: Answer, name: str) -> bool:
    found = answer.shared.get(name)
    return found is not None and bool(np.isfinite(found.std)) and found.std > 0


def _known(answer: Answer, names: Sequence[str]) -> LogValues:
    value, covariance = answer.values_of(names)
    return LogValues(value, covariance, float(answer.independent().min()))


def _residual(answer: Answer) -> LogValues | None:
    """Logarithms of what is left of each joint: of variance 1 / 2 f with f independent samples."""
    sizes = answer.document.noise_std
    if not sizes or any(size is None or size <= 0 for size in sizes):
        return None
    freedom = np.minimum(answer.independent(), KNOWN_ROWS)
    return LogValues(np.log(np.array(sizes, dtype=float)), np.diag(1 / (2 * freedom)), np.inf)


def _motions(answer: Answer) -> set[str]:
    return {
        str(e.get("reference_sha256", e.get("inputs_sha256"))) for e in experiments_of(answer)
        if e.get("role") == "estimation"
    }  # fmt: skip


def _rate(answer: Answer) -> float | None:
    rates = [e.get("torque_rate_hz", e.get("rate_hz")) for e in experiments_of(answer) if e.get("role") == "estimation"]
    return float(rates[0]) if rates and rates[0] is not None else None


def _why_no_values(answer: Answer) -> str:
    """Why a result has no values to judge by; empty where it has."""
    document = answer.document
    if document.verdict in ("refused", "not_settled") or not document.parameters:
        codes = ", ".join(dict.fromkeys(reason.code for reason in document.reasons))
        return f"its identification is {document.verdict.replace('_', ' ')}" + (f": {codes}" if codes else "")
    if len(document.covariance) != len(document.parameters):
        return "its result has no covariance"
    return ""


def _line(entry: Entry, reference: _Reference, *, named: bool = False) -> WatchedLog:
    """One log, judged; named: with the causes of its change."""
    answer = entry.answer
    document = None if answer is None else answer.document
    blank = WatchedLog(
        name=entry.name, date=entry.date.isoformat(), sha256=entry.digest, state="not_judged",
        verdict="" if document is None else document.verdict,
        codes=[] if document is None else list(dict.fromkeys(reason.code for reason in document.reasons)),
        p_value=None, moved=[], causes=[], text="", notes=[], rate_hz=None if answer is None else _rate(answer),
        values={}, result=entry.result, new=entry.new,
    )  # fmt: skip
    why = entry.why if answer is None else _why_no_values(answer)
    if answer is not None and not why:
        try:
            refuse_other_models(reference.first, answer)
        except InputError as error:
            why = f"it is of another model ({error.got})"
        if lacking := [name for name in reference.names if not _has(answer, name)]:
            why = why or f"it does not determine {', '.join(lacking)}"
    if answer is None or why:
        return blank.model_copy(update={"text": why})
    value, covariance = answer.values_of(reference.names)
    own = {
        name: LogValue(value=float(v), std=float(s))
        for name, v, s in zip(reference.names, value, np.sqrt(np.diag(covariance)), strict=True)
    }  # fmt: skip
    line = blank.model_copy(update={"values": own, "notes": _notes(answer, reference)})
    if entry.is_reference:
        return line.model_copy(update={"state": "reference", "text": "reference"})
    return _judged(line, entry, answer, reference, named=named)


def _notes(answer: Answer, reference: _Reference) -> list[str]:
    notes, rate = list[str](), _rate(answer)
    if not _motions(answer) <= reference.motions:
        notes.append(OTHER_MOTION)
    if rate is not None and not any(abs(rate - r) <= SAME_RATE * r for r in reference.rates):
        notes.append(
            f"{OTHER_RATE} ({rate:g} Hz; reference {', '.join(f'{r:g}' for r in sorted(set(reference.rates)))})"
        )
    return notes


def _judged(line: WatchedLog, entry: Entry, answer: Answer, reference: _Reference, *, named: bool) -> WatchedLog:
    """A log behind the reference, with its state: changed where its values say so, or where an effect explains what is
    doubted of it."""
    log = _known(answer, reference.names)
    found = reference.period.distance(log)
    doubts, is_changed = _doubts(line, answer, reference), found.p_value < CHANGED
    moved = _moved(found.of_each, reference.names) if is_changed else []
    causes, told, by_effect = _causes(log, entry, answer, reference) if named else ([], "", False)
    if doubts and by_effect:
        is_changed = True
    elif not is_changed:
        causes, told = [], ""
    if is_changed and OTHER_MOTION in line.notes:
        doubts.append(f"it was recorded {OTHER_MOTION}, which moves values that absorb what the model lacks")
    which = f"{', '.join(moved)} moved" if moved else "no value by itself moved, but all together have"
    if found.p_value >= CHANGED:
        which = "the values are no farther apart than those of the reference"
    text = f"{told}; {which}" if is_changed and told else which if is_changed else "no more than the reference allows"
    state = "changed" if is_changed and OTHER_MOTION not in line.notes else "doubtful" if doubts else "unchanged"
    if doubts:
        text = f"{text}; but {'; '.join(doubts)}"
    return line.model_copy(
        update={"p_value": found.p_value, "moved": moved, "causes": causes, "text": text, "state": state}
    )


def _doubts(line: WatchedLog, answer: Answer, reference: _Reference) -> list[str]:
    """What speaks against a log whatever its values are."""
    doubts = _residual_doubt(answer, reference)
    if line.verdict != "valid":
        doubts.insert(0, f"its identification is {line.verdict} ({', '.join(line.codes)})")
    return doubts


def _residual_doubt(answer: Answer, reference: _Reference) -> list[str]:
    """That the residual is not as large as in the reference; nothing where it is, or is not known."""
    residual, period = _residual(answer), reference.residuals
    if residual is None or period is None or (found := period.distance(residual)).p_value >= CHANGED:
        return []
    most = int(np.argmin(found.of_each))
    ratio = float(np.exp(residual.value[most] - period.mean[0][most]))
    return [
        f"the residual of {period.names[most]} is {ratio:.2g} times that of the reference (p = {found.p_value:.1e})"
    ]


def _moved(of_each: Array, names: Sequence[str]) -> list[str]:
    """Values beyond the reference by Holm's method."""
    moved, count = list[str](), len(names)
    for rank, k in enumerate(np.argsort(of_each)):
        if of_each[k] * (count - rank) >= 1 - CONFIDENCE:
            break
        moved.append(names[k])
    return [name for name in names if name in moved]


def _causes(log: LogValues, entry: Entry, answer: Answer, reference: _Reference) -> tuple[list[str], str, bool]:
    """Titles of the causes that explain a change, the same in words with how much, and whether the best is an
    effect."""
    mean, covariance = reference.period.mean
    names, between = reference.names, np.diag(reference.period.between**2)
    change = Difference(
        names, reference.units, mean, log.value, reference.period.spread_of(log) + covariance,
        min(log.freedom, *(one.freedom for one in reference.period.logs)), answer.samples + reference.first.samples,
    )  # fmt: skip
    known = Known(names, mean, covariance + between), Known(names, log.value, log.covariance)
    search, logs = reference.search, None
    if search is not None:
        logs = search.logs(reference.entries[-1], entry)
    try:
        robot = machine(reference.first, answer)
        result, failed = explained(
            change, known, robot, logs, Progress() if search is None else search.progress, between=between
        )
    except (FmuDidimError, np.linalg.LinAlgError):
        return [], "", False
    if search is not None and failed:
        search.failed = failed
    titles = [" and ".join(form.title for form in e.forms) for e in result.named]
    if not titles:
        return [], "no cause that was tried explains it" if result.is_changed else "", False
    words = "; or ".join(cause_text(e) for e in result.named)
    return titles, words if len(titles) == 1 else f"one of {len(titles)}: {words}", shows_effect(result.named[0])


def _days(entries: Sequence[Entry]) -> Array:
    """(N,) days since the first; a millisecond apart at least, in their order."""
    days = [(e.date - entries[0].date).total_seconds() / DAY_S for e in entries]
    return np.asarray(np.maximum.accumulate(np.array(days)) + APART * np.arange(len(days)))


def _began(entries: Sequence[Entry], lines: Sequence[WatchedLog], reference: _Reference) -> OnsetResult | None:
    """When the change began, of the logs along the motion of the reference."""
    if not any(line.state == "changed" for line in lines):
        return None
    kept = [
        (entry, line) for entry, line in zip(entries, lines, strict=True)
        if not entry.is_reference and line.p_value is not None and OTHER_MOTION not in line.notes
    ]  # fmt: skip
    answers = [e.answer for e, _ in kept if e.answer is not None]
    last = reference.entries[-1]
    days = _days([last, *(entry for entry, _ in kept)])
    parts = [(reference.period, [_known(answer, reference.names) for answer in answers])]
    if reference.residuals is not None and None not in (residuals := [_residual(answer) for answer in answers]):
        parts.append((reference.residuals, [r for r in residuals if r is not None]))  # effects show in them
    found = onset(_after(parts, days[1:] - days[0]))
    names = [entry.name for entry, _ in kept]
    first, end, early, late = (names[k] for k in (found.first, found.last, found.earliest, found.latest))
    between = "" if early == late else f" (95 %: {early} to {late})"
    text = {
        "step": f"a lasting change, first in {first}{between}",
        "drift": f"a drift that began with {first}{between}",
        "episode": f"a single log, {first}, and those after it are as before" if first == end else
        f"a change that is over: from {first}{between} to {end}",
        "last": f"the last log, {first}: no later one tells whether it lasts",
    }[found.kind]  # fmt: skip
    if found.rivals:
        kinds = {"step": "a lasting step", "drift": "a drift", "episode": "a change that is over", "last": ""}
        text += f"; the logs could as well show {' or '.join(kinds[kind] for kind in found.rivals)}"
    return OnsetResult(
        kind=found.kind, log=first, last=end, earliest=early, latest=late, gain=found.gain, rivals=list(found.rivals),
        text=text,
    )  # fmt: skip


def _after(parts: Sequence[tuple[Period, list[LogValues]]], days: Array) -> After:
    """Logs behind a reference by several kinds of numbers, which are independent of each other."""
    means, covariances = zip(*(period.mean for period, _ in parts), strict=True)
    spreads = [[period.spread_of(log) for log in logs] for period, logs in parts]
    return After(
        np.concatenate(means), block_diag(*covariances),
        np.hstack([np.array([log.value for log in logs]) for _, logs in parts]),
        np.array([block_diag(*each) for each in zip(*spreads, strict=True)]), days,
    )  # fmt: skip


def _values(reference: _Reference) -> dict[str, WatchedValue]:
    one = reference.period
    mean, covariance = one.mean
    usual = LogValues(mean, one.noise, min(log.freedom for log in one.logs))
    wide = float(normal_isf((1 - CONFIDENCE) / 2)) * np.sqrt(np.diag(one.spread_of(usual) + covariance))
    seen, std = one.least_seen(usual, CHANGED), np.sqrt(np.diag(covariance))
    return {
        name: WatchedValue(
            unit=reference.units[i], mean=float(mean[i]), std=float(std[i]),
            between=float(one.between[i]) if one.knows_spread else None,
            band=(float(mean[i] - wide[i]), float(mean[i] + wide[i])), half_seen=float(seen[i]),
        )
        for i, name in enumerate(reference.names)
    }  # fmt: skip


def _expected(later: Sequence[WatchedLog]) -> str:
    """How many false alarms there may be."""
    judged = sum(line.p_value is not None for line in later)
    if not judged:
        return ""
    return (
        f"An unchanged machine is called changed in {CHANGED:g} of its logs at most: of the {judged} here, no more "
        f"than {judged * CHANGED:.2g} are expected."
    )


def _text(later: Sequence[WatchedLog], begun: OnsetResult | None) -> str:
    """The answer in words."""
    if not later:
        return "there is no log behind the reference"
    counts = {state: sum(line.state == state for line in later) for state in ("unchanged", "doubtful", "not_judged")}
    changed = [line for line in later if line.state == "changed"]
    rest = ", ".join(f"{count} {state.replace('_', ' ')}" for state, count in counts.items() if count)
    if not changed:
        return f"none of {len(later)} logs is changed: {rest}"
    head = f"{len(changed)} of {len(later)} logs changed" + (f" ({rest})" if rest else "")
    causes = changed[-1].causes
    named = f"; cause by the last of them: {'; or '.join(causes)}" if causes else ""
    return f"{head}{'' if begun is None else f': {begun.text}'}{named}"
