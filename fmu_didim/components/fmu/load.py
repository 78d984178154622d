"""FMUs from files to components."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from fmu_didim.base.errors import FmuError, InputError
from fmu_didim.components.fmu.component import FmuComponent
from fmu_didim.components.fmu.description import (
    CO_SIMULATION,
    MODEL_EXCHANGE,
    OPTION_TYPES,
    REAL_TYPES,
    FmuDescription,
    FmuVariable,
    Interface,
)
from fmu_didim.components.fmu.events import check_events, clock_period
from fmu_didim.components.fmu.library import library_file
from fmu_didim.components.fmu.reading import read_description
from fmu_didim.components.fmu.settings import AUTO, DEFAULT_TIME_LIMIT, STATE, STRATEGIES
from fmu_didim.components.fmu.units import Conversion, conversion
from fmu_didim.components.fmu.versions import FmiVersion, version_of
from fmu_didim.data.signals import Variable
from fmu_didim.export.variables import TOLERANCE_NAME

SOLVERS = ("rk4", "cvode")


def load_fmu(
    path: Path | str,
    *,
    interface: str | None = None,
    solver: str = "rk4",
    substeps: int | None = None,
    si_units: bool = True,
    isolated: bool | None = None,
    time_limit_s: float = DEFAULT_TIME_LIMIT,
    rerun: str = AUTO,
    event_mode: bool = False,
    tolerance: float | None = None,
    directional_derivatives: bool = True,
) -> FmuComponent:
    """Read an FMU of a version in :data:`~fmu_didim.components.fmu.versions.VERSIONS`; its variables keep their names.

    Inputs and outputs are those of real, integer, Boolean and enumeration type; strings are left out.

    Args:
        interface: ``co-simulation`` or ``model-exchange``; by default co-simulation if there is one.
        solver: of model exchange: ``rk4`` with equal substeps, or ``cvode`` (SUNDIALS, variable step).
        substeps: of ``rk4`` in a communication step, 10 by default.
        si_units: show values in SI where the FMU has multiples of SI units, such as deg, mm or rpm.
        isolated: run loops with it in a process of their own, which a crash or an endless loop of the FMU ends, and not
            this one. By default so for FMUs of other tools until one such process has come to a good end.
        time_limit_s: for each call of an isolated FMU.
        rerun: how it is run again: ``reset``, ``state`` (of a new instance, restored), ``re-instantiate`` or
            ``fresh process``; ``auto`` tries it out before the first run again and remembers the answer.
        event_mode: handle the events of FMI 3.0 co-simulation; always done where the FMU has input clocks.
        tolerance: relative, given to the FMU when a run is set up, for the step control that it may have; by
            default it takes its own. FMI 1.0 has none.
        directional_derivatives: ask it for them where it says that it gives them; if not, differences are taken.

    Raises:
        FmuError: the file is not such an FMU, or holds no binary for this platform.
        InputError: an option is not valid.
    """
    _check_options(interface, solver, substeps, time_limit_s, tolerance, rerun)
    fmu = read_description(path)
    chosen = _interface(fmu, interface)
    if rerun == STATE and not chosen.has_state:
        raise InputError(
            "The FMU cannot save its state.", where=str(fmu.path), got=f"rerun: {rerun}", valid=STRATEGIES,
            next_step="Choose another way for rerun:, or leave it out.",
        )  # fmt: skip
    clocked = check_events(fmu, chosen, wanted=event_mode)
    fmi = version_of(fmu.version, str(fmu.path))
    library_file(fmi, fmu, chosen)
    component = _component(fmi, fmu, chosen, si_units=si_units)
    # What other tools state there is a suggestion.
    own_period = fmu.experiment.step if fmu.is_own else None
    component = replace(
        component,
        solver=solver,
        isolated=isolated,
        time_limit_s=float(time_limit_s),
        rerun=rerun,
        event_mode=event_mode or clocked,
        tolerance=tolerance,
        has_derivatives=component.has_derivatives and directional_derivatives,
        sample_time=clock_period(fmu) if clocked else own_period,
    )
    return component if substeps is None else component.with_substeps(substeps) or component


def _check_options(
    interface: str | None, solver: str, substeps: int | None, time_limit_s: float, tolerance: float | None, rerun: str
) -> None:
    if interface not in (None, CO_SIMULATION, MODEL_EXCHANGE):
        raise InputError(
            "This interface is not known.", got=interface, valid=(CO_SIMULATION, MODEL_EXCHANGE),
            next_step="Take one that the FMU has; fmu-didim fmu info FILE lists them.",
        )  # fmt: skip
    if solver not in SOLVERS:
        raise InputError(
            "This solver is not known.", got=solver, valid=SOLVERS, next_step="Take one of these, or leave solver: out."
        )
    if substeps is not None and substeps < 1:
        raise InputError("The number of substeps must be positive.", got=substeps, next_step="Give 1, 2, 3, ...")
    if time_limit_s <= 0:
        raise InputError(
            "The time limit must be positive.", got=time_limit_s,
            next_step="Give seconds above 0, or leave the limit out.",
        )  # fmt: skip
    if tolerance is not None and not 0 < tolerance < 1:
        raise InputError(
            "The tolerance must be a fraction.", got=tolerance, valid="such as 1e-8",
            next_step="Give a number above 0 and below 1.",
        )  # fmt: skip
    if rerun not in STRATEGIES:
        raise InputError(
            "This way to run an FMU again is not known.", got=rerun, valid=STRATEGIES,
            next_step="Take one of these, or leave rerun: out.",
        )  # fmt: skip


def _interface(fmu: FmuDescription, wanted: str | None) -> Interface:
    for kind in (wanted,) if wanted else (CO_SIMULATION, MODEL_EXCHANGE):
        found = fmu.interface(kind)
        if found is not None:
            return found
    kinds = [i.kind for i in fmu.interfaces]
    what = f"The FMU has no {wanted} interface." if wanted else "The FMU has no interface that can run in a loop."
    raise FmuError(
        what,
        where=str(fmu.path),
        got=f"{', '.join(kinds)} only" if kinds else "no interface at all",
        valid=(CO_SIMULATION, MODEL_EXCHANGE),
        next_step="Export it for co-simulation or model exchange.",
    )


def scalars_of(fmu: FmuDescription, own: FmuVariable, *, si_units: bool) -> list[tuple[Variable, Conversion]]:
    """Each element of a variable as it is shown, and its conversion; ``si_units``: as of :func:`load_fmu`."""
    rule = conversion(own.unit, fmu.units) if si_units else Conversion(own.unit)
    values = zip(own.element_names(), own.starts(fmu.path), strict=True)
    display = own.display if rule.is_identity and not own.negated else None
    shown = [
        Variable(name, rule.unit, own.causality, rule.to_shown(start), own.description, display)
        for name, start in values
    ]
    if own.negated:
        rule = Conversion(rule.unit, -rule.factor, rule.offset)
    return [(variable, rule) for variable in shown]


def _component(fmi: FmiVersion, fmu: FmuDescription, interface: Interface, *, si_units: bool) -> FmuComponent:
    scalars = partial(scalars_of, fmu, si_units=si_units)
    groups = {c: fmu.of_causality(c) for c in ("input", "output")}
    settable = [v for v in fmu.variables if v.is_settable]
    real = [v for v in settable if v.type in REAL_TYPES and v.name != TOLERANCE_NAME]
    options = [v for v in settable if not v.shape and (v.type in OPTION_TYPES or v.name == TOLERANCE_NAME)]
    starts = [v for v in fmu.variables if v.type in REAL_TYPES and v.is_start_value]
    scalar_groups = {**groups, "parameter": tuple(real), "start": tuple(starts)}
    pairs = {c: [p for v in group for p in scalars(v)] for c, group in scalar_groups.items()}
    references = {v.name: v.reference for v in options}
    references |= {name: v.reference for v in real for name in v.element_names()}
    used = tuple(dict.fromkeys((*groups["input"], *groups["output"], *real, *options, *starts)))
    return FmuComponent(
        fmi=fmi,
        fmu=replace(fmu, variables=used),
        interface=interface,
        inputs=tuple(v for v, _ in pairs["input"]),
        outputs=tuple(v for v, _ in pairs["output"]),
        parameters=tuple(v for v, _ in pairs["parameter"]),
        references=references,
        input_references=tuple(v.reference for v in groups["input"]),
        output_references=tuple(v.reference for v in groups["output"]),
        input_conversions=tuple(c for _, c in pairs["input"]),
        output_conversions=tuple(c for _, c in pairs["output"]),
        parameter_conversions={v.name: c for v, c in (*pairs["parameter"], *pairs["start"]) if not c.is_identity},
        start_values={v.name: v.start for v, _ in pairs["start"]},
        start_references={name: v.reference for v in starts for name in v.element_names()},
        arrays={name: v.element_names() for v in (*real, *starts) if v.shape for name in v.element_names()},
        option_types={v.name: v.type for v in options},
        fixed=frozenset(name for v in real if v.variability == "fixed" for name in v.element_names()),
        has_derivatives=interface.has_derivatives and not any(v.shape for v in used),
    )
