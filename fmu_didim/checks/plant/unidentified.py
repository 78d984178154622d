"""Parameters of a plant without description that are not identified, as the cause of a misfit.

The plant has them at the values of its maker, which need not be those of the machine. To first order a parameter with
the column c explains, beside the columns of the identified ones, (c' r)^2 / c' c of the squared residual r; the most
promising ones are freed and fitted with the others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.fit.statistics import relative_error_percent
from fmu_didim.model.free_parameter import PLANT, FreeParameter
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import NamedParameters

MOST_TRIED = 40
"""[parameters] Of a plant that are tried at most, a run or two each: library models have hundreds."""
PROMISING = 0.2
"""[1] Share of the squared residual that a parameter must explain to first order to be freed: a mass that is off by a
factor of two explains more when it is fitted than its slope promises."""
FITTED = 3
"""[parameters] The most promising ones, each freed in a fit of its own."""
MOSTLY = 0.8
"""[1] Share of the squared residual that it must explain then to be named: the misfit falls below a half. Damping
explains less of friction that the plant lacks."""
AS_WELL = 0.9
"""[1] Of what the best explains, from which another one is named beside it."""
SURVIVING = 1e-3
"""[1] Part of its column that the identified parameters cannot make up for, below which it tells nothing."""

NOT_IDENTIFIED = CATALOGUE(
    "parameter-not-identified", DOUBT, rank=38,
    meaning="The model misses the data, and most of the misfit goes where a parameter of the plant is free that the "
    "case neither identifies nor gives: the plant has it at its maker's value.",
    next_step="Identify it (identify: {name: {parameter: name in the plant}}), or give its value (plant: {parameters: "
    "{name in the plant: ...}}).",
)  # fmt: skip


@dataclass(frozen=True)
class _Freed:
    """A parameter that was freed: its name in the plant, the value in the case, and the fit with it."""

    name: str
    before: float
    fit: Fit

    @property
    def value(self) -> float:
        """Where the fit has it."""
        return float(self.fit.values[-1])


def unidentified_diagnostics(fit: Fit) -> list[Diagnostic]:
    """The parameter of a plant that explains most of the residual of a fit when it is freed, and those that do as well;
    nothing where none explains most of it."""
    model, ahead = fit.model, list[tuple[float, LoopModel, np.ndarray]]()
    if not isinstance(model.parameters, NamedParameters):
        return []
    base = BaseProjection.of(fit.jacobian, 1 / fit.deviation)
    rest = base.rest_of(base.weighted(fit.residual))
    for freed in _with_one_more(model):
        try:
            column = sensitivity(freed, freed.start, fit.outputs, only=[len(freed.free_parameters) - 1], exact=False)
        except FmuDidimError:
            continue
        own = base.weighted(column)[:, 0]
        beside = base.rest_of(own)
        if np.linalg.norm(beside) > SURVIVING * np.linalg.norm(own):
            share = float(beside @ rest) ** 2 / float(beside @ beside) / float(rest @ rest)
            ahead.append((share, freed, column))
    ahead = sorted((a for a in ahead if a[0] > PROMISING), key=lambda a: -a[0])[:FITTED]
    found = [f for _, freed, column in ahead if (f := _fitted(fit, freed, column)) is not None]
    found = sorted((f for f in found if _explained(fit, f) > MOSTLY), key=lambda f: f.fit.chi_square)
    return [_told(fit, [f for f in found if _explained(fit, f) > AS_WELL * _explained(fit, found[0])])] if found else []


def _with_one_more(model: LoopModel) -> Iterator[LoopModel]:
    """The model with each further parameter of its plant free."""
    loop = model.loop
    known = {*model.parameters.plant_names, *(p.key for p in model.free_parameters), *(s.key for s in loop.starts)}
    known |= {"t_start", *(name for e in model.experiments.values() for name in loop.start_values(e))}
    given = [v for v in loop.plant.parameters if v.name not in known]
    for v in given[:MOST_TRIED]:
        scale = abs(v.start) or 1.0
        yield model.with_free((*model.free_parameters, FreeParameter(v.name, v.unit, PLANT, v.name, v.start, scale)))


def _fitted(fit: Fit, freed: LoopModel, column: np.ndarray) -> _Freed | None:
    parameter = freed.free_parameters[len(freed.free_parameters) - 1]
    try:
        found = minimise(
            freed, fit.noise, stopping=Stopping(check_all=False), outputs=fit.outputs,
            jacobian=np.concatenate([fit.jacobian, column], axis=2),
        )  # fmt: skip
    except FmuDidimError:
        return None
    return _Freed(parameter.key, parameter.value, found)


def _explained(fit: Fit, freed: _Freed) -> float:
    """Share of the squared residual that is gone."""
    deviation = fit.deviation
    before, after = (float(np.sum((f.residual / deviation) ** 2)) for f in (fit, freed.fit))
    return 1 - after / before


def _told(fit: Fit, found: list[_Freed]) -> Diagnostic:
    best, measured = found[0], fit.model.measured
    before, after = (relative_error_percent(measured, f.torque)[0] for f in (fit, best.fit))
    unit = best.fit.model.free_parameters[len(best.fit.values) - 1].unit
    value = f"{best.value:.4g}" + (f" {unit}" if unit not in ("", "1") else "")
    text = (
        f"The plant has {best.name} = {best.before:.4g}, which is not identified: with {value} the torque error falls "
        f"from {before:.2g} % to {after:.2g} %"
    )
    others = [f"{f.name} = {f.value:.4g}" for f in found[1:]]
    text += f"; these data do not tell it from {', '.join(others)}." if others else "."
    step = (
        f"Identify it, identify: {{{best.name.rpartition('.')[2]}: {{parameter: {best.name}}}}}, or give its value, "
        f"plant: {{parameters: {{{best.name}: {best.value:.4g}}}}}, if that can be; else the model lacks something "
        "that looks like it."
    )
    return Diagnostic(NOT_IDENTIFIED, text, best.name, before, unit="%", next_step=step)
