"""The YAML case: robot, plant, controller, loop, experiments, estimator."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError, ValidationInfo, field_validator, model_validator

from fmu_didim.base.documents import AlsoWritten, Positive, Strict, read_document
from fmu_didim.base.entry_words import details_of, in_words
from fmu_didim.case.sources import (
    AnyMeasured,
    ComponentSource,
    ControllerSource,
    DataFile,
    ExperimentSource,
    IdentifiedParameter,
    InputsFile,
    Loop,
    LowPassSource,
    PriorSource,
    SystemSource,
    one_or_several,
)
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.estimators import ESTIMATORS, Estimator
from fmu_didim.estimators.search.options import Search
from fmu_didim.model.free_parameter import BASE, DELAY, LOG, PLANT

DEFAULT_ESTIMATOR = "didim"
"""Kind of the estimator where a case gives none,"""
MODEL_ESTIMATOR = "output_error"
"""and of a ``model:``, which has no torque."""
MODEL = "model"
"""Name of a ``model:`` among the components of its system."""
BESIDE_A_MODEL = frozenset({
    "schema_version", "name", "description", "model", "inputs", "measured", "identify", "loop", "experiments", "train",
    "validation", "estimator", "search", "profile", "acknowledged",
})  # fmt: skip
"""Entries of a case with a ``model:``; the others are about robots and their loops."""
OF_A_ROBOT = ("reference", "torque", "positions", "instants", "gains", "temperature")
"""Entries of an experiment that one of a ``model:`` does not have."""

DRIVE = "drive"
"""Owner, in a case, of the gain of a drive."""
CONTROLLER = "controller"
"""Name of the controller in the loop of a case with two components."""
OF_THE_CONTROLLER = (CONTROLLER, DELAY)
"""Owners of what a virtual controller knows nothing of."""
NEEDS_THE_CONTROLLER = ("idim_iv", "output_error")
"""Estimators that rest on a simulated motion that the measured one has not made."""
OF_A_SYSTEM = ("component", "inputs", "outputs", "parameter_names", "parameters")
"""Entries of the plant beside ``system`` or ``components``; all else is settled there."""

RESERVED = (REFERENCE, DELAY, LOG, BASE, DRIVE)
"""Names that mean something else in a case."""


def _check_labels(labels: tuple[str, ...]) -> None:
    """Labels of experiments stand in names of files and of parameters; raises ValueError."""
    for label in labels:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", label):
            raise ValueError(
                f"experiments: {label!r} becomes part of file names: take letters, digits, '_', '-' and '.', the first "
                "one a letter or a digit"
            )
    folded = [label.casefold() for label in labels]
    if alike := [label for label in labels if folded.count(label.casefold()) > 1]:
        raise ValueError(f"experiments: {', '.join(alike)} differ only in capitals, as their files would")


def _check_loads(runs: Mapping[str, ExperimentSource], *, is_known: bool) -> None:
    """Raise ValueError where a load is not described by a fitted run, or where all fitted runs carry one of a robot
    that is not known from an earlier result."""
    carried = {label: run.load for label, run in runs.items() if run.load is not None}
    for label, load in carried.items():
        if load.same_as is None:
            if runs[label].role != "estimation":
                raise ValueError(f"{label}: load: of a held-out run is that of a fitted one: load: {{same_as: label}}")
        elif (other := carried.get(load.same_as)) is None or other.same_as is not None:
            valid = ", ".join(k for k, one in carried.items() if one.same_as is None) or "none"
            raise ValueError(f"{label}: load: same_as: {load.same_as} describes no load; those that do: {valid}")
    if carried and not is_known and not any(run.role == "estimation" and run.load is None for run in runs.values()):
        raise ValueError(
            "load: all fitted runs carry one, so that it is a part of the robot: add a run without it, or give "
            "the robot without it, prior: {result: ...}"
        )


class CaseDocument(Strict):
    """A case file.

    Attributes:
        name: of the case, shown on top of its results; description: what it is about.
        model: any model that is calibrated as it is, with neither robot nor controller: an FMU, a Modelica file or the
            entries of a component. ``inputs`` and ``measured`` then say, here for the one experiment or in each of
            several, what drove it and what was measured of it, and ``identify`` which of its parameters are unknown.
        inputs, measured: of the experiment that is fitted, in the short form.
        robot: robot description (``.yaml``), URDF (``.urdf``) or MJCF (``.xml``); a plant without one needs
            ``identify``.
        identify: name -> parameter of another part of the loop that is identified beside the robot's base parameters;
            or, where parameters of the plant are listed, these instead of the base parameters.
        plant, controller: what runs in the loop: the short form for two components.
        components: name -> component, any number of them, instead; they are evaluated in this order. ``plant`` then
            says which one takes the logged torque (``component``) and, if need be, what its variables are called there.
        connections: input of a component (``motor.u``) -> what it gets: an output (``pd.u``), a column of the reference
            (``reference.q1``), or a sum of such terms, ``reference.q1 - 0.5 * load.q``.
        system: an SSP archive with both and their wiring, instead; ``plant`` then says which component carries the
            parameters.
        loop: rate, order, delay and drive gains.
        experiments: label -> run, with its role; at least one is for the estimation.
        train, validation: the short form for two of them, with the labels ``estimation`` and ``validation``; cross
            validation is optional.
        estimator: ``{kind: didim, ...}`` with the options of that estimator; without ``kind`` those of ``didim``.
        search: where one start is not enough: local fits from many starts, or a global search, inside the bounds
            (``minimum``, ``maximum``) of the parameters.
        profile: ``true``, or names of parameters: their intervals by the profile of the misfit, too.
        torque_std: known standard deviation of the torque noise, one a joint.
        joint_weights: ``estimated`` or ``equal``.
        low_pass: optional filter.
        prior: what is known of the robot before it moves, such as from CAD, if that is to count beside the data.
        acknowledged: code of a doubt -> what was checked about it. Such a doubt is no reason against the verdict any
            more; it stands in result and report with this sentence. Problems cannot be acknowledged.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    name: str
    description: str = ""
    model: Annotated[ComponentSource, AlsoWritten(("string",))] | None = None
    inputs: Annotated[InputsFile, AlsoWritten(("string",))] | None = None
    measured: AnyMeasured | tuple[AnyMeasured, ...] = ()
    robot: str | None = None
    identify: Mapping[str, IdentifiedParameter] | None = None
    plant: ComponentSource = ComponentSource()
    controller: ControllerSource | None = None
    components: Mapping[str, ComponentSource] | None = None
    connections: Mapping[str, str] = Field(default_factory=dict)
    system: Annotated[SystemSource, AlsoWritten(("string",))] | None = None
    loop: Loop = Loop()
    experiments: Mapping[str, ExperimentSource] = Field(default_factory=dict)
    train: ExperimentSource | None = None
    validation: ExperimentSource | None = None
    estimator: Mapping[str, Any] = Field(default_factory=dict)
    search: Search | None = None
    profile: bool | tuple[str, ...] = False
    torque_std: tuple[Positive, ...] | None = None
    joint_weights: Literal["estimated", "equal"] = "estimated"
    low_pass: LowPassSource | None = None
    prior: PriorSource | None = None
    acknowledged: Mapping[str, str] = Field(default_factory=dict)

    @field_validator("model", mode="before")
    @classmethod
    def _path_alone(cls, value: Any) -> Any:
        return {"source": value} if isinstance(value, str) else value

    @field_validator("measured", mode="wrap")
    @classmethod
    def _one_or_several(cls, value: Any, handler: Any) -> Any:
        return one_or_several(value, handler)

    @field_validator("identify", mode="before")
    @classmethod
    def _name_alone(cls, value: Any) -> Any:
        return {k: {} if v is None else v for k, v in value.items()} if isinstance(value, Mapping) else value

    @model_validator(mode="after")
    def _of_a_model(self) -> CaseDocument:
        if self.model is None:
            if short := [name for name in ("inputs", "measured") if name in self.model_fields_set]:
                raise ValueError(f"{' and '.join(short)}: belong to model:; of a robot they stand in its experiments")
            return self
        if other := sorted(self.model_fields_set - BESIDE_A_MODEL):
            raise ValueError(f"beside model: there is no {', '.join(other)}:, which belongs to robots and their loops")
        if beside := sorted(self.loop.model_fields_set - {"rate_hz"}):
            raise ValueError(
                f"loop: of a model: has rate_hz alone (communication points a second), not {', '.join(beside)}"
            )
        if self.model.source is None:
            raise ValueError("model: needs a source: .fmu, .mo, or package.module:name")
        if not self.identify:
            raise ValueError("identify: names no parameter; give identify: {name in the model: {}}")
        if bad := [name for name, entry in self.identify.items() if entry.of not in (PLANT, MODEL)]:
            raise ValueError(f"identify: {', '.join(bad)}: of: is for parts of a loop; those of a model: need none")
        return self

    @property
    def tracks(self) -> bool:
        """Whether a virtual controller follows measured positions."""
        return self.controller is not None and self.controller.is_tracking

    @model_validator(mode="after")
    def _where_nobody_knows_the_controller(self) -> CaseDocument:
        if not self.tracks:
            return self
        if beside := sorted(self.loop.model_fields_set - {"rate_hz", "drive_gains"}):
            raise ValueError(
                f"beside controller: {{kind: tracking}} loop: has rate_hz and drive_gains alone, not "
                f"{', '.join(beside)}: of the real loop nothing is simulated but the hold of its torque"
            )
        for label, run in self.runs.items():
            unsigned = run.torque is not None and run.torque.unsigned
            if run.measured_files or run.instants is not None or unsigned or run.gains:
                raise ValueError(
                    f"{label}: beside controller: {{kind: tracking}} there is no measured: (positions are followed), "
                    "no instants:, no gains: and no torque: {unsigned: true}"
                )
        kind = self.estimator_options["kind"]
        if kind in NEEDS_THE_CONTROLLER or self.estimator_options.get("estimate_delay"):
            raise ValueError(
                f"estimator: {kind} {'with estimate_delay ' if kind not in NEEDS_THE_CONTROLLER else ''}needs the real "
                "controller: a virtual one moves as measured, with that noise, whatever the values are; use didim, clie"
            )
        own = [name for name, entry in (self.identify or {}).items() if entry.of in OF_THE_CONTROLLER]
        if own:
            raise ValueError(
                f"identify: {', '.join(own)}: a virtual controller tells nothing of the gains and delays of the real "
                "one; take them out"
            )
        drives = [name for name, entry in (self.identify or {}).items() if entry.of == DRIVE]
        if drives and not any(run.load is not None and run.load.mass is not None for run in self.runs.values()):
            raise ValueError(
                f"identify: {', '.join(drives)}: beside controller: {{kind: tracking}} the gain of a drive shows only "
                "where a run carries a load of known mass: load: {mass: ...} in an experiment"
            )
        return self

    @model_validator(mode="after")
    def _one_scale(self) -> CaseDocument:
        drives = [name for name, entry in (self.identify or {}).items() if entry.of == DRIVE]
        if drives and self.prior is not None and self.prior.result is not None:
            raise ValueError(
                f"identify: {', '.join(drives)}: beside prior: {{result: ...}} the gains of drives would be those of "
                "that result, which took its torques for true; give the runs without load as experiments instead"
            )
        return self

    @model_validator(mode="after")
    def _which_is_the_plant(self) -> CaseDocument:
        if self.components is None:
            return self
        names = ", ".join(self.components)
        if self.plant.component not in self.components:
            raise ValueError(
                f"plant: {{component: ...}} must say which component takes the logged torque; valid: {names}"
            )
        reserved = RESERVED if self.plant.component == PLANT else (*RESERVED, PLANT)
        if bad := [name for name in self.components if not re.fullmatch(r"[A-Za-z_]\w*", name) or name in reserved]:
            raise ValueError(
                f"components: {', '.join(bad)}: take letters, digits and '_', and none of {', '.join(reserved)}"
            )
        return self

    @model_validator(mode="after")
    def _what_is_identified(self) -> CaseDocument:
        if self.model is not None:
            return self
        if self.robot is None and not self.identify:
            raise ValueError("give robot: (a description) or identify: (names of parameters of the plant)")
        if self.robot is None and self.plant_source is None and self.system is None:
            raise ValueError("a plant without robot description needs a source")
        return self

    @property
    def parts(self) -> dict[str, ComponentSource]:
        """Name in the loop -> component; those of an archive are not among them."""
        if self.components is not None:
            return dict(self.components)
        if self.model is not None:
            return {MODEL: self.model}
        named = {"controller": self.controller, "plant": self.plant}
        return {name: source for name, source in named.items() if source is not None and self.system is None}

    @property
    def plant_name(self) -> str:
        """Name in the loop of the component that takes the logged torque."""
        if self.model is not None:
            return MODEL
        return "plant" if self.components is None and self.system is None else self.plant.component

    @property
    def plant_source(self) -> str | None:
        """Where it comes from; None where it is the robot, or of an archive."""
        return self.parts.get(self.plant_name, self.plant).source

    @property
    def runs(self) -> dict[str, ExperimentSource]:
        """Label -> experiment, however it was written; those for the estimation first."""
        found = dict(self.experiments)
        if self.measured != ():
            found["estimation"] = ExperimentSource(inputs=self.inputs, measured=self.measured)
        if self.train is not None:
            found["estimation"] = self.train
        if self.validation is not None:
            found["validation"] = self.validation.model_copy(update={"role": "validation"})
        return dict(sorted(found.items(), key=lambda item: item[1].role != "estimation"))

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the data files, as the case has them."""
        kinds = (
            (r.reference, r.inputs, r.torque, r.positions, r.instants, r.temperature, *r.measured_files)
            for r in self.runs.values()
        )
        parts = [part for run in kinds for part in run]
        return tuple(dict.fromkeys(part.file for part in parts if isinstance(part, DataFile)))

    @property
    def named_objects(self) -> tuple[str, ...]:
        """All names under which it may mean an object in memory: of the robot, the components and the data."""
        sources = (self.robot, *(part.source for part in self.parts.values()))
        return (*(name for name in sources if name is not None), *self.files)

    @model_validator(mode="after")
    def _which_experiments(self) -> CaseDocument:
        short = [name for name in ("train", "validation") if getattr(self, name) is not None]
        of_the_model = [name for name in ("inputs", "measured") if name in self.model_fields_set]
        if self.experiments and (short or of_the_model):
            short = [*of_the_model, *short]
            raise ValueError(f"give experiments: (any number) or {' and '.join(short)}: (the short form), not both")
        if self.train is not None and of_the_model:
            raise ValueError(f"give train: or {' and '.join(of_the_model)}: (the short form of it), not both")
        runs = self.runs
        for label, run in runs.items():
            self._check_kind(label, run)
        _check_labels(tuple(runs))
        fitted = [label for label, run in runs.items() if run.role == "estimation"]
        if not fitted:
            raise ValueError(
                "give measured: (a file), or experiments: with one whose role is estimation"
                if self.model is not None
                else "give train: (reference and torque), or experiments: with one whose role is estimation"
            )
        _check_loads(runs, is_known=self.prior is not None and self.prior.result is not None)
        if others := [label for label, run in runs.items() if run.own and run.role != "estimation"]:
            raise ValueError(f"own: is for experiments with the role estimation, not for {', '.join(others)}")
        everywhere = set.intersection(*(set(runs[label].own) for label in fitted))
        if everywhere:
            raise ValueError(f"own: {', '.join(sorted(everywhere))} would be shared by no experiment; leave one out")
        return self

    def _check_kind(self, label: str, run: ExperimentSource) -> None:
        """Raise ValueError where an experiment of a model is one of a robot, or the other way round."""
        if self.model is None:
            if run.reference is None and not self.tracks:
                raise ValueError(f"{label}: reference: is required (what the controller follows)")
            if wrong := [name for name in ("inputs", "start_s") if getattr(run, name) is not None]:
                raise ValueError(f"{label}: {', '.join(wrong)}: is for model:; a robot has reference:")
            return
        if wrong := [name for name in OF_A_ROBOT if getattr(run, name)]:
            raise ValueError(f"{label}: {', '.join(wrong)}: is for robots; a model: has inputs: and measured:")
        if run.initial_state != "detected":
            raise ValueError(f"{label}: initial_state: is for robots; list start values as identify: {{x.start: {{}}}}")
        if not run.measured_files:
            raise ValueError(f"{label}: measured: is required (a file with columns that are named as the outputs)")

    @model_validator(mode="after")
    def _where_the_loop_is_from(self) -> CaseDocument:
        if self.model is not None:
            return self
        given = [name for name in ("controller", "components", "system") if getattr(self, name) is not None]
        if not given:
            raise ValueError("give controller: (beside plant:), components: (any number) or system: (an .ssp file)")
        if len(given) > 1:
            raise ValueError(f"give {given[0]}: or {given[1]}:, not both: each says what runs in the loop")
        if self.connections and self.components is None:
            raise ValueError("connections: belongs to components:")
        if self.controller is not None:
            return self
        other = sorted(self.plant.model_fields_set - set(OF_A_SYSTEM))
        if other:
            raise ValueError(
                f"beside {given[0]}: the plant takes {', '.join(OF_A_SYSTEM)} only, not {', '.join(other)}"
            )
        if self.loop.injections:
            where = "in the archive" if self.system is not None else "under connections:"
            raise ValueError(f"beside {given[0]}: there are no injections; connect the test signal {where}")
        return self

    @field_validator("estimator")
    @classmethod
    def _known_estimator(cls, value: Mapping[str, Any], info: ValidationInfo) -> Mapping[str, Any]:
        of_model = info.data.get("model") is not None
        value = {"kind": MODEL_ESTIMATOR if of_model else DEFAULT_ESTIMATOR, **value}
        found = make_estimator(value)
        if of_model and not found.fits_outputs:
            raise ValueError(f"{found.name} is for robots, whose torque it fits; a model: takes {MODEL_ESTIMATOR}")
        return value

    @property
    def profiled(self) -> tuple[str, ...] | None:
        """Names of the parameters whose profiles are asked for, none for all of them; None where none are asked for."""
        if isinstance(self.profile, bool):
            return () if self.profile else None
        return self.profile or None

    @property
    def estimator_options(self) -> dict[str, Any]:
        """Kind and options of the estimator."""
        return {"kind": DEFAULT_ESTIMATOR if self.model is None else MODEL_ESTIMATOR, **self.estimator}


def make_estimator(options: Mapping[str, Any]) -> Estimator:
    """The estimator of ``{kind: ..., <options>}``, the default one without ``kind``; raises ValueError with all that is
    wrong."""
    kind = str(options.get("kind", DEFAULT_ESTIMATOR))
    if kind not in ESTIMATORS:
        raise ValueError(f"there is no estimator '{kind}'; valid: {', '.join(ESTIMATORS)}")
    form = ESTIMATORS[kind]
    names = [f.name for f in fields(form)]  # type: ignore[arg-type]
    given = {name: value for name, value in options.items() if name != "kind"}
    problems = [f"unknown option '{name}' of {kind}; valid: {', '.join(names)}" for name in given if name not in names]
    problems += [f"{name} must be a finite number" for name in _endless(given)]
    if not problems:
        try:
            return TypeAdapter(form).validate_python(given)
        except ValidationError as error:
            problems = [
                f"{'.'.join(map(str, d['loc']))}: {in_words(d)} (got {d['input']!r})" for d in details_of(error)
            ]
    raise ValueError("; ".join(problems))


def _endless(values: Mapping[str, Any]) -> list[str]:
    """Names of the numbers that are not finite, and of the entries of a mapping that are no such number,
    ``start.ZZ1R``."""
    found = [name for name, value in values.items() if isinstance(value, float) and not math.isfinite(value)]
    inner = {name: value for name, value in values.items() if isinstance(value, Mapping)}
    return found + [f"{name}.{one}" for name, value in inner.items() for one in value if not _is_finite(value[one])]


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def read_case(path: Path | str) -> CaseDocument:
    """Read and validate a case file; raises InputError with all its problems."""
    return read_document(CaseDocument, path)
