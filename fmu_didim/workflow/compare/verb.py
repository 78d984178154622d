"""The verb ``compare``: two results in; what moved, and which cause explains it, out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.discovery.change.answers import Answer
from fmu_didim.discovery.change.document import compared
from fmu_didim.results.comparison import COMPARISON_FILE, Change, ComparisonDocument, save_comparison
from fmu_didim.results.result import result_path
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


def compare(
    before: Result | Path | str,
    after: Result | Path | str,
    out: Path | str | None = None,
    *,
    show: Callable[[Compared], None] | None = None,
) -> Compared:
    """Whether the machine has changed between two results, which values moved, and which cause explains it.

    A test of all values at once, (v2 - v1)' (C1 + C2)^-1 (v2 - v1) with the covariances of both, says whether anything
    has changed; only then parameters and causes are named.

    Args:
        before, after: results of :func:`identify` of the same model from two logs, ``result.json`` or its folder.
        out: folder for ``compare.json`` and ``compare.html``.
        show: called with the answer before anything is written.

    Raises:
        InputError: a result is missing or holds no settled values, the two are of different models or of one and the
            same log, or there is no writing to ``out``.
    """
    folder = None if out is None else comparison_folder(out)
    if folder is not None:
        folder.check()
    found = Compared(compared(_answer("before", before), _answer("after", after)))
    if show is not None:
        show(found)
    if folder is not None:
        found.write(folder)
    return found


def _answer(place: str, given: Result | Path | str) -> Answer:
    """A result as it is compared."""
    if isinstance(given, Result):
        result, source = given, ""
    else:
        if Path(given).suffix in (".yaml", ".yml"):
            raise InputError(
                "This is a case, not a result.", where=str(given), valid="result.json, or its folder",
                next_step="Run fmu-didim identify on both cases, and compare their results.",
            )  # fmt: skip
        result, source = Result.load(given), str(result_path(given))
    try:
        robot = result.robot
    except FmuDidimError:  # an effect that is not there any more: values can still be compared
        robot = None
    return Answer(place, source, result.document, result.validations, robot)
