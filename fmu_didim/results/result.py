"""The saved result of an identification: ``result.json`` and the torque tables beside it.

The models of this module are the schema of the file (``result_schema()`` gives it as JSON Schema);
``schema_version`` rises when a field changes its meaning or goes away.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, ValidationError, model_serializer

from fmu_didim.base.documents import Number, Saved, why_unread
from fmu_didim.base.errors import InputError
from fmu_didim.base.files import is_file
from fmu_didim.checks.agreement import AgreementResult
from fmu_didim.checks.judgement import RESTS_ON, AcknowledgedResult, DiagnosticResult, Verdict
from fmu_didim.checks.plant.consistency import ColumnResult
from fmu_didim.checks.power.statement import EXCLUDES, PowerResult
from fmu_didim.checks.residual import NoiseResult
from fmu_didim.checks.validation import ChannelValidation, Validation
from fmu_didim.data.signals import Trajectory, trajectory, write_csv
from fmu_didim.data.tables import read_table
from fmu_didim.results.searches import EssentialResult, LocalSensitivityResult, ProfileResult, SearchResult

RESULT_FILE, REPORT_FILE = "result.json", "report.html"
ALL_DIGITS = 17
"""Digits of the torque tables, from which a loaded result has the same numbers to the last bit."""


class ParameterResult(Saved):
    """One identified parameter."""

    value: float = Field(description="estimate, in the unit")
    std: float = Field(description="standard deviation, in the unit")
    rel_std_percent: Number = Field(description="100 std / |value|; null if the value is zero")
    interval: tuple[float, float] = Field(description="95 % confidence interval")
    unit: str = Field(description="FMI unit string")
    standard: str = Field(description="parameter of the plant that carries it; empty for parameters of the loop")
    of: str = Field(default="plant", description="plant, delay, log, or the name of another component; model")
    experiment: str | None = Field(default=None, description="label of the experiment whose own it is; null: of all")
    described: Number = Field(
        default=None, description="value of the robot description, such as from CAD, regrouped likewise; null without"
    )


class DisplayResult(Saved):
    """A unit in which a tool shows the values of another one (FMI: ``DisplayUnit``).

    Attributes:
        name: such as degF; factor, offset: value there = factor * value + offset.
    """

    name: str
    factor: float
    offset: float


class UnconstrainedResult(Saved):
    """A value that was refused."""

    value: float = Field(description="where the iterations led, in the unit")
    std: Number = Field(description="standard deviation; null where that is no minimum")
    unit: str = Field(description="FMI unit string")


class StageResult(Saved):
    """Values at the end of a stage, by parameter.

    Attributes:
        value: name of each parameter -> estimate; std: its standard deviation, in the same unit.
    """

    value: dict[str, float]
    std: dict[str, float]
    formulas: dict[str, dict[str, float]] = Field(description="standard deviations by other formulas")


class ErrorResult(Saved):
    """Relative torque error 100 |y - y_s| / |y|; of the outputs of a model 100 |y - y_s| / |y - mean(y)|.

    Attributes:
        total: over all joints, in percent; per_joint: of each joint, or output, in percent.
    """

    total: Number
    per_joint: list[Number]


class IterationResult(Saved):
    """One iteration.

    Attributes:
        stage: ``didim`` or ``finish``, or that of another estimator; number: within the stage, from 1.
        relative_error_percent: of the simulated torque; null where it could not be simulated.
        change: of the values in this step, relative to them.
        condition_number: of the scaled regressor or sensitivity.
        parameters: values that were simulated.
        note: a remark on it, or empty.
        restarts: whether the estimator began anew after it, from another start.
    """

    stage: str
    number: int
    relative_error_percent: Number
    change: Number
    condition_number: Number
    parameters: dict[str, Number]
    note: str
    restarts: bool = False


class ConsistencyResult(Saved):
    """Whether a plant of its own agrees with the robot description.

    Attributes:
        agrees: whether all differences are within the errors of rounding and probing.
        acceleration: where the accelerations of the plant come from.
        warnings: the differences, in words.
    """

    agrees: bool
    worst: Number = Field(description="largest of all relative differences")
    points: int = Field(description="instants compared")
    torque_difference: list[float] = Field(description="relative, per joint")
    columns: dict[str, ColumnResult] = Field(description="of the parameters that the motion excites")
    method: str = Field(description="how the plant's columns were found")
    acceleration: Literal["output of the plant", "difference of velocities"]
    warnings: list[str]


class InitialStateResult(Saved):
    """Where an experiment starts.

    Attributes:
        kind: ``reference``: on its reference, controllers as they are built; ``free``: by parameters of its own;
            ``given``: by the case; ``found``: by the first part of a held-out log;
            ``model``: in the state of a model alone.
        values: those that are held, by their names (``q1``, ``integral1``), in SI units.
    """

    kind: Literal["reference", "free", "given", "found", "model"] = "reference"
    values: dict[str, float] = Field(default_factory=dict)


class ChannelErrorResult(Saved):
    """A signal that was measured beside the torque in an experiment, and as simulated there.

    Attributes:
        unit: SI; samples: its instants.
        rms: root mean square of measured minus simulated.
    """

    unit: str
    samples: int
    rms: Number
    relative_error_percent: Number = Field(
        description="100 |y - y_s| / |y - mean(y)|, of what the signal moves; null where it rests"
    )
    std: Number = Field(default=None, description="of its noise as the case states it; null where it does not")
    file: str = Field(description="CSV file with the signal, measured and simulated")


class ExperimentResult(Saved):
    """One experiment.

    Attributes:
        role: whether the parameters were fitted to it, or only validated by it.
        samples: instants of its torque log.
        relative_error_percent: of its simulated torque.
    """

    role: Literal["estimation", "validation"]
    samples: int
    rate_hz: float = Field(description="of the torque log")
    noise_std: list[Number] = Field(description="standard deviation of its torque residual, per joint")
    relative_error_percent: ErrorResult
    own: list[str] = Field(description="parameters that have values of their own in it")
    agreement: AgreementResult | None = Field(description="null where fewer than two experiments are fitted")
    failure: str = Field(default="", description="why it could not be simulated")
    initial_state: InitialStateResult = Field(default=InitialStateResult(), description="where it starts")
    channels: dict[str, ChannelErrorResult] = Field(
        default={}, description="name of each signal that was measured beside the torque -> its error"
    )


class IntegrationResult(Saved):
    """How the plant was integrated."""

    method: str = Field(description="RK4, or the linearly implicit midpoint rule")
    substeps: int = Field(description="in a communication step")


class ChannelResult(Saved):
    """A signal that was fitted beside the torque.

    Attributes:
        unit: SI, also of the deviations and errors.
        samples: in all fitted experiments; noise_std: standard deviation of its noise; noise_is_stated: by the case.
        rms: root mean square of the residual; correlation: of its neighbouring samples.
        inflation: of standard deviations that come from it, over those of white noise.
    """

    unit: str
    samples: int
    noise_std: Number
    noise_is_stated: bool
    rms: Number
    correlation: Number
    inflation: Number


class JointResult(Saved):
    """Torque and further signals fitted together, beside the torque alone.

    Attributes:
        channels: name of each signal -> what it leaves.
        alone: the answer of the torque alone; null in an open loop, where the torque is given.
        apart: name of each parameter -> joint minus that value, in standard deviations of the difference.
        p_value: of differences as large by noise alone, over all parameters.
    """

    channels: dict[str, ChannelResult]
    alone: StageResult | None
    apart: dict[str, Number]
    p_value: Number


class PriorParameterResult(Saved):
    """What of a value comes from a prior, and what from the data."""

    data_share: float = Field(description="part of its variance that comes from the noise of the data, 0 to 1")
    prior: Number = Field(description="mean of the prior, in the unit; null where there is none")
    prior_std: Number = Field(description="standard deviation of the prior")
    alone: Number = Field(
        description="value by the data alone, one step from the answer and without limits; null where they have none"
    )
    alone_std: Number = Field(description="its standard deviation")
    apart: Number = Field(description="value minus prior, in standard deviations of that difference")


class PriorResult(Saved):
    """A prior beside the data.

    Attributes:
        source: where it comes from.
        parameters: name of each -> what of it comes from where.
    """

    source: str
    parameters: dict[str, PriorParameterResult]
    p_value: Number = Field(description="of data and prior as far apart by chance, over all that both know")
    tested: int = Field(description="directions of the parameters that both know")


class ChoicesResult(Saved):
    """What other choices of a virtual controller do to the values; their variances contain a third of each square.

    Attributes:
        chosen: what was chosen, in words.
        noise_std: name of each parameter -> standard deviation as if the choice was right.
        shifts: another choice, in words -> name of each parameter -> by how much it moves.
        failed: other choices with which the loop cannot be simulated, and why.
    """

    chosen: str
    noise_std: dict[str, Number]
    shifts: dict[str, dict[str, Number]]
    failed: dict[str, str]


class QuantityResult(Saved):
    """A quantity of a load.

    Attributes:
        value: in the unit; std: its standard deviation, zero where the case states the quantity.
        unit: FMI unit string.
    """

    value: float
    std: float
    unit: str


class LoadResult(Saved):
    """What the last link carried in an experiment.

    Attributes:
        body: ``mass``, centre of mass ``cx``, ``cy``, ``cz`` in the frame of the last link, and the inertia about that
            centre, ``Ixx``, ..., axes as those of that frame: all that is known or that the data show.
        unseen: inertial parameters that move no torque of this robot, whatever its motion.
        also: labels of other experiments with this load.
    """

    body: dict[str, QuantityResult]
    unseen: list[str]
    also: list[str]


class LinkResult(Saved):
    """A link of the robot, in modified Denavit-Hartenberg convention."""

    type: Literal["revolute", "prismatic"] = Field(description="of the joint whose position moves it")
    alpha: float = Field(description="rad")
    a: float = Field(description="m")
    theta: float = Field(description="rad")
    d: float = Field(description="m")
    beta: float = Field(0.0, description="rad, of axes that are nearly parallel")


class GeometryResult(Saved):
    """The geometry of the robot, as the page draws it."""

    links: list[LinkResult] = Field(description="of its joints, from the base on")
    gravity: tuple[float, float, float] = Field(description="in the base frame, m/s2")


class ResultDocument(Saved):
    """The content of ``result.json``.

    Attributes:
        name, description: of the case.
        advice: the next step where the iterations did not converge, else how they ended.
        estimator: its name in the case.
        parameters: name of each -> its result; empty where the result is refused.
        stages: name of each stage -> values at its end.
        condition_number: of the sensitivity with scaled columns, at the end.
        history: iterations, in their order.
        loop: components, wiring, rate, order and delay of the loop that was simulated.
        remarks: that do not affect the verdict.
        provenance: versions, digests of all files and code that were read, options, thresholds and time.
    """

    schema_version: Literal[3] = 3
    name: str
    description: str = ""
    verdict: Verdict = Field(description="whether the values may be used")
    reasons: list[DiagnosticResult] = Field(description="why the verdict is not valid, the most important first")
    acknowledged: list[AcknowledgedResult] = Field(
        default=[], description="doubts that the case acknowledges: they are no reasons"
    )
    conditions: list[str] = Field(default=[], description=RESTS_ON)
    status: Literal["converged", "maximum_iterations", "refused"] = Field(description="how the iterations ended")
    advice: str
    estimator: str
    iterations: int = Field(description="iterations of the main stage")
    finish_iterations: int = Field(description="iterations of the efficient finish")
    parameters: dict[str, ParameterResult]
    unconstrained: dict[str, UnconstrainedResult] = Field(
        default={}, description="of a refused result: values that may be unphysical, no answer"
    )
    stages: dict[str, StageResult]
    joint: JointResult | None = Field(default=None, description="null where the torque alone was fitted")
    prior: PriorResult | None = Field(default=None, description="null where the case has none")
    choices: ChoicesResult | None = Field(
        default=None, description="of a virtual controller; null where the controller is that of the machine"
    )
    loads: dict[str, LoadResult] = Field(default={}, description="label of an experiment -> what it carried")
    search: SearchResult | None = Field(default=None, description="other minima; null where there was one start")
    profiles: dict[str, ProfileResult] = Field(default={}, description="of the parameters for which they were asked")
    essential: EssentialResult | None = Field(default=None, description="null where it was not asked for")
    sensitivity: LocalSensitivityResult | None = Field(
        default=None, description="what each parameter does to the outputs; null where that is not known"
    )
    regrouping: list[str] = Field(description="relations such as ZZ1R = ZZ1 + Ia1")
    correlations: list[tuple[str, str, float]] = Field(description="pairs with |correlation| > 0.9")
    correlation: list[list[Number]] = Field(default=[], description="of all parameters, in their order")
    covariance: list[list[Number]] = Field(default=[], description="of all parameters, in their order and units")
    condition_number: Number
    noise_std: list[Number] = Field(
        description="standard deviation of the torque residual of all fitted experiments, per joint"
    )
    noise: list[NoiseResult] = Field(default=[], description="by rate and joint, with its colour")
    torque_unit: list[str] = Field(description="per joint, or output")
    outputs: list[str] = Field(
        default=[], description="of a model without controller: names of the outputs that stand in the place of the "
        "torques of joints, in the same order; absent where the torque was measured"
    )  # fmt: skip
    inputs: dict[str, str] = Field(default={}, description="name of each input of such a model -> its unit")
    displays: dict[str, DisplayResult] = Field(
        default={}, description="name of a parameter, an output or an input of such a model -> unit in which its tool "
        "shows it, as pages do",
    )  # fmt: skip
    power: PowerResult | None = Field(default=None, description=EXCLUDES)
    experiments: dict[str, ExperimentResult] = Field(description="by label")
    relative_error_percent: dict[str, ErrorResult] = Field(description="by label of the experiment")
    fitted_error_percent: ErrorResult | None = Field(
        default=None, description="of all fitted experiments together; null where no values are given"
    )
    integration_error: Number = Field(description="relative change of the torque when the substeps are doubled")
    integration_shift: Number = Field(
        default=None, description="largest move of a value then, in its standard deviations; null if not tried"
    )
    integration: IntegrationResult | None = Field(
        default=None, description="of the plant; null where its equations are not known"
    )
    history: list[IterationResult]
    loop: dict[str, Any]
    geometry: GeometryResult | None = Field(default=None, description="null without a robot description")
    signals: dict[str, str] = Field(description="label -> CSV file with measured and simulated torque")
    simulated: dict[str, str] = Field(
        default={}, description="label -> CSV file with the simulated torque of every control period"
    )
    checks: list[str] = Field(default=[], description="properties for which the values have been checked")
    remarks: list[str]
    consistency: ConsistencyResult | None = Field(
        default=None, description="of plant and robot description; null where one is built from the other"
    )
    provenance: dict[str, Any]

    @model_serializer(mode="wrap")
    def _without_outputs_of_none(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Only the result of a model has outputs and inputs, and units of display."""
        found: dict[str, Any] = handler(self)
        return found if self.outputs else {k: v for k, v in found.items() if k not in ("outputs", "inputs", "displays")}

    @property
    def labels(self) -> list[str]:
        """What the columns of the log are called: ``joint 1``, ..., or the outputs of a model."""
        return self.outputs or [f"joint {j}" for j in range(1, len(self.torque_unit) + 1)]

    @property
    def quantity(self) -> str:
        """What was compared, in a word: the torque, or outputs of a model."""
        return "output" if self.outputs else "torque"

    @property
    def table_columns(self) -> list[tuple[str, str]]:
        """Names of the measured and the simulated column of each joint, or output, in the tables of ``signals``."""
        if self.outputs:
            return [(f"measured {name}", f"simulated {name}") for name in self.outputs]
        return [(f"tau_measured{j}", f"tau_simulated{j}") for j in range(1, len(self.torque_unit) + 1)]


