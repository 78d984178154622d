"""The verb ``compare``: two results or two cases in; what moved, and which cause explains it, out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.case import Case, load_case
from fmu_didim.checks.judgement import DiagnosticResult, Verdict
from fmu_didim.discovery.change.document import compared
from fmu_didim.discovery.change.log_fit import LogFit
from fmu_didim.discovery.progress import Progress
from fmu_didim.model.workers import one_blas_thread
from fmu_didim.results.comparison import COMPARISON_FILE, Change, ComparisonDocument, save_comparison
from fmu_didim.results.result import result_path
from fmu_didim.workflow.compare.answer import answer_of, log_of, why_no_effects
from fmu_didim.workflow.discover import described_plant
from fmu_didim.workflow.identify import identify
from fmu_didim.workflow.output.exit_codes import CHANGED_EXIT, EXIT_CODES
from fmu_didim.workflow.output.result import Result
from fmu_didim.workflow.output.result_folder import ResultFolder

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, repr=False)
class Compared:
    """What :func:`compare` returns.

    Attributes:
        document: the content of ``compare.json``.
    """

    document: ComparisonDocument

    @property
    def answer(self) -> Change:
        """``unchanged``, ``named``, ``ambiguous`` or ``unknown``."""
        return self.document.answer

    @property
    def changed(self) -> bool:
        """Whether something has changed."""
        return self.document.answer != "unchanged"

    @property
    def causes(self) -> list[str]:
        """Titles of the causes that explain the change, the best first; two together are joined by ``and``."""
        return [" and ".join(part.title for part in cause.parts) for cause in self.document.causes]

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
        """The exit code of the command line: 5 where something has changed, 4 where that nothing has is doubtful."""
        return CHANGED_EXIT if self.changed else EXIT_CODES[self.document.verdict]

    def summary(self) -> str:
        """The table that the terminal shows, at most 100 columns."""
        from fmu_didim.report.comparison.sections import comparison_table

        return comparison_table(self.document)

    def to_frame(self) -> DataFrame:
        """A data frame of the parameters: ``before``, ``after``, ``change``, ``std``, ``low``, ``high``, ``p_value``,
        ``moved``, ``least_seen`` and ``unit``."""
        import pandas as pd

        rows = {}
        for name, p in self.document.parameters.items():
            low, high = p.interval
            row = p.model_dump(exclude={"interval"}) | {"low": low, "high": high}
            rows[name] = row
        return pd.DataFrame.from_dict(rows, orient="index")

    def save(self, folder: Path | str) -> Path:
        """Write ``compare.json`` and ``compare.html`` to a folder; returns the path of the former."""
        place = comparison_folder(folder)
        place.check()
        self.write(place)
        return place.folder / COMPARISON_FILE

    def write(self, folder: ResultFolder) -> None:
        """As :meth:`save`, to a folder that was checked before."""
        from fmu_didim.report.comparison.sections import write_comparison

        with folder.written() as new:
            save_comparison(self.document, new)
            write_comparison(self.document, new)

    def __repr__(self) -> str:
        return f"Compared({self.document.name!r}, {self.answer})"

    def _repr_html_(self) -> str:
        """For notebooks: verdict, parameters and causes."""
        from fmu_didim.report.comparison.sections import comparison_html

        return comparison_html(self.document)


def comparison_folder(out: Path | str) -> ResultFolder:
    """The folder of the results of ``compare``."""
    from fmu_didim.report.comparison.sections import COMPARISON_PAGE

    return ResultFolder(Path(out), "compare", COMPARISON_FILE, (COMPARISON_PAGE,), (), "files")


@one_blas_thread
def compare(
    before: Result | Case | Path | str,
    after: Result | Case | Path | str,
    out: Path | str | None = None,
    *,
    effects: bool | None = None,
    progress: Callable[[str], None] | None = None,
    show: Callable[[Compared], None] | None = None,
) -> Compared:
    """Whether the machine has changed between two results, which values moved, and which cause explains it.

    A test of all values at once, (v2 - v1)' (C1 + C2)^-1 (v2 - v1) with the covariances of both, says whether anything
    has changed; only then parameters and causes are named. Two cases are identified first, and effects that the model
    lacks are looked for in both logs: one that has come, gone or grown, such as backlash, another gain of the
    controller or a late clock, competes with the causes that move the values.

    Args:
        before, after: results of :func:`identify` of the same model from two logs, ``result.json`` or its folder; or
            cases, loaded or their files.
        effects: whether effects are looked for, which takes a minute or so; by default where both are cases. Results
            of this session can have it, too; those that were loaded hold no loop.
        progress: called with a line about each piece of work.
        out: folder for ``compare.json`` and ``compare.html``.
        show: called with the answer before anything is written.

    Raises:
        InputError: a result is missing or holds no settled values, the two are of different models or of one and the
            same log, or there is no writing to ``out``.
    """
    folder = None if out is None else comparison_folder(out)
    if folder is not None:
        folder.check()
    _refuse_one_file(before, after)
    progress = progress or (lambda text: None)
    given = {"before": before, "after": after}
    sides = {place: _side(place, one, progress) for place, one in given.items()}
    logs, why = _logs(sides, effects)
    first, second = (answer_of(side.result, side.source, place) for place, side in sides.items())
    found = Compared(compared(first, second, logs, progress=Progress(progress), why_no_logs=why))
    if show is not None:
        show(found)
    if folder is not None:
        found.write(folder)
    return found


def _refuse_one_file(before: Result | Case | Path | str, after: Result | Case | Path | str) -> None:
    """Raise InputError where one file is given twice, before it is identified."""
    paths = [Path(given) for given in (before, after) if isinstance(given, Path | str)]
    if len(paths) == 2 and paths[0].exists() and paths[0].resolve() == paths[1].resolve():
        raise InputError(
            "This is one file twice: both answers would come from the same log.", where=str(before),
            valid="two logs that were recorded apart", next_step="Give the case or the result of another log.",
        )  # fmt: skip


@dataclass(frozen=True)
class _Side:
    """One of the two: its result, where it was read, and its case where it was one."""

    result: Result
    source: str = ""
    case: Case | None = None


def _side(place: str, given: Result | Case | Path | str, progress: Callable[[str], None]) -> _Side:
    """What was given, a case identified."""
    if isinstance(given, Result):
        return _Side(given)
    if not isinstance(given, Case) and Path(given).suffix not in (".yaml", ".yml"):
        return _Side(Result.load(given), str(result_path(given)))
    case = given if isinstance(given, Case) else load_case(given)
    progress(f"identifying the log {place}: {case.name}")
    try:
        return _Side(identify(case), str(case.path), case)
    except FmuDidimError as error:
        raise InputError(
            f"The log {place} gives no values to compare. {error.what}", where=str(case.path), got=error.got,
            valid=error.valid, next_step=error.next_step,
        ) from error  # fmt: skip


def _logs(sides: Mapping[str, _Side], effects: bool | None) -> tuple[tuple[LogFit, LogFit] | None, str]:
    """Both logs with their loops, where effects are looked for; else None, and why not.

    Raises:
        InputError: effects were asked for, and the loops are not there or tell nothing of them.
    """
    if effects is False:
        return None, "that was not asked for"
    if effects is None and any(side.case is None for side in sides.values()):
        return None, "give the two cases (fmu-didim compare BEFORE.yaml AFTER.yaml) for that"
    for place, side in sides.items():
        why = why_no_effects(side.result.model)
        if why and effects:
            raise InputError(
                "In this log effects cannot be looked for.", where=place, got=why,
                next_step="Compare the values alone: identify both cases, and give their results.",
            )  # fmt: skip
        if why:
            return None, f"{place}, {why}"
    try:
        first, second = (_log(side) for side in sides.values())
    except FmuDidimError as error:
        if effects:
            raise
        return None, f"{error.what.rstrip('.')} ({error.got})"
    return (first, second), ""


def _log(side: _Side) -> LogFit:
    return log_of(side.result.model, side.result.robot if side.case is None else described_plant(side.case))
