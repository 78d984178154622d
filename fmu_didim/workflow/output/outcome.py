"""What ``identify`` returns: the estimate, its validation, and views of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fmu_didim.base.errors import UnknownNameError
from fmu_didim.checks.judgement import DiagnosticResult, Verdict
from fmu_didim.checks.validation import Validation
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.results.result import ParameterResult, ResultDocument
from fmu_didim.workflow.output.exit_codes import EXIT_CODES
from fmu_didim.workflow.output.frames import parameter_frame

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame


@dataclass(frozen=True, repr=False)
class Outcome:
    """What :func:`~fmu_didim.identify` returns.

    Attributes:
        document: the content of ``result.json``.
        estimate: the estimate with its arrays.
        validations: of each experiment, fitted or held out, in the order of the case.
    """

    document: ResultDocument
    estimate: Estimate
    validations: tuple[Validation, ...]

    @property
    def model(self) -> LoopModel:
        """The loop with the identified values as start values, for simulations and further fits."""
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
        """Why they are not valid, the weightiest first."""
        return self.document.reasons

    @property
    def exit_code(self) -> int:
        """What the command line ends with."""
        return EXIT_CODES[self.verdict]

    @property
    def robot(self) -> RobotDescription | None:
        """The robot description with the identified values that all experiments share; None without a robot."""
        return self.model.parameters.described(self.estimate.base_value)

    @property
    def robots(self) -> Mapping[str, RobotDescription]:
        """Label of each experiment with base parameters of its own -> the robot as it was there, as with a payload."""
        labels = [label for label in self.model.experiments if self.model.has_own_base(label)]
        found = {label: self.model.parameters.described(self.model.theta(self.model.start, label)) for label in labels}
        return {label: robot for label, robot in found.items() if robot is not None}

    @property
    def outside_robot(self) -> tuple[str, ...]:
        """Names of the identified values that no robot description holds: of the loop around the plant, or of a log."""
        return tuple(name for name, parameter in self.document.parameters.items() if parameter.of != "plant")

    def validation(self, experiment: str) -> Validation:
        """Measured and simulated torque of an experiment; raises UnknownNameError."""
        found = {v.label: v for v in self.validations}
        if experiment not in found:
            raise UnknownNameError("experiment", experiment, found, where=self.document.name)
        return found[experiment]

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
            UnknownNameError: there is no such experiment.
        """
        from fmu_didim.report.drawing.figures import matplotlib_figure
        from fmu_didim.report.drawing.torque_charts import Simulated, torque_chart

        shown = self.validation(experiment or self.model.first)
        every = (None, None) if shown.every is None else (shown.every.time, shown.every.values)
        models = {} if shown.failure else {"simulated": Simulated(shown.simulated, *every)}
        percent = [float(v) if np.isfinite(v) else None for v in shown.per_joint_percent]
        units = self.document.torque_unit
        chart = torque_chart("torque", shown.label, shown.time, shown.measured, models, units, percent=percent)
        return matplotlib_figure(chart)

    def __repr__(self) -> str:
        return f"Outcome({self.document.name!r}, {self.verdict}, {len(self.parameters)} parameters)"

    def _repr_html_(self) -> str:
        """For notebooks: verdict, parameters and experiments."""
        from fmu_didim.report.identification.sections import result_html

        return result_html(self.document)
