"""The saved history of a machine over many logs: ``watch.json``."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from fmu_didim.base.documents import Number, Saved
from fmu_didim.checks.judgement import RESTS_ON, DiagnosticResult, Verdict
from fmu_didim.results.saved import read_saved, write_saved

WATCH_FILE = "watch.json"
State = Literal["reference", "unchanged", "changed", "doubtful", "not_judged"]
OnsetKind = Literal["step", "drift", "episode", "last"]


class LogValue(Saved):
    """A value by one log, in its unit.

    Attributes:
        value: as it was identified; std: its standard deviation, of the noise of this log alone.
    """

    value: float
    std: float


class WatchedLog(Saved):
    """One log.

    Attributes:
        name: of its file; date: by ISO 8601, by which logs are in order; sha256: of the file.
        verdict: on its identification; empty where there is none; codes: of what is doubted or wrong of it.
        p_value: of as large a distance from the reference by noise and the spread between logs; null where not judged.
        moved: values that are beyond what the reference allows, once all together are.
        causes: that explain the change alone, the best first; of several the data cannot tell which.
        text: the answer in words; notes: what else must be known of this log.
        values: name of each -> by this log; rate_hz: of its torque.
        result: folder of its identification, beside ``watch.json``; empty where there is none.
        new: whether it was identified in this run, not before.
    """

    name: str
    date: str
    sha256: str
    state: State = Field(
        description="reference; unchanged; changed; doubtful: something speaks against either; not_judged: there are "
        "no values to judge it by"
    )
    verdict: str
    codes: list[str]
    p_value: Number
    moved: list[str]
    causes: list[str]
    text: str
    notes: list[str]
    values: dict[str, LogValue]
    rate_hz: Number
    result: str
    new: bool


class WatchedValue(Saved):
    """A value of the machine in the reference.

    Attributes:
        unit: FMI unit string; mean, std: of the machine.
        between: standard deviation between logs beyond their noise; null where there are too few logs to tell.
        band: in which 95 % of logs of the same state lie.
        half_seen: change of this value alone that one more such log shows half of the time.
    """

    unit: str
    mean: float
    std: float
    between: Number
    band: tuple[float, float]
    half_seen: float


class OnsetResult(Saved):
    """When the change began.

    Attributes:
        kind: step: it lasts; drift: it grows with time; episode: it is over; last: of the last log alone, so that
            nothing tells whether it lasts.
        log: name of the first log of the changed state; last: of the last one.
        earliest, latest: names of the logs between which the first one lies with 95 %.
        gain: chi-square by which this explains the logs better than no change.
        rivals: other kinds that explain them as well.
        text: the same in words.
    """

    kind: OnsetKind
    log: str
    last: str
    earliest: str
    latest: str
    gain: float
    rivals: list[OnsetKind]
    text: str


class WatchDocument(Saved):
    """The content of ``watch.json``.

    Attributes:
        name: of the case; text: the answer in words.
        order: by what the logs are in order.
        false_alarms: probability that a log of an unchanged machine is called changed.
        reference: names of the logs of the reference that are used; values: name of each value -> it in the reference.
        logs: all, in order of their dates; onset: of the change; null without one.
        remarks: that do not affect the verdict.
        provenance: versions and thresholds.
    """

    schema_version: Literal[1] = 1
    name: str
    answer: Literal["unchanged", "changed"] = Field(description="whether any log behind the reference is changed")
    text: str
    verdict: Verdict = Field(description="whether the answer may be used")
    reasons: list[DiagnosticResult] = Field(description="why the verdict is not valid, the most important first")
    conditions: list[str] = Field(default=[], description=RESTS_ON)
    order: str
    false_alarms: float
    reference: list[str]
    values: dict[str, WatchedValue]
    logs: list[WatchedLog]
    onset: OnsetResult | None
    remarks: list[str]
    provenance: dict[str, Any]


def watch_schema() -> dict[str, Any]:
    """JSON Schema of ``watch.json``."""
    return WatchDocument.model_json_schema()


def save_watch(document: WatchDocument, folder: Path) -> Path:
    """Write ``watch.json``, in the place of an earlier one when all is written."""
    return write_saved(document, folder / WATCH_FILE)


def load_watch(path: Path | str) -> WatchDocument:
    """Read ``watch.json`` or that of a folder; raises InputError if it is missing or damaged."""
    return read_saved(
        path, WATCH_FILE, WatchDocument, what="This is no saved history of a machine.",
        next_step="Give the folder that fmu-didim watch wrote; if its file is damaged, watch again.",
    )  # fmt: skip
