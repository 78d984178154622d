"""The result of an identification: parameters, validation, and views of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fmu_didim.base.errors import FmuDidimError, InputError, UnknownNameError
from fmu_didim.base.files import is_file
from fmu_didim.checks.judgement import DiagnosticResult, Verdict
from fmu_didim.checks.validation import Validation
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.dynamics.robot import RobotDescription, read_robot, write_robot
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.workers import Beside, default_workers
from fmu_didim.results.result import (
    REPORT_FILE,
    RESULT_FILE,
    ParameterResult,
    ResultDocument,
    read_result,
    read_validations,
    result_path,
    save_result,
)
from fmu_didim.workflow.output.exit_codes import EXIT_CODES
from fmu_didim.workflow.output.frames import matrix_frame, parameter_frame
from fmu_didim.workflow.output.result_folder import ResultFolder
from fmu_didim.workflow.output.values import OWN_SSV_FILE, SSV_FILE, VALUES_FILE, write_values

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

ROBOT_FILE = "robot_identified.yaml"
OWN_ROBOT_FILE = "robot_identified_{label}.yaml"
ESSENTIAL_ROBOT_FILE = "robot_essential.yaml"
"""The robot description with the identified values: from it come the FMU (``fmu-didim export``) and the model."""
SHARED = ""
"""Stands for the robot of all experiments among those of each."""


def result_folder(out: Path | str, *, figures: bool = False) -> ResultFolder:
    """The folder of the results of ``identify``."""
    patterns = (
        OWN_ROBOT_FILE.format(label="*"),
        "torque_*.csv",
        "output_*.csv",
        "simulated_*.csv",
        "channel_*.csv",
        "figure_*",
        OWN_SSV_FILE.format(label="*"),
    )
    fixed = (REPORT_FILE, ROBOT_FILE, ESSENTIAL_ROBOT_FILE, SSV_FILE, VALUES_FILE)
    return ResultFolder(Path(out), "identify", RESULT_FILE, fixed, patterns, "signals", figures)


@dataclass(frozen=True, repr=False, eq=False)
class Result:
    """The result of :func:`~fmu_didim.identify`, which :meth:`load` reads from a folder.

    Two results are equal if their documents and their torques are.

    Attributes:
        document: the content of ``result.json``.
        validations: of each experiment that could be simulated, fitted or held out, in the order of the case; also of
            the others in the session that identified it.
        described: label of an experiment with base parameters of its own, and ``""`` for all others -> the robot with
            its identified values, or why its description cannot be read.
        fitted: the estimate with its arrays; None of a result that was loaded.
        reduced: the robot of the reduced model, or why its description cannot be read; None where it was not asked for,
            or nothing is left out.
    """

    document: ResultDocument
    validations: tuple[Validation, ...]
    described: Mapping[str, RobotDescription | FmuDidimError] = field(default_factory=dict)
    fitted: Estimate | None = None
    reduced: RobotDescription | FmuDidimError | None = None

    @classmethod
    def of(cls, document: ResultDocument, estimate: Estimate, validations: Sequence[Validation]) -> Result:
        """The result of an estimate and its validations."""
        model = estimate.model
        values = {SHARED: estimate.base_value}
        values |= {
            label: model.theta(model.start, label)
            for label in model.experiments
            if model.free_parameters.has_own_base(label)
        }
        robots = {label: model.parameters.described(theta) for label, theta in values.items()}
        found = {label: robot for label, robot in robots.items() if robot is not None}
        reduced = None
        if estimate.essential is not None and (less := estimate.essential.model) is not None:
            reduced = less.parameters.described(less.start[: less.parameters.count])
        return cls(document, tuple(validations), found, estimate, reduced)

    @classmethod
    def load(cls, path: Path | str) -> Result:
        """The result that was saved in a folder.

        Args:
            path: the folder, or its ``result.json``.

        Raises:
            InputError: there is no result, it is of another version, or a table of its torques is damaged.
        """
        document, folder = read_result(path), result_path(path).parent
        files = {SHARED: ROBOT_FILE} | {label: OWN_ROBOT_FILE.format(label=label) for label in document.experiments}
        described = {label: _described(folder / name) for label, name in files.items() if is_file(folder / name)}
        essential = folder / ESSENTIAL_ROBOT_FILE
        reduced = _described(essential) if document.essential is not None and is_file(essential) else None
        return cls(document, read_validations(document, folder), described, reduced=reduced)

    def save(self, folder: Path | str, *, figures: bool = False) -> Path:
        """Write ``result.json``, the torque tables, ``report.html`` and the robot descriptions to a folder.

        They replace all that an earlier result left there, or nothing of it.

        Args:
            figures: whether each chart of the page is written, too, as PNG and SVG (``figure_*``).

        Returns:
            The path of ``result.json``.

        Raises:
            InputError: they cannot be written, or torques are missing in a result that was loaded without them.
        """
        place = result_folder(folder, figures=figures)
        place.check()
        with self.page_beside() as page:
            self.write(place, page)
        return place.folder / RESULT_FILE

    def page_beside(self) -> Beside[str]:
        """The text of ``report.html``, which a copy of this process makes beside what comes first, where it can."""
        from fmu_didim.report import result_page

        return Beside(partial(result_page, self.document, self.validations), default_workers(), at_once=False)

    def write(self, folder: ResultFolder, page: Beside[str]) -> None:
        """As :meth:`save`, to a folder that was checked before; ``page``: :meth:`page_beside`."""
        for label in self.document.signals:
            self.validation(label)
        with folder.written() as new:
            save_result(self.document, self.validations, new)
            write_values(self.document, new)
            for label, robot in ((SHARED, self.robot), *self.robots.items()):
                if robot is not None:
                    write_robot(robot, new / (OWN_ROBOT_FILE.format(label=label) if label else ROBOT_FILE))
            if self.essential_robot is not None:
                write_robot(self.essential_robot, new / ESSENTIAL_ROBOT_FILE)
            (new / REPORT_FILE).write_text(page.result(), encoding="utf-8")
            if folder.figures:
                from fmu_didim.report.paper import write_figures

                write_figures(new)

    @property
    def estimate(self) -> Estimate:
        """The estimate with its arrays; raises InputError for a result that was loaded."""
        if self.fitted is None:
            raise InputError(
                "A result that was loaded holds no loop and no fit.", where=self.document.name,
                next_step="Simulate with simulate(case, parameters=result.values), or go on from it with "
                "identify(case, start=result).",
            )  # fmt: skip
        return self.fitted

    @property
    def model(self) -> LoopModel:
        """The loop with the identified values as start values; raises InputError for a result that was loaded."""
        return self.estimate.model

    @property
    def parameters(self) -> Mapping[str, ParameterResult]:
        """Name of each parameter -> value, standard deviation, 95 % interval, unit."""
        return self.document.parameters

    @property
    def values(self) -> Mapping[str, float]:
        """Name of each parameter -> value; :func:`~fmu_didim.simulate` takes them as ``parameters``."""
        return {name: p.value for name, p in self.document.parameters.items()}

    @property
    def converged(self) -> bool:
        """Whether the iterations settled."""
        return self.document.status == "converged"

    @property
    def verdict(self) -> Verdict:
        """Whether the values may be used: ``valid``, ``doubtful``, ``not_settled`` or ``refused``."""
        return self.document.verdict

    @property
    def reasons(self) -> list[DiagnosticResult]:
        """Why they are not valid, the most important first."""
        return self.document.reasons

    @property
    def exit_code(self) -> int:
        """The exit code of the command line."""
        return EXIT_CODES[self.verdict]

    @property
    def robot(self) -> RobotDescription | None:
        """The robot description with the identified values that all experiments share; None without a robot.

        Raises:
            InputError: the description of a loaded result cannot be read.
        """
        return self._robot(SHARED)

    @property
    def robots(self) -> Mapping[str, RobotDescription]:
        """Label of each experiment with base parameters of its own -> the robot as it was there, as with a payload."""
        found = {label: self._robot(label) for label in self.described if label}
        return {label: robot for label, robot in found.items() if robot is not None}

    @property
    def essential_robot(self) -> RobotDescription | None:
        """The robot of the reduced model, whose other base parameters are zero; None where it was not asked for, or
        nothing is left out.

        Raises:
            InputError: the description of a loaded result cannot be read.
        """
        return _readable(self.reduced)

    def _robot(self, label: str) -> RobotDescription | None:
        return _readable(self.described.get(label))

    @property
    def outside_robot(self) -> tuple[str, ...]:
        """Names of the identified values that no robot description holds: of the loop around the plant, or of a log."""
        return tuple(
            name for name, parameter in self.document.parameters.items() if parameter.of not in ("plant", "model")
        )

    @property
    def covariance(self) -> DataFrame:
        """Covariance of the values in their units, labelled by parameter; raises InputError if not saved."""
        return matrix_frame(self.document)

    @property
    def correlation(self) -> DataFrame:
        """Correlation of the values, labelled by parameter; raises InputError if not saved."""
        found = matrix_frame(self.document)
        deviation = np.sqrt(np.diag(found))
        return found / np.outer(deviation, deviation)

    def validation(self, experiment: str) -> Validation:
        """Measured and simulated torque of an experiment.

        Raises:
            UnknownNameError: there is no such experiment; InputError: it was loaded without its torques.
        """
        found = {v.label: v for v in self.validations}
        if experiment in found:
            return found[experiment]
        if experiment not in self.document.experiments:
            raise UnknownNameError("experiment", experiment, self.document.experiments, where=self.document.name)
        failed = self.document.experiments[experiment].failure
        raise InputError(
            "The result was loaded without the torques of this experiment.", where=experiment,
            got=failed or f"no {self.document.signals.get(experiment, 'table')} beside result.json",
            next_step="It could not be simulated." if failed else "Copy the whole folder of the result.",
        )  # fmt: skip

    def summary(self) -> str:
        """The table that the terminal shows: parameters, experiments, errors and the verdict, at most 100 columns."""
        from fmu_didim.report import result_table

        return result_table(self.document)

    def to_frame(self) -> DataFrame:
        """A data frame of the parameters, indexed by their names.

        Columns ``value``, ``std``, ``low`` and ``high`` (95 % interval) in ``unit``, ``rel_std_percent``, ``of`` (which
        part of the loop) and ``experiment`` (whose own it is, or empty).
        """
        return parameter_frame(self.document)

    def plot(self, experiment: str | None = None) -> Figure:
        """A Matplotlib figure of measured and simulated torque with the residual, joint by joint.

        Args:
            experiment: label; the first one by default.

        Raises:
            UnknownNameError: there is no such experiment; InputError: it was loaded without its torques.
        """
        from fmu_didim.report.drawing.figures import matplotlib_figure
        from fmu_didim.report.drawing.torque_charts import DrawnInput, Simulated, torque_chart

        shown = self.validation(experiment or next(iter(self.document.experiments)))
        every = (None, None) if shown.every is None else (shown.every.time, shown.every.values)
        models = {} if shown.failure else {"simulated": Simulated(shown.simulated, *every)}
        percent = [float(v) if np.isfinite(v) else None for v in shown.per_joint_percent]
        units = self.document.torque_unit
        names, inputs = self.document.outputs, list[DrawnInput]()
        if shown.every is not None:
            known = {name: unit for name, unit in self.document.inputs.items() if name in shown.every.names}
            inputs = [DrawnInput(n, unit, shown.every.time, shown.every.column(n)) for n, unit in known.items()]
        chart = torque_chart(
            self.document.quantity, shown.label, shown.time, shown.measured, models, units, percent=percent,
            names=names, inputs=inputs,
        )  # fmt: skip
        return matplotlib_figure(chart)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Result):
            return NotImplemented
        mine, theirs = ({v.label: v for v in r.validations if not v.failure} for r in (self, other))
        alike = self.document == other.document and list(mine) == list(theirs)
        return alike and all(_same(v, theirs[label]) for label, v in mine.items())

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Result({self.document.name!r}, {self.verdict}, {len(self.parameters)} parameters)"

    def _repr_html_(self) -> str:
        """For notebooks: verdict, parameters and experiments."""
        from fmu_didim.report.identification.sections import result_html

        return result_html(self.document)


def _described(path: Path) -> RobotDescription | FmuDidimError:
    """The robot in a file, or why it cannot be read: an effect, say, that only the session had that saved it."""
    try:
        return read_robot(path)
    except FmuDidimError as error:
        return error


def _readable(found: RobotDescription | FmuDidimError | None) -> RobotDescription | None:
    if isinstance(found, FmuDidimError):
        raise found
    return found


def _same(one: Validation, other: Validation) -> bool:
    """Whether two validations hold the same torques and motion, to the last bit."""
    names = ("time", "measured", "simulated")
    pairs = [(getattr(one, name), getattr(other, name)) for name in names]
    pairs += [(values, other.motion.get(name)) for name, values in one.motion.items()]
    pairs += list(zip(_parts(one.every), _parts(other.every), strict=True))
    return set(one.motion) == set(other.motion) and all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def _parts(every: Trajectory | None) -> tuple[Array, Array]:
    return (np.zeros(0), np.zeros(0)) if every is None else (every.time, every.values)


def load_result(path: Path | str) -> Result:
    """The result that was saved in a folder, or in its ``result.json``: :meth:`Result.load`."""
    return Result.load(path)
