"""The entries of a case document for components, loop and data."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Mapping
from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, TypeAdapter, field_validator, model_validator

from fmu_didim.base.documents import AlsoWritten, Positive, Strict
from fmu_didim.base.errors import InputError
from fmu_didim.cosim.sampling import Kind, Window
from fmu_didim.cosim.system import LoopTreatment
from fmu_didim.data.excitation import AnyExcitation
from fmu_didim.data.tables import Column, CsvLayout, TimeColumn
from fmu_didim.data.tables.dates import dates_in
from fmu_didim.data.tables.motors import check_turns
from fmu_didim.export.versions import DEFAULT_VERSION, VERSIONS
from fmu_didim.model.experiment import Role
from fmu_didim.model.signals.error_model import ErrorModel

TRACKING = "tracking"
"""Kind of a controller that nobody knows."""


def _written(fmi: str) -> str:
    if fmi not in VERSIONS:
        raise ValueError(f"this FMI version cannot be exported; valid: {', '.join(VERSIONS)}")
    return fmi


class ComponentSource(Strict):
    """A plant or a controller.

    Attributes:
        kind: ``fmu``, ``model`` (CasADi, no FMU built) or ``control`` (python-control).
        source: a description (``.yaml``), an ``.fmu`` file, a Modelica file (``.mo``, run in model exchange), or
            ``module:name`` or ``path/to/file.py:name`` of a python-control system or of a function that returns one. A
            plant without source is the robot.
        model: name of the model in a Modelica file; that of the file by default.
        inputs, outputs: role in the loop (``q_ref1``, ``tau1``; for controller inputs also a sum such as
            ``q_ref1 - q1``) -> name in the component, where they differ.
        parameter_names: name here -> name in the component, where they differ: of the identified parameters
            (``Fv1``), and of what a plant starts from (``q_start1``, ``dq_start1``), which in an FMU may be the start
            value of a state.
        parameters: values that replace those of the source, by the component's own names.
        component: name of the plant in the system, where the case has ``system``.
        substeps: integration substeps in a control period; chosen by default: as many as the noise of the data asks
            for, elsewhere for six digits. An identification takes more than stated where so few would be unstable.
        initial_state: of a python-control system.
        fmi: version of the standard of an FMU that is built from a description.
        interface, solver: how an FMU is run; co-simulation by default, of a ``model:`` of another tool model exchange
            where it offers that; model exchange by ``rk4`` or ``cvode``.
        rate_hz: own communication rate, a whole multiple or divisor of that of the loop; the loop's by default.
        outputs_after_step: its outputs at an instant are those after the step that begins there, as of a controller
            FMU that computes its command in the step. By default they are those at the instant itself, and of an FMU of
            another tool in which reading them between inputs and step changes what follows, those after the last step
            where none that is used follows the inputs at once; ``false``: they are read there all the same.
        isolated, time_limit_s: whether an FMU runs in a process of its own, by default until it has run and ended
            without fault; and for how long a call may take there.
        rerun: how an FMU is run again; by default as a trial shows to be right.
        event_mode: whether the events of FMI 3.0 co-simulation are handled.
        tolerance: relative tolerance that is passed to an FMU for its own step control; its own by default.
        directional_derivatives: false where those that an FMU gives are wrong: differences are taken then.
    """

    kind: Literal["fmu", "model", "control"] = "fmu"
    source: str | None = None
    model: str | None = None
    component: str = "plant"
    inputs: Mapping[str, str] = Field(default_factory=dict)
    outputs: Mapping[str, str] = Field(default_factory=dict)
    parameter_names: Mapping[str, str] = Field(default_factory=dict)
    parameters: Mapping[str, float] = Field(default_factory=dict)
    substeps: Annotated[int, Field(ge=1, le=1024)] | None = None
    initial_state: tuple[float, ...] = ()
    fmi: Annotated[str, AfterValidator(_written)] = DEFAULT_VERSION
    interface: Literal["co-simulation", "model-exchange"] | None = None
    solver: Literal["rk4", "cvode"] = "rk4"
    rate_hz: Positive | None = None
    outputs_after_step: bool | None = None
    isolated: bool | None = None
    time_limit_s: Positive = 10.0
    rerun: Literal["auto", "reset", "state", "re-instantiate", "fresh process"] = "auto"
    event_mode: bool = False
    tolerance: Annotated[float, Field(gt=0, lt=1)] | None = None
    directional_derivatives: bool = True


class ControllerSource(ComponentSource):
    """The controller.

    Attributes:
        kind: as of a plant; or ``tracking``, where nobody knows the controller: a virtual one follows the measured
            positions.
        bandwidth_hz: of ``tracking``: up to which frequency positions are followed; by default the highest at which
            their noise hardly shows in the accelerations that are compared, and no higher than the torque log shows.
    """

    kind: Literal["fmu", "model", "control", "tracking"] = "fmu"  # type: ignore[assignment]
    bandwidth_hz: Positive | None = None

    @property
    def is_tracking(self) -> bool:
        """Whether it is a virtual controller."""
        return self.kind == TRACKING

    @model_validator(mode="after")
    def _of_its_kind(self) -> ControllerSource:
        if self.is_tracking and (other := sorted(self.model_fields_set - {"kind", "bandwidth_hz"})):
            raise ValueError(f"kind: tracking takes bandwidth_hz alone, not {', '.join(other)}")
        if not self.is_tracking and self.bandwidth_hz is not None:
            raise ValueError("bandwidth_hz: belongs to controller: {kind: tracking}")
        return self


class Loop(Strict):
    """Timing and wiring of the loop.

    Attributes:
        rate_hz: control rate; that of the controller by default.
        delay_samples, delay_s: delay of the command, a fraction of a sample allowed; one of the two.
        algorithm: ``gauss_seidel`` (controller first), or ``jacobi``: every component gets what the others gave at
            the end of the last step.
        algebraic_loops: ``refuse``, ``iterate`` at each tick, or take ``previous`` values.
        drive_gains: g_t of tau = g_t command (eq. 21), one a joint; beside ``system``, which holds them already, only
            for a log of the command.
        injections: ``command<j>`` -> column of the reference added to it.
    """

    rate_hz: Positive | None = None
    delay_samples: Annotated[float, Field(ge=0, le=1000)] = 0.0
    delay_s: Annotated[float, Field(ge=0)] | None = None
    algorithm: Literal["gauss_seidel", "jacobi"] = "gauss_seidel"
    algebraic_loops: LoopTreatment = "refuse"
    drive_gains: tuple[float, ...] | None = None
    injections: Mapping[str, str] = Field(default_factory=dict)

    @field_validator("drive_gains")
    @classmethod
    def _some_torque(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None and 0.0 in value:
            raise ValueError("a drive with the gain 0 moves nothing")
        return value

    @model_validator(mode="after")
    def _one_delay(self) -> Loop:
        if self.delay_s is not None and self.delay_samples:
            raise ValueError("give delay_samples or delay_s, not both")
        return self


class DataFile(Strict):
    """A file of rows over time.

    Attributes:
        file: path relative to the case, or ``data:path`` inside the data folder (``FMU_DIDIM_DATA``).
        time: name of the time column, or ``{name: ..., unit: ms}``, or ``{rate_hz: ...}`` where there is none.
        csv: how a CSV file is written, where that cannot be recognised.
        obtain: where a user gets the file, shown when it is absent.
    """

    file: str
    time: Annotated[TimeColumn, AlsoWritten(("string", "integer"))] | None = None
    csv: CsvLayout | None = None
    obtain: str = ""


class SignalFile(DataFile):
    """Signals in a file.

    Attributes:
        columns: signal (``q1``, ``tau1``) -> column in the file: its name, or ``{name: ..., unit: deg, scale: ...,
            zero: ..., sign: -1, gear_ratio: ..., torque_constant: ...}``; without ``name`` that of the signal.
        motors: where the file shows motors that drive several joints, as those of a wrist: a row for each motor, by how
            much it turns when one joint after the other turns by one (rad for 1 m of a slide), gear ratios included.
            Positions and torques, ``q1`` and ``tau1`` being those of motor 1, become those of joints.
    """

    columns: Mapping[str, Annotated[Column, AlsoWritten(("string", "integer"))]] = Field(default_factory=dict)
    motors: tuple[tuple[float, ...], ...] | None = None

    @field_validator("motors")
    @classmethod
    def _joints_follow(cls, value: tuple[tuple[float, ...], ...] | None) -> tuple[tuple[float, ...], ...] | None:
        if value is not None:
            check_turns(value)
        return value

    @model_validator(mode="after")
    def _one_gear(self) -> SignalFile:
        twice = [name for name, column in self.columns.items() if column.gear_ratio is not None]
        if self.motors is not None and twice:
            raise ValueError(
                f"gear_ratio: of {', '.join(twice)} and motors: both bring motors to joints; give the gear ratios in "
                "motors: alone"
            )
        return self

    @field_validator("columns", mode="before")
    @classmethod
    def _named_as_the_signal(cls, value: Any) -> Any:
        if not isinstance(value, Mapping):
            return value
        return {k: {"name": str(k), **v} if isinstance(v, Mapping) and "name" not in v else v for k, v in value.items()}


class InputsFile(SignalFile):
    """Recorded inputs of a model; written short as the path alone.

    Attributes:
        columns: input of the model -> column of the file; by default the columns that have the names of inputs.
        interpolation: ``linear`` between the rows, or ``held`` from each row to the next; inputs that are no real
            numbers are held.
        outside: what acts before the first row and after the last one: ``refuse``, or ``hold`` that row.
        offset_s: added to the time of the file, to bring it on the clock of what was measured.
    """

    interpolation: Literal["linear", "held"] = "linear"
    outside: Literal["refuse", "hold"] = "refuse"
    offset_s: float = 0.0

    @model_validator(mode="before")
    @classmethod
    def _path_alone(cls, value: Any) -> Any:
        return {"file": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _of_no_joints(self) -> InputsFile:
        if self.motors is not None:
            raise ValueError("motors: belongs to files of joints, and a model has none")
        return self


class InstantsFile(DataFile):
    """The instants at which the controller ran, for a loop whose period changes; written short as the path alone.

    Every row of the file is one of them, such as the rows of a log that the control loop itself writes. The loop is
    simulated from instant to instant, t_k to t_(k+1); a sampled controller computes its law once at each, with its
    nominal period. A reference with other rows is evaluated there.

    Attributes:
        offset_s: added to the instants, to bring them on the clock of the reference.
    """

    offset_s: float = 0.0

    @model_validator(mode="before")
    @classmethod
    def _path_alone(cls, value: Any) -> Any:
        return {"file": value} if isinstance(value, str) else value


class ReferenceFile(SignalFile):
    """A reference trajectory from a file, one row a control period.

    A log of a periodic motion seldom starts at rest: with ``period_s`` and ``warm_up_s`` the simulation
    starts earlier, on the end of the period before. Velocities and accelerations that the file lacks are computed.

    Attributes:
        resample: whether rows at other instants, such as those of a jittered clock, are brought to the control rate by
            a cubic spline through them; they are refused otherwise.
        period_s: length of a period of the motion; warm_up_s: how much earlier the simulation starts, at most a period.
    """

    resample: bool = False
    period_s: Positive | None = None
    warm_up_s: Annotated[float, Field(ge=0)] = 0.0

    @model_validator(mode="after")
    def _period_of_the_warm_up(self) -> ReferenceFile:
        if self.warm_up_s > 0 and (self.period_s is None or self.warm_up_s > self.period_s):
            raise ValueError("warm_up_s needs a period_s that is at least as long")
        return self


class TorqueFile(SignalFile):
    """The torque log.

    Attributes:
        quantity: ``torque`` (N.m, N), or ``command``: what the controller gives, times the drive gains.
        rate_hz, phase_s: use only the samples phase + i / rate of the log (made by ``sampling``).
        sampling: ``point`` samples, the ``average`` over a window, or ``filtered``: behind a low-pass without phase, as
            of a log that was brought to fewer samples, or is by ``rate_hz``. What is simulated goes through the same.
        cutoff_hz: where the filter of samples that are ``filtered`` leaves half of the amplitude.
        window, window_s: where the window of an average lies, and its length (one period by default).
        offset_s: added to the time of the log, to bring it on the clock of the reference.
        log_shift_s: how late the log is stamped, at most a second either way: the samples at t show the torque at
            t - log_shift_s, interpolated between ticks; what lies before the reference or after it counts as its end.
        outliers: ``keep``, or ``leave_out``: ``identify`` and ``discover`` fit and judge without the samples that a
            robust fit before finds to be off, and say how many.
        unsigned: whether the log shows the size of the torque alone, |tau|: the signs are then those of the simulated
            one.
    """

    quantity: Literal["torque", "command"] = "torque"
    rate_hz: Positive | None = None
    phase_s: float = 0.0
    sampling: Kind = "point"
    window: Window = "preceding"
    window_s: Positive | None = None
    cutoff_hz: Positive | None = None
    offset_s: float = 0.0
    log_shift_s: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.0
    outliers: Literal["keep", "leave_out"] = "keep"
    unsigned: bool = False

    @model_validator(mode="after")
    def _has_cutoff(self) -> TorqueFile:
        if (self.sampling == "filtered") is (self.cutoff_hz is None):
            raise ValueError(
                "sampling: filtered and cutoff_hz belong together: write both, such as {sampling: filtered, cutoff_hz: "
                "40}, or none of them"
            )
        return self

    @property
    def sampled(self) -> dict[str, Any]:
        """How a sample follows from the torque, as :func:`~fmu_didim.cosim.sample_operator` takes it."""
        return {
            "kind": self.sampling, "window": self.window, "window_s": self.window_s, "cutoff_hz": self.cutoff_hz,
        }  # fmt: skip

    @model_validator(mode="after")
    def _torques_of_motors(self) -> TorqueFile:
        if self.motors is not None and self.quantity == "command":
            raise ValueError(
                "quantity: command is one for each joint, and motors: is for torques of motors; give torques, such as "
                "columns: {tau1: {name: ..., unit: A, torque_constant: ...}}"
            )
        if self.motors is not None and self.unsigned:
            raise ValueError("unsigned: sizes of motors' torques do not make those of joints; give a log with signs")
        return self


Freedom = Annotated[float, Field(ge=1)]


class TemperatureFile(SignalFile):
    """Temperatures of the gears of a run, of which a line along the run is taken for each joint.

    Attributes:
        columns: ``temperature<j>`` -> column of the file, in degC where the file states no unit; one for each joint, or
            ``temperature`` for all of them.
        offset_s: added to the time of the file, to bring it on the clock of the reference.
    """

    offset_s: float = 0.0

    @model_validator(mode="after")
    def _of_joints(self) -> TemperatureFile:
        if self.motors is not None:
            raise ValueError("motors: is for positions and torques; a temperature belongs to its joint")
        bad = [name for name in self.columns if not re.fullmatch(r"temperature\d*", name)]
        if bad:
            raise ValueError(
                f"columns: {', '.join(bad)}: write temperature1, temperature2, ..., or temperature for all"
            )
        return self


COLDEST, HOTTEST = -60.0, 200.0
"""[degC] Between which a drive may run."""
Degrees = Annotated[float, Field(ge=COLDEST, le=HOTTEST)]


class MeasuredColumn(Column):
    """A column of what was measured, with the distribution of its noise.

    Attributes:
        std, relative_std, log_normal, robust: as those of the file, of this signal alone.
    """

    std: Positive | None = None
    relative_std: Positive | None = None
    log_normal: bool | None = None
    robust: bool | Freedom | None = None


OF_NOISE = ("std", "relative_std", "log_normal", "robust")
"""Keys of a measured file, and of its columns, that say how the noise of a signal is distributed."""


class MeasuredFile(SignalFile):
    """What was measured beside the torque and is fitted with it by ``identify`` and ``discover``, or outputs of a
    ``model:``, at instants of their own: a cell that is empty is no sample. Written short as the path alone.

    Attributes:
        signals: which outputs of the plant the file shows: ``q1``, ``dq2``, or any other by its name; by default those
            under ``columns``, else the positions ``q<j>`` that it has, or the outputs of a ``model:``. Velocities that
            a driver computes from positions are no second measurement of them.
        std: known standard deviation of the noise of a signal, in its SI unit or in that of the variable of a
            ``model:``; estimated from the residual by default. Also written with the column: ``{unit: K, std: 0.1}``.
        relative_std: of a ``model:``: standard deviation of the noise as a part of the value; with ``std``, which is
            that at zero, both: s^2 = std^2 + (relative_std y)^2 with the simulated y. Also written with the column.
        log_normal: of a ``model:``: ``true`` where the noise is normal in logarithms, so that these are fitted; ``std``
            then is theirs. Also written with the column.
        robust: of a ``model:``: ``true`` where some samples are far off: noise of Student's t, whose degrees of freedom
            are estimated, or stated by a number; ``std`` then is its scale, that of ordinary samples. Also written with
            the column.
        rate_hz: use samples at this rate at most, each as the file has it; all by default.
        offset_s: added to the time of the file, to bring it on the clock of the reference.
    """

    columns: Mapping[str, Annotated[MeasuredColumn, AlsoWritten(("string", "integer"))]] = Field(default_factory=dict)
    signals: tuple[str, ...] = ()
    std: Mapping[str, Positive] = Field(default_factory=dict)
    relative_std: Mapping[str, Positive] = Field(default_factory=dict)
    log_normal: Mapping[str, bool] = Field(default_factory=dict)
    robust: Mapping[str, bool | Freedom] = Field(default_factory=dict)
    rate_hz: Positive | None = None
    offset_s: float = 0.0

    @model_validator(mode="before")
    @classmethod
    def _short_forms(cls, value: Any) -> Any:
        if isinstance(value, str):
            return {"file": value}
        columns = value.get("columns") if isinstance(value, Mapping) else None
        if not isinstance(columns, Mapping):
            return value
        found = dict[str, Any]()
        for key in OF_NOISE:
            own = {k: v[key] for k, v in columns.items() if isinstance(v, Mapping) and key in v}
            if own:
                found[key] = {**own, **(value.get(key) or {})}
        return {**value, **found}

    @model_validator(mode="after")
    def _of_outputs(self) -> MeasuredFile:
        if self.motors is not None:
            raise ValueError(
                "motors: is for reference, torque and positions; what is fitted beside the torque is an output of the "
                "plant, each with noise of its own"
            )
        return self

    @model_validator(mode="after")
    def _of_its_signals(self) -> MeasuredFile:
        named = self.signals or tuple(self.columns)
        for key in OF_NOISE:
            absent = [name for name in getattr(self, key) if named and name not in named]
            if absent:
                raise ValueError(f"{key}: names {', '.join(absent)}, which is not among the signals {', '.join(named)}")
        if both := [name for name, wanted in self.log_normal.items() if wanted and name in self.relative_std]:
            raise ValueError(
                f"{', '.join(both)}: give log_normal or relative_std, not both: noise of logarithms is relative as it "
                "is (std: is its deviation)"
            )
        return self

    def error_model(self, name: str) -> ErrorModel:
        """The error model of a signal."""
        robust = self.robust.get(name, False)
        return ErrorModel(
            self.std.get(name), self.relative_std.get(name), self.log_normal.get(name, False), robust is not False,
            None if isinstance(robust, bool) else robust,
        )  # fmt: skip


AnyMeasured = Annotated[MeasuredFile, AlsoWritten(("string",))]


def one_or_several(value: Any, handler: Any) -> Any:
    """A measured file or a list of them; only one of the two forms is tried, so that its own errors are shown."""
    if isinstance(value, Mapping | str):
        return MeasuredFile.model_validate(value)
    if isinstance(value, (list, tuple)):
        return TypeAdapter(tuple[MeasuredFile, ...]).validate_python(value)
    return handler(value)


class LoadSource(Strict):
    """What the last link carries in a run beside the robot, such as a weight or a tool, and what is known of it.

    Its mass, centre and inertia are identified with the robot as far as torques show them; what is stated is taken for
    true. A tool that is mounted in all runs is a part of the robot. Runs with the same load: one of them describes it,
    the others have ``same_as``.

    Attributes:
        mass: as weighed, kg; mass_std: its standard deviation, kg; exact by default.
        centre: of mass, m, in the frame of the last link of the robot description (of a URDF, and of a description with
            ``frames: standard``, in that of its modified DH parameters, which ``result.json`` has).
        inertia: about the centre, axes as those frames: Ixx, Iyy, Izz, Ixy, Ixz, Iyz, kg.m2, products as in the matrix.
        same_as: label of the experiment that carries the same load.
    """

    mass: Positive | None = None
    mass_std: Positive | None = None
    centre: tuple[float, float, float] | None = None
    inertia: tuple[float, float, float, float, float, float] | None = None
    same_as: str | None = None

    @model_validator(mode="after")
    def _of_something_known(self) -> LoadSource:
        if self.same_as is not None and len(self.model_fields_set) > 1:
            raise ValueError("same_as: stands alone; the other experiment says what is known of the load")
        if self.mass is None and (other := [k for k in ("mass_std", "centre", "inertia") if getattr(self, k)]):
            raise ValueError(f"{', '.join(other)}: needs mass: beside it")
        if self.inertia is not None and self.centre is None:
            raise ValueError("inertia: is about the centre of mass, so give centre:, too")
        if self.mass_std is not None and self.centre is not None:
            raise ValueError("mass_std: is for a load of which the mass alone is known; leave out centre:")
        return self

    @property
    def known(self) -> dict[str, float]:
        """Inertial parameters (``M``, ``MX``, ...) in the frame of the last link that are known without error."""
        if self.mass is None or self.mass_std is not None:
            return {}
        found, m = {"M": self.mass}, self.mass
        if self.centre is None:
            return found
        x, y, z = self.centre
        found |= {"MX": m * x, "MY": m * y, "MZ": m * z}
        if self.inertia is not None:
            a, b, c, d, e, f = self.inertia
            found |= {
                "XX": a + m * (y * y + z * z), "YY": b + m * (x * x + z * z), "ZZ": c + m * (x * x + y * y),
                "XY": d - m * x * y, "XZ": e - m * x * z, "YZ": f - m * y * z,
            }  # fmt: skip
        return found


class ExperimentSource(Strict):
    """Reference, torque and what else was measured of one run.

    Attributes:
        reference: what the controller follows: a file with a row a control period, or a formula (``kind:``).
        inputs: of a ``model:``, as they were recorded; start_s: where its simulation starts, by default with the first
            row of the inputs, without inputs at 0 or with the first sample, if that is earlier.
        torque: the log; positions: measured positions ``q<j>``, for the estimators that use them instead of simulating
            the loop.
        instants: of the controller, where its period was not constant.
        measured: what ``didim`` and ``clie`` fit together with the torque, or what is fitted of a ``model:``: one file,
            or a list.
        role: whether the parameters are fitted to it (``estimation``), or only judged by it (``validation``).
        from_s, to_s: the part of the run that is used, on the clock of the reference. The loop is simulated from the
            beginning of the reference all the same, so that it has settled into the motion; what comes after ``to_s``
            is left out of both.
        initial_state: where the loop starts: ``reference``: on the first row, with controllers as they are built;
            ``q<j>``, ``dq<j>``, states of controllers (``integral<j>`` of a control law, ``x<i>`` of a python-control
            system, ``component.parameter`` of an FMU of another tool) with their values; ``free``: unknown, identified
            from the torque; ``detected``: unknown where the log shows that it does not start on the reference. Of a
            held-out experiment the first part then gives the start and the rest is judged.
        own: names of parameters that have values of their own in this experiment, such as those of a link with another
            payload; the others are shared by all experiments.
        load: what the last link carries in this run, which is identified with the robot: ``{}``, or what is known of
            it.
        gains: parameter of the controller (``Kp1``; ``component.parameter`` where the case has ``components``) -> value
            that it had in this run, where that differs from the one of the case.
        temperature: of the gears in this run, in degC: one number, a list with one for each joint, or a file with
            ``temperature<j>`` over time. The effect ``temperature_dependent_friction`` takes it.
        unit: of which machine this run is, such as a serial number, where there are several of a kind.
        date: when it was recorded, ``2024-05-31``; by default the date by ISO 8601 in the name of the torque log, if it
            has one.
    """

    reference: AnyExcitation | ReferenceFile | None = None
    inputs: Annotated[InputsFile, AlsoWritten(("string",))] | None = None
    start_s: float | None = None
    torque: TorqueFile | None = None
    positions: SignalFile | None = None
    instants: Annotated[InstantsFile, AlsoWritten(("string",))] | None = None
    measured: AnyMeasured | tuple[AnyMeasured, ...] = ()
    role: Role = "estimation"
    from_s: float | None = None
    to_s: float | None = None
    initial_state: Literal["detected", "free", "reference"] | Mapping[str, float] = "detected"
    own: tuple[str, ...] = ()
    load: LoadSource | None = None
    gains: Mapping[str, float] = Field(default_factory=dict)
    temperature: Degrees | tuple[Degrees, ...] | TemperatureFile | None = None
    unit: str = ""
    date: datetime.date | None = None

    @property
    def recorded_on(self) -> datetime.date | None:
        """The day of the run: stated, or in the name of its torque log."""
        if self.date is not None or self.torque is None:
            return self.date
        found = dates_in(PurePath(self.torque.file).stem)
        return found[0].date() if len(found) == 1 else None

    @property
    def measured_files(self) -> tuple[MeasuredFile, ...]:
        """What was measured beside the torque, however it was written."""
        return (self.measured,) if isinstance(self.measured, MeasuredFile) else self.measured

    @field_validator("measured", mode="wrap")
    @classmethod
    def _one_or_several(cls, value: Any, handler: Any) -> Any:
        return one_or_several(value, handler)

    @model_validator(mode="after")
    def _some_time(self) -> ExperimentSource:
        if self.from_s is not None and self.to_s is not None and self.from_s >= self.to_s:
            raise ValueError("from_s must lie before to_s")
        return self

    @model_validator(mode="after")
    def _one_clock(self) -> ExperimentSource:
        given = self.reference
        if self.instants is not None and isinstance(given, ReferenceFile) and (given.resample or given.warm_up_s):
            raise ValueError(
                "instants: say when the controller ran: leave out resample: and warm_up_s: of the reference, which is "
                "evaluated at the instants"
            )
        return self

    @field_validator("own")
    @classmethod
    def _once(cls, own: tuple[str, ...]) -> tuple[str, ...]:
        if twice := sorted({name for name in own if own.count(name) > 1}):
            raise ValueError(f"name {', '.join(twice)} once")
        return own

    @field_validator("temperature", mode="wrap")
    @classmethod
    def _number_list_or_file(cls, value: Any, handler: Any) -> Any:
        """Only one of the three forms is tried, so that its own errors are shown."""
        if isinstance(value, Mapping):
            return TypeAdapter(TemperatureFile).validate_python(dict(value))
        if isinstance(value, list | tuple):
            return TypeAdapter(tuple[Degrees, ...]).validate_python(list(value))
        return value if value is None else TypeAdapter(Degrees).validate_python(value)

    @field_validator("reference", mode="wrap")
    @classmethod
    def _by_kind(cls, value: Any, handler: Any) -> Any:
        """Only one of the two forms is tried, so that its own errors are shown."""
        if isinstance(value, Mapping):
            form: Any = AnyExcitation if "kind" in value else ReferenceFile
            return TypeAdapter(form).validate_python(dict(value))
        return handler(value)


class IdentifiedParameter(Strict):
    """A parameter that is identified beside the base parameters of the robot, or of a plant without robot description.

    Attributes:
        of: what it belongs to: ``plant``; another component of the loop, such as ``controller`` or the component of an
            effect that the robot description lists (``actuator_lag2``); ``drive`` (the gain of the drive of ``joint``);
            ``delay`` (of the command, in samples); ``log`` (how late its stamps are, in s).
        parameter: its name there; by default that under which it is listed.
        joint: of a drive, counted from 1.
        start: value to start from; that of the plant by default.
        minimum, maximum: limits; a result at a limit is refused.
    """

    of: str = "plant"
    parameter: str | None = None
    joint: Annotated[int, Field(ge=1)] | None = None
    start: float | None = None
    minimum: float | None = None
    maximum: float | None = None

    def start_and_limits(
        self, name: str, own_start: float, own_limits: tuple[float, float] = (-math.inf, math.inf)
    ) -> tuple[float, float, float]:
        """Start value, lowest and highest value; the limits are infinite where there are none.

        Args:
            name: under which it is listed; own_start, own_limits: what the loop says of it.

        Raises:
            InputError: the start value is outside the limits.
        """
        value = own_start if self.start is None else self.start
        low = own_limits[0] if self.minimum is None else max(own_limits[0], self.minimum)
        high = own_limits[1] if self.maximum is None else min(own_limits[1], self.maximum)
        if not low <= value <= high:
            raise InputError(
                "The start value is outside the limits.", where=f"identify.{name}", got=value,
                valid=f"{low:g} to {high:g}", next_step="Give start:, or other limits.",
            )  # fmt: skip
        return value, low, high

    @model_validator(mode="after")
    def _in_order(self) -> IdentifiedParameter:
        given = [value for value in (self.minimum, self.start, self.maximum) if value is not None]
        if given != sorted(given):
            raise ValueError("give minimum <= start <= maximum")
        return self


class LowPassSource(Strict):
    """Zero-phase Butterworth filter of torque and regressor.

    Attributes:
        cutoff_hz: where its gain has fallen by 3 dB in each of the two directions; order: of the filter in each.
    """

    cutoff_hz: Positive
    order: Annotated[int, Field(ge=1, le=10)] = 4


RelativeStd = Positive | Mapping[Annotated[str, Field(pattern=r"^joint[1-9]\d*$")], Positive]
"""One number for all joints, or one by joint."""


class PriorSource(Strict):
    """What is known of the robot before it moves: its base parameters are pulled there, the more the surer.

    Standard deviations are relative: 0.2 is about 20 % of a value; one number for all joints, or one by joint
    (``{joint1: 0.05}``). What is not stated has no prior, nor has a base parameter that it is a part of.

    Attributes:
        towards: ``description``, the values of the robot description of the case; or another description of the
            same joints (``cad.yaml``), which gives the values alone.
        result: instead, the ``result.json`` of an earlier identification of this robot, or its folder: its base
            parameters with their covariance, such as those of the robot without a load; ``relative_std`` and the like
            are then left out.
        relative_std: of the pseudo-inertia of each link: of its mass and of its second moment along any axis.
        motor_inertia, friction: of motor inertias, and of viscous and Coulomb friction; a value of zero is not stated.
    """

    towards: str = "description"
    result: str | None = None
    relative_std: RelativeStd | None = None
    motor_inertia: RelativeStd | None = None
    friction: RelativeStd | None = None

    @model_validator(mode="after")
    def _something(self) -> PriorSource:
        if self.result is not None:
            if other := sorted(self.model_fields_set - {"result"}):
                raise ValueError(f"result: stands alone, not beside {', '.join(other)}: it has standard deviations")
            return self
        if self.relative_std is None and self.motor_inertia is None and self.friction is None:
            raise ValueError("give relative_std: (of the links), motor_inertia: or friction:, such as 0.2 for 20 %")
        return self

    @property
    def file(self) -> str | None:
        """The other description, or the earlier result, if there is one."""
        if self.result is not None:
            return self.result if self.result.endswith(".json") else f"{self.result.rstrip('/')}/result.json"
        return None if self.towards == "description" else self.towards


class SystemSource(Strict):
    """The whole loop from an SSP archive; written short as the path alone.

    Attributes:
        source: the ``.ssp`` file: components, connections, values, order, step and delay.
        inputs: column of the reference (``q1``, ``dq1``) -> input of the system that it feeds, where they differ.
    """

    source: str
    inputs: Mapping[str, str] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _path_alone(cls, value: Any) -> Any:
        return {"source": value} if isinstance(value, str) else value
