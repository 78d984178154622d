"""What must be known of a history of many logs: of its reference, and of what the logs behind it are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.discovery.change.difference import CHANGED
from fmu_didim.discovery.change.onset import order_chance
from fmu_didim.discovery.change.period import FEWEST_FOR_SPREAD, Period
from fmu_didim.results.watch import WatchedLog

ORDERED = 0.01
"""[1] Probability of as clear a step or drift in another order of the reference logs, below which it is doubted: one
reference in a hundred is, without a reason."""
FEWEST_ORDERED = 5
"""[logs] Of a reference in which one may be judged by the others: from four on their spread is estimated."""

WATCH_FEW = CATALOGUE(
    "watch-few-references", DOUBT, rank=20,
    meaning="The reference has too few logs to tell how far logs of one state are apart. They are taken to differ by "
    "their noise alone, so that what varies from day to day is called a change more often than stated.",
    next_step="Take more logs as reference: four at least, ten where changes should show soon (--reference N).",
)  # fmt: skip
WATCH_REFERENCE = CATALOGUE(
    "watch-reference-changed", DOUBT, rank=12,
    meaning="The logs of the reference are not of one state: one is far from the others, or their order shows a step "
    "or a drift that chance hardly gives. What has changed inside the reference is not seen behind it.",
    next_step="Choose a reference that lies before the change, or behind it (--reference N, --until DATE), and watch "
    "again.",
)  # fmt: skip
WATCH_REFERENCE_DOUBTED = CATALOGUE(
    "watch-reference-doubted", DOUBT, rank=14,
    meaning="A log of the reference is doubtful, or could not be used. What moved its values stands in the reference.",
    next_step="Settle the doubts of that log first (its result.json names them), or leave it out of the folder.",
)  # fmt: skip
WATCH_LOG = CATALOGUE(
    "watch-log-not-sure", DOUBT, rank=30, at_once=True,
    meaning="A log behind the reference could not be judged, or is doubtful: that nothing has changed is not known of "
    "it.",
    next_step="See what its line says. A case of its own with that log, beside one with a log of the reference, in "
    "fmu-didim compare names an effect that has come.",
)  # fmt: skip
WATCH_MOTION = CATALOGUE(
    "watch-motion", DOUBT, rank=16, at_once=True,
    meaning="A log was recorded along another motion than the reference. What the model lacks acts differently along "
    "it and moves the values without any change of the machine.",
    next_step="Repeat the motion of the reference; or give a reference with that motion.",
)  # fmt: skip
WATCH_SPREAD = CATALOGUE(
    "watch-spread", REMARK, rank=60,
    meaning="The logs of the reference differ by more than their noise. That is taken for the spread from day to day; "
    "a change inside the reference looks the same.",
    next_step="If the machine should not vary that much, see when it did in the history of its values.",
)  # fmt: skip
WATCH_RATE = CATALOGUE(
    "watch-rate", REMARK, rank=62,
    meaning="A log has another rate than the reference. Its covariance allows for that; what the model lacks may act "
    "differently at another rate.",
    next_step="Record at the rate of the reference.",
)  # fmt: skip


def of_reference(period: Period, names: Sequence[str], time: np.ndarray) -> Iterator[Diagnostic]:
    """What is doubted of a reference.

    Args:
        names: of its logs; time: (N,) of them, increasing.
    """
    count = len(period.logs)
    if not period.knows_spread:
        yield Diagnostic(
            WATCH_FEW, f"The reference has {count} log{'' if count == 1 else 's'}: how far logs of one state are apart "
            "is not known.", "reference", float(count), float(FEWEST_FOR_SPREAD),
        )  # fmt: skip
    if count >= FEWEST_ORDERED:
        for k, name in enumerate(names):
            others = Period(period.names, [log for i, log in enumerate(period.logs) if i != k])
            found = others.distance(period.logs[k]).p_value
            if found < CHANGED:
                yield Diagnostic(
                    WATCH_REFERENCE, f"It is far from the other logs of the reference (p = {found:.1e}).", name, found,
                    CHANGED,
                )  # fmt: skip
    chance, place = order_chance(period.values, period.noise + np.diag(period.between**2), time)
    if chance < ORDERED:
        yield Diagnostic(
            WATCH_REFERENCE, f"The reference drifts, or steps, most clearly with {names[place]}: another order of its "
            f"logs shows as much with p = {chance:.2g}.", "reference", chance, ORDERED,
        )  # fmt: skip
    elif period.noise_alone < CHANGED:
        ratio = period.between / np.sqrt(np.diag(period.noise))
        most = int(np.argmax(ratio))
        yield Diagnostic(
            WATCH_SPREAD, f"Logs of the reference differ by more than their noise (p = {period.noise_alone:.1e}), most "
            f"in {period.names[most]}: {ratio[most]:.1f} of its standard deviations. They would be apart most clearly "
            f"before and from {names[place]}.", "reference",
            condition="the spread between the logs of the reference is that of one state, not a change among them",
        )  # fmt: skip


def of_logs(logs: Sequence[WatchedLog], later: Sequence[WatchedLog]) -> Iterator[Diagnostic]:
    """What is doubted of the logs themselves; later: those behind the reference."""
    for log in logs:
        if log not in later and (log.verdict != "valid" or log.state != "reference"):
            text = f"The log is {log.verdict}: {', '.join(log.codes)}." if log.state == "reference" else (
                f"It is not used: {log.text}."
            )  # fmt: skip
            yield Diagnostic(WATCH_REFERENCE_DOUBTED, text, log.name)
    for log in later:
        if log.state in ("doubtful", "not_judged"):
            code = WATCH_MOTION if OTHER_MOTION in log.notes else WATCH_LOG
            yield Diagnostic(code, f"{log.text[:1].upper()}{log.text[1:]}.", log.name)
        elif OTHER_MOTION in log.notes:
            yield Diagnostic(WATCH_MOTION, "It follows another motion than the reference.", log.name)
    rates = [log.name for log in later if any(note.startswith(OTHER_RATE) for note in log.notes)]
    if rates:
        yield Diagnostic(WATCH_RATE, f"At another rate than the reference: {', '.join(rates)}.")


OTHER_MOTION = "along another motion than the reference"
OTHER_RATE = "at another rate"
"""Beginnings of notes on a log."""