def result_schema() -> dict[str, Any]:
    """JSON Schema of ``result.json``."""
    return ResultDocument.model_json_schema()


def saved_tables(document: ResultDocument, validations: Sequence[Validation]) -> dict[str, Trajectory]:
    """The tables that stand beside ``result.json``, by the names of their files."""
    found: dict[str, Trajectory] = {}
    for v in validations:
        if v.label in document.signals:
            names = list(enumerate(document.table_columns))
            columns = {measured: v.measured[:, j] for j, (measured, _) in names}
            columns |= {simulated: v.simulated[:, j] for j, (_, simulated) in names}
            columns |= v.motion
            found[document.signals[v.label]] = trajectory(np.asarray(v.time), columns)
        if v.label in document.simulated and v.every is not None:
            found[document.simulated[v.label]] = v.every
        for name, saved in document.experiments[v.label].channels.items() if v.channels else ():
            channel = v.channels[name]
            columns = {"measured": channel.measured, "simulated": channel.simulated}
            found[saved.file] = trajectory(np.asarray(channel.time), columns)
    return found


def save_result(document: ResultDocument, validations: Sequence[Validation], directory: Path) -> Path:
    """Write ``result.json`` and its tables; returns the path of the former."""
    directory.mkdir(parents=True, exist_ok=True)
    for file, table in saved_tables(document, validations).items():
        write_csv(table, directory / file, digits=ALL_DIGITS)
    path = directory / RESULT_FILE
    path.write_text(document.model_dump_json(indent=2) + "\n", encoding="utf-8")
    return path


