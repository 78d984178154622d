"""What is taken on trust: parameters that are not identified, and whose errors the identified ones make up for.

With the sensitivities S of these and the change c of the outputs by a tenth more of such a parameter, the values move
by S^+ c, and |c - S S^+ c|, in standard deviations of the noise, is all that shows.
"""

from __future__ import annotations

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.checks.judgement import CONDITIONAL
from fmu_didim.checks.motion.colour import orthonormal, rest_of
from fmu_didim.checks.motion.dependence import independent
from fmu_didim.checks.outputs.residuals import OutputResiduals
from fmu_didim.checks.outputs.suspects import held_parameters, moved_parameter, with_unit
from fmu_didim.data.signals import Array

TENTH = 0.1
"""[1] Change of a held parameter that is asked about."""
TRIED = 20
"""[parameters] At most, a simulation each."""
UNSEEN = 4.0
"""[standard deviations] Of all that shows of such a change, below which the data do not tell it."""
MOVES = 1.0
"""[standard deviations] By which it moves a value, from which that is said."""

TAKEN_ON_TRUST = CATALOGUE(
    "parameter-on-trust", REMARK, rank=66,
    meaning="An error of a parameter that is not identified would move the identified ones by more than their standard "
    "deviations, and the data would not show it: the values are as right as that parameter.",
    next_step="Know it, or measure something that shows it.",
)  # fmt: skip


def trusted_diagnostics(found: OutputResiduals, deviation: Array) -> list[Diagnostic]:
    """Held parameters on whose values the identified ones rest; ``deviation``: (p,) of these."""
    table = found.whitened(found.jacobian)
    basis, told = orthonormal(independent(table)), []
    for free in held_parameters(found.model)[:TRIED]:
        change = TENTH * free.value
        if not change:
            continue
        try:
            column = found.whitened(moved_parameter(free)(found, change))
        except FmuDidimError:
            continue
        if not np.isfinite(column).all() or np.linalg.norm(rest_of(column, basis)) > UNSEEN:
            continue
        moved = np.asarray(-np.linalg.lstsq(table, column, rcond=None)[0], dtype=np.float64)
        shown = [i for i in np.argsort(-np.abs(moved / deviation)) if abs(moved[i]) > MOVES * deviation[i]]
        if shown:
            value, by = with_unit(f"{free.value:.4g}", free.unit), abs(moved[shown[0]] / deviation[shown[0]])
            told.append(_told(found, free.key, value, moved, shown, float(by)))
    return told


def _told(
    found: OutputResiduals, name: str, value: str, moved: Array, shown: list[np.intp], deviations: float
) -> Diagnostic:
    """The remark on a held parameter, and where it moves a value farther than noise could, what a verdict rests on;
    ``deviations``: by which it moves the first that is shown."""
    texts = []
    for i in shown:
        size = abs(float(found.values[i]))
        by = f"{100 * moved[i] / size:+.2g} %" if size else f"{moved[i]:+.2g}"
        texts.append(f"{found.model.names[i]} {by}")
    text = (
        f"its {value} are taken on trust: with {100 * TENTH:.0f} % more the data would be explained as well, by other "
        f"values: {', '.join(texts)}."
    )
    condition = (
        f"{name} = {value} is right: {100 * TENTH:.0f} % more would not show, but move {found.model.names[shown[0]]} "
        f"by {deviations:.0f} sigma" if deviations > CONDITIONAL else ""
    )  # fmt: skip
    return Diagnostic(TAKEN_ON_TRUST, text, name, condition=condition)
