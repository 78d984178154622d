"""The result of a discovery: the findings, the models they come from, and views of both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case import Case
from fmu_didim.checks.judgement import DiagnosticResult, Verdict
from fmu_didim.data.signals import Array
from fmu_didim.data.tables import read_trajectory
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.run import Found
from fmu_didim.discovery.signals.run import FoundOnSignals
from fmu_didim.model.experiment import Role
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.simulated_table import simulated_table
from fmu_didim.results.findings import (
    FINDINGS_FILE,
    Answer,
    CandidateResult,
    CurveResult,
    FindingResult,
    FindingsDocument,
    FrictionResult,
    GapPair,
    NoiseResult,
    RegionResult,
    ValueFound,
    WindowResult,
    load_findings,
)
from fmu_didim.workflow.case_files import paths_read
from fmu_didim.workflow.output.discovered_files import copy_saved, result_folder, write_found
from fmu_didim.workflow.output.exit_codes import EXIT_CODES
from fmu_didim.workflow.output.frames import findings_frame
from fmu_didim.workflow.output.result_folder import ResultFolder

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from fmu_didim.report.drawing.torque_charts import Simulated

    Torques = tuple[Array, Array, dict[str, Simulated]]


NO_LIMIT = Progress()
_ADDED: Any = {
    "files": True, "notes": True,
    "findings": {"__all__": {"experiment": True, "ladder": {"__all__": {"next_step"}}}},
}  # fmt: skip
"""Entries of a document that saving changes."""


@dataclass(frozen=True, repr=False, eq=False)
class Discovered:
    """The result of :func:`~fmu_didim.discover`, which :meth:`load` reads from a folder.

    Two are equal if their documents are, apart from what saving adds: files, the notes on them, proposed motions.

    Attributes:
        document: the content of ``findings.json``.
        fits: base and final model with the noise, the steps between; None where it was loaded. Of a model alone the
            estimates without and with what was found.
        folder: from which it was loaded; case: which was searched, None where it was loaded.
    """

    document: FindingsDocument
    fits: Found | FoundOnSignals | None = None
    folder: Path | None = None
    case: Case | None = None

    @classmethod
    def load(cls, path: Path | str) -> Discovered:
        """The discovery of a folder, or of its ``findings.json``; raises InputError if there is no discovery."""
        document, path = load_findings(path), Path(path)
        return cls(document, folder=path if path.is_dir() else path.parent)

    def save(self, folder: Path | str, *, figures: bool = False) -> Path:
        """Write what ``discover(..., out=folder)`` writes: findings, signals, the augmented model, ``discovery.html``.

        They replace all that an earlier discovery left there, or nothing of it. A discovery that was loaded is copied.

        Args:
            figures: whether each chart of the page is written, too, as PNG and SVG (``figure_*``).

        Returns:
            The path of ``findings.json``.

        Raises:
            InputError: they cannot be written, or a file of a discovery that was loaded is missing.
        """
        place = result_folder(folder, figures=figures)
        place.check(reads=() if self.case is None else paths_read(self.case))
        self.write(place)
        return place.folder / FINDINGS_FILE

    def write(
        self, folder: ResultFolder, *, progress: Progress = NO_LIMIT, show: Callable[[Discovered], None] | None = None
    ) -> Discovered:
        """As :meth:`save`, to a folder that was checked before; returns what was written.

        Args:
            show: called with it before it takes its place in the folder, also where writing fails.
        """
        from fmu_didim.report.discovery.sections import write_discovery_report

        written = self
        with folder.written() as new:
            try:
                if self.fits is not None and self.case is not None:
                    document = write_found(self.case, self.fits, new, folder.folder, progress)
                    written = replace(self, document=document)
                else:
                    copy_saved(self.document, self.folder or Path(), new, folder.folder)
                write_discovery_report(new)
                if folder.figures:
                    from fmu_didim.report.paper import write_figures

                    write_figures(new)
            finally:
                if show is not None:
                    show(written)
        return written

    @property
    def found(self) -> Found | FoundOnSignals:
        """The fits behind it; raises InputError where it was loaded."""
        if self.fits is None:
            raise InputError(
                "A discovery that was loaded holds no fits.", where=self.document.name,
                next_step="Identify the augmented case that it has written: case_augmented.yaml.",
            )  # fmt: skip
        return self.fits

    @property
    def answer(self) -> Answer:
        """``nothing``, ``named``, ``undecided``, ``named_with_remainder``, ``unknown``, ``disagreement`` or
        ``unfinished``."""
        return self.document.answer

    @property
    def verdict(self) -> Verdict:
        """Whether it may be used: ``valid``, ``doubtful`` or ``not_settled``."""
        return self.document.verdict

    @property
    def reasons(self) -> list[DiagnosticResult]:
        """Why it is not valid, the most important first."""
        return self.document.reasons

    @property
    def exit_code(self) -> int:
        """The exit code of the command line."""
        return EXIT_CODES[self.verdict]

    @property
    def text(self) -> str:
        """The answer in words."""
        return self.document.text

    @property
    def findings(self) -> list[FindingResult]:
        """The effects that were named, in the order in which they were added."""
        return self.document.findings

    @property
    def roles(self) -> Mapping[str, Role]:
        """Label of each experiment -> ``estimation`` or ``validation``."""
        return self.document.roles

    @property
    def gap(self) -> Mapping[str, GapPair]:
        """Label of each experiment -> gap of base and final model in times the noise."""
        return self.document.gap

    @property
    def ratio_interval(self) -> tuple[float | None, float | None] | None:
        """95 % interval of the RMS of the final model over that of the base model on held-out data; None without."""
        return self.document.ratio_interval

    @property
    def error_percent(self) -> Mapping[str, tuple[float | None, float | None]]:
        """Label of each experiment -> relative torque error of base and final model in percent."""
        return self.document.error_percent

    @property
    def base_parameters(self) -> list[ValueFound]:
        """The parameters of the base model in the final fit."""
        return self.document.base_parameters

    @property
    def base_fit(self) -> list[ValueFound]:
        """The same parameters in the fit without the effects."""
        return self.document.base_fit

    @property
    def friction(self) -> list[FrictionResult]:
        """The friction of the joints where an effect was found that depends on their velocity alone."""
        return self.document.friction

    @property
    def curves(self) -> list[CurveResult]:
        """The form of what is missing and has no name, on each joint where a curve of one variable explains it."""
        return self.document.curves

    @property
    def candidates(self) -> list[CandidateResult]:
        """The shortlisted candidates of each round and their outcomes."""
        return self.document.candidates

    @property
    def noise(self) -> NoiseResult:
        """The noise of the torque logs."""
        return self.document.noise

    @property
    def regions(self) -> list[RegionResult]:
        """Where the residual of the base model has a mean of its own."""
        return self.document.regions

    @property
    def windows(self) -> list[WindowResult]:
        """Intervals of time with a torque from outside, or in which an output of a model alone is off."""
        return self.document.windows

    @property
    def refused(self) -> list[tuple[str, int, str]]:
        """Effect, joint, and why it was not accepted."""
        return self.document.refused

    @property
    def notes(self) -> list[str]:
        """Remarks on the data and on the search."""
        return self.document.notes

    @property
    def files(self) -> Mapping[str, str]:
        """Files beside ``findings.json``; empty without an output folder."""
        return self.document.files

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Versions, options, digests of the inputs."""
        return self.document.provenance

    @property
    def model(self) -> LoopModel:
        """The loop with the effects found and the fitted values as start values; raises InputError where loaded."""
        final = self.found.discovery.final
        return final.model.with_values(final.values)

    def summary(self) -> str:
        """The table that the terminal shows: verdict, findings and gaps, at most 100 columns."""
        from fmu_didim.report.discovery.sections import discovery_table

        return discovery_table(self.document)

    def to_frame(self) -> DataFrame:
        """A data frame with one row a parameter of each effect found; no rows where nothing was found.

        Columns ``effect``, ``joint``, ``parameter``, ``value``, ``std``, ``low`` and ``high`` (95 % interval) in
        ``unit``, ``share_of_gap``, ``delta_bic``, ``ambiguous`` (what these data cannot tell from it).
        """
        return findings_frame(self.document)

    def plot(self, experiment: str | None = None) -> Figure:
        """A Matplotlib figure of measured torque against that of base and final model, joint by joint.

        Args:
            experiment: label; the first one by default.

        Raises:
            UnknownNameError: there is no such experiment; SimulationError: a model cannot be simulated on it;
                InputError: it was loaded without its signals.
        """
        from fmu_didim.report.drawing.figures import matplotlib_figure
        from fmu_didim.report.drawing.torque_charts import torque_chart

        label = experiment or next(iter(self.roles))
        if label not in self.roles:
            raise UnknownNameError("experiment", label, self.roles, where=self.document.name)
        names = {"base": "base model", **({"final": "final model"} if self.findings else {})}
        time, measured, models = (self._saved if self.fits is None else self._simulated)(label, names)
        return matplotlib_figure(
            torque_chart(
                "torque", label, time, measured, models, self.document.torque_unit, names=self.document.outputs
            )
        )  # fmt: skip

    def _simulated(self, label: str, names: Mapping[str, str]) -> Torques:
        from fmu_didim.report.drawing.torque_charts import Simulated

        model = self.found.discovery.final.model
        models = {}
        for name, title in names.items():
            run = getattr(self.found.discovery, name).simulation(label)
            every = simulated_table(run).first(model.joint_count)
            models[title] = Simulated(run.torque(), every.time, every.values)
        return model.experiments[label].time, model.experiments.measured_in(label), models

    def _saved(self, label: str, names: Mapping[str, str]) -> Torques:
        from fmu_didim.report.drawing.torque_charts import Simulated

        folder, joints = self.folder or Path(), range(1, len(self.document.torque_unit) + 1)
        samples, every = (
            read_trajectory(folder / self.files.get(f"{kind}_{label}", f"{kind}_{label}.csv"))
            for kind in ("signals", "simulated")
        )
        tables = {name: [table.select([f"{name}{j}" for j in joints]) for table in (samples, every)] for name in names}
        models = {names[name]: Simulated(at, every.time, all_) for name, (at, all_) in tables.items()}
        return samples.time, samples.select([f"measured{j}" for j in joints]), models

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Discovered):
            return NotImplemented
        one, another = (found.document.model_dump(exclude=_ADDED) for found in (self, other))
        return one == another

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        effects = ", ".join(
            f"{finding.effect} {finding.signal or finding.joint}".removesuffix(" 0") for finding in self.findings
        )
        return f"Discovered({self.document.name!r}, {self.answer}" + (f": {effects})" if effects else ")")

    def _repr_html_(self) -> str:
        """For notebooks: verdict, findings and gaps."""
        from fmu_didim.report.discovery.sections import discovery_html

        return discovery_html(self.document)
