"""The verb ``watch``: a folder of logs in; which of them show a changed machine, why and since when, out."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from fmu_didim.base.errors import InputError
from fmu_didim.case import Case, load_case
from fmu_didim.checks.judgement import DiagnosticResult, Verdict
from fmu_didim.discovery.change.watched import NOT_ASKED, EffectSearch, Entry, watched
from fmu_didim.discovery.progress import Progress
from fmu_didim.model.workers import one_blas_thread
from fmu_didim.results.watch import WATCH_FILE, OnsetResult, WatchDocument, WatchedLog, save_watch
from fmu_didim.workflow.output.exit_codes import CHANGED_EXIT, EXIT_CODES
from fmu_didim.workflow.output.result_folder import ResultFolder
from fmu_didim.workflow.watch.logs import BY_NAME, BY_TIME, DatedLog, dated_logs, split
from fmu_didim.workflow.watch.store import Store, beside_logs

if TYPE_CHECKING:
    from pandas import DataFrame

REFERENCE = 10
"""[logs] Of a reference by default: of ten, a change of some seven deviations of a value shows; of five, of twenty."""
OF_MODEL = "the case is of a model without controller"


@dataclass(frozen=True, repr=False)
class Watched:
    """What :func:`watch` returns.

    Attributes:
        document: the content of ``watch.json``.
    """

    document: WatchDocument

    @property
    def changed(self) -> bool:
        """Whether any log behind the reference is of a changed machine."""
        return self.document.answer == "changed"

    @property
    def logs(self) -> list[WatchedLog]:
        """All logs, in order of their dates."""
        return self.document.logs

    @property
    def onset(self) -> OnsetResult | None:
        """When the change began; None without one."""
        return self.document.onset

    @property
    def verdict(self) -> Verdict:
        """Whether the answer may be used."""
        return self.document.verdict

    @property
    def reasons(self) -> list[DiagnosticResult]:
        """Why it is not valid, the most important first."""
        return self.document.reasons

    @property
    def exit_code(self) -> int:
        """The exit code of the command line: 5 where a log is changed, 4 where that none is is doubtful."""
        return CHANGED_EXIT if self.changed else EXIT_CODES[self.document.verdict]

    def summary(self) -> str:
        """A line a log, and the answer, at most 100 columns."""
        from fmu_didim.report.watch.sections import watch_table

        return watch_table(self.document)

    def lines(self) -> list[str]:
        """A line of JSON a log, and one with the answer, for scripts."""
        answer = self.document.model_dump(mode="json", exclude={"logs", "values", "provenance"})
        return [*(log.model_dump_json() for log in self.logs), json.dumps(answer)]

    def to_frame(self) -> DataFrame:
        """A data frame of the logs: ``state``, ``p_value``, and of each value itself and ``<name> std``."""
        import pandas as pd

        rows = {}
        for log in self.logs:
            own = {k: v for n, x in log.values.items() for k, v in ((n, x.value), (f"{n} std", x.std))}
            rows[log.name] = {"date": pd.Timestamp(log.date), "state": log.state, "p_value": log.p_value, **own}
        return pd.DataFrame.from_dict(rows, orient="index")

    def write(self, folder: ResultFolder) -> None:
        """Write ``watch.json`` and ``watch.html`` to a folder that was checked before."""
        from fmu_didim.report.watch.sections import write_watch

        with folder.written() as new:
            save_watch(self.document, new)
            write_watch(self.document, new)

    def __repr__(self) -> str:
        return f"Watched({self.document.name!r}, {self.document.answer}, {len(self.logs)} logs)"

    def _repr_html_(self) -> str:
        """For notebooks: verdict and logs."""
        from fmu_didim.report.watch.sections import watch_html

        return watch_html(self.document)


def watch_folder(out: Path | str) -> ResultFolder:
    """The folder of the results of ``watch``."""
    from fmu_didim.report.watch.sections import WATCH_PAGE

    return ResultFolder(Path(out), "watch", WATCH_FILE, (WATCH_PAGE,), (), "files")


@one_blas_thread
def watch(
    folder: Path | str,
    case: Case | Path | str,
    out: Path | str,
    *,
    after: Path | str | None = None,
    reference: int | None = None,
    until: date | None = None,
    by_time: bool = False,
    effects: bool = True,
    progress: Callable[[str], None] | None = None,
    show: Callable[[Watched], None] | None = None,
) -> Watched:
    """Which logs of a folder show that the machine has changed, which values moved, why, and when it began.

    Each log is identified with the model of the case, and judged by those of the reference: by their values, their
    covariances, and the spread between them. A log of an unchanged machine is called changed once in a thousand.

    Args:
        folder: of the logs, each with a date in its name.
        case: whose log those of the folder stand for, in turn.
        out: folder for ``watch.json`` and ``watch.html``, and for the results of the logs: what is there is not
            identified again while log, case and program are the same.
        after: folder of the logs that are judged; all of the first one are the reference then.
        reference: number of logs that are the reference, from the first; ten by default.
        until: the last day of the reference, in the place of a number.
        by_time: whether logs are in order of the times of their files, not of the dates in their names.
        effects: whether effects that have come, gone or grown, such as backlash, are looked for in the latest logs that
            are far from the reference, as by :func:`compare`; some ten seconds each.
        progress: called with a line about each piece of work; show: with the answer before it is written.

    Raises:
        InputError: there are no logs, one has no date, the case does not fit, no log of the reference gives values, or
            there is no writing to ``out``.
    """
    place = watch_folder(out)
    place.check()
    case = case if isinstance(case, Case) else load_case(case, require_torque=False)
    store = Store.of(place.folder, case)
    logs, count = _logs(Path(folder), None if after is None else Path(after), case, reference, until, by_time=by_time)
    entries, say, paths = [], progress or (lambda text: None), dict[str, Path]()
    for k, log in enumerate(logs):
        kept = store.answer(log.path, say)
        paths[kept.digest] = log.path
        shown = str(kept.folder.relative_to(place.folder)) if kept.answer is not None else ""
        entries.append(
            Entry(log.path.name, log.date, kept.digest, k < count, kept.is_new, kept.answer, kept.why, shown)
        )
    search, why = None, NOT_ASKED if not effects else OF_MODEL
    if effects and not store.place.of_model:
        search = EffectSearch(lambda digest, answer: store.log(paths[digest], answer), Progress(say))
    found = Watched(
        watched(case.name, entries, order=BY_TIME if by_time else BY_NAME, search=search, why_no_effects=why)
    )
    if show is not None:
        show(found)
    found.write(place)
    return found


def _logs(
    folder: Path, after: Path | None, case: Case, reference: int | None, until: date | None, *, by_time: bool
) -> tuple[list[DatedLog], int]:
    """All logs, and how many of them are the reference."""
    beside = list(beside_logs(case))
    logs = dated_logs(folder, by_time=by_time, beside=beside)
    if after is None:
        return logs, split(logs, count=reference, until=until, default=REFERENCE)
    if after.resolve() == folder.resolve():
        raise InputError(
            "This folder is there twice: each log would be judged by itself.", where=str(after),
            next_step="Give the folder of the later logs, or one folder alone.",
        )  # fmt: skip
    later = dated_logs(after, by_time=by_time, beside=beside)
    if later[0].date < logs[-1].date:
        raise InputError(
            "A log that is to be judged is older than one of the reference.", where=str(after),
            got=f"{later[0].path.name} and {logs[-1].path.name}",
            next_step="Give the folder of the earlier logs first; or put all into one folder, and say --until DATE.",
        )  # fmt: skip
    return [*logs, *later], len(logs)