def as_saved(document: ResultDocument) -> ResultDocument:
    """The document as it is read from its ``result.json``."""
    return ResultDocument.model_validate_json(document.model_dump_json())


def result_path(path: Path | str) -> Path:
    """The path of a ``result.json``, from itself or its folder."""
    path = Path(path)
    return path if path.suffix == ".json" else path / RESULT_FILE


def read_result(path: Path | str) -> ResultDocument:
    """Read ``result.json`` or that of a folder; raises InputError if it is missing or of another version."""
    path = result_path(path)
    if not is_file(path):
        raise InputError("There is no result.", where=str(path), next_step="Run fmu-didim identify first.")
    try:
        return ResultDocument.model_validate_json(path.read_text(encoding="utf-8"))
    except (ValidationError, UnicodeDecodeError) as error:
        raise InputError(
            "The result does not follow the schema of this version.", where=str(path),
            got=why_unread(error, ResultDocument), next_step="Run fmu-didim identify again.",
        ) from error  # fmt: skip


def read_validations(document: ResultDocument, directory: Path) -> tuple[Validation, ...]:
    """The torques that :func:`save_result` has written beside a result, as far as their tables exist.

    Raises:
        InputError: a table has other columns or is damaged.
    """
    found = []
    for label, name in document.signals.items():
        if not is_file(directory / name):
            continue
        table, pairs = _table(directory / name), document.table_columns
        measured, simulated = (table.select([pair[k] for pair in pairs]) for k in (0, 1))
        own = {name for pair in pairs for name in pair}
        motion = {name: table.column(name) for name in table.names if name not in own}
        errors, every = document.experiments[label].relative_error_percent, document.simulated.get(label, "")
        found.append(
            Validation(
                label, document.experiments[label].role, table.time, measured, simulated,
                _number(errors.total), np.array([_number(e) for e in errors.per_joint]),
                every=_table(directory / every) if every and is_file(directory / every) else None, motion=motion,
                channels=_channels(document.experiments[label], directory),
            )
        )  # fmt: skip
    return tuple(found)


def _channels(experiment: ExperimentResult, directory: Path) -> dict[str, ChannelValidation]:
    """What was measured beside the torque in an experiment, as far as its tables exist."""
    found = {}
    for name, saved in experiment.channels.items():
        if is_file(directory / saved.file):
            table = _table(directory / saved.file)
            measured, simulated = table.column("measured"), table.column("simulated")
            found[name] = ChannelValidation(saved.unit, table.time, measured, simulated, saved.std)
    return found


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _table(path: Path) -> Trajectory:
    """A table as :func:`write_csv` writes it, to the last bit."""
    columns = dict(read_table(path).columns)
    if "t" not in columns or len(columns) == 1:
        raise InputError(
            "This is no table of torques.", where=str(path), got=", ".join(columns), valid="t, ...",
            next_step="Give the folder of a run; if its files were changed, run it again.",
        )  # fmt: skip
    return trajectory(columns.pop("t"), columns)
