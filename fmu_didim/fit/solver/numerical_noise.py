"""How far the step control of a foreign plant limits an answer: deviations by a second step, jitter of the torque.

Where a simulation jitters by J when a parameter changes ever so little, neither is the sensitivity exact, on which the
standard deviations depend, nor is the minimum: it scatters as it would by noise of the size of J.

What counts is by how much the columns of the sensitivity err beside their smallest singular value. Up to a fifth of it,
values and deviations are those without jitter, to half a standard deviation and 5 %. From two fifths on, values scatter
by a third of a deviation, deviations come out up to a tenth too small, and a few fits do not settle. Beyond, they are
reported as rough: a second step then changes a deviation by more than a tenth. Where two columns are the same to 0.3 %,
those limits are jitters of 1 % and 3 % of the noise. The width of the pieces in which the torque is smooth does not
matter, unless it comes near the standard deviations: each piece may then have a minimum of its own, and a few fits do
not settle (``tests/fit/test_numerical_noise.py``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.component import foreign_co_simulation
from fmu_didim.components.fmu.description import MODEL_EXCHANGE
from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives.differences import DIFFERENCE_STEPS, Ladder, jitter_in
from fmu_didim.fit.derivatives.sensitivity import step_size
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.weighting import whitened
from fmu_didim.fit.statistics import covariance_white
from fmu_didim.model.loop_model import LoopModel

TINY_CHANGES = (1e-6, 2e-6, 5e-6)
"""[1] Of all values, to see whether the torque jitters: it changes by as little where it does not, a thousand times
as much where it does; three, since by chance one may show none."""
SMOOTHER = 0.1
"""[1] Fraction of its jitter below which a loop with other wiring counts as smoother."""


@dataclass(frozen=True)
class Roughness:
    """Uncertainty that central differences leave.

    Attributes:
        change: largest relative change of a standard deviation when the sensitivities are taken with a second step.
        parameter: whose it is.
        jitter: of the simulated torque when a parameter changes ever so little, in standard deviations of its residual.
    """

    change: float
    parameter: str
    jitter: float


def roughness(fit: Fit, sizes: Array | None = None) -> Roughness | None:
    """Roughness of a loop at a fit, by two simulations a column; None where no column is a central difference.

    Args:
        sizes: of the base parameters, as the steps of the fit were taken with.
    """
    if not fit.steps:
        return None
    first = whitened(fit.jacobian, fit.deviation)
    second = whitened(_at_second_steps(fit, sizes), fit.deviation)
    tables = (fit.model.beside_prior(table) for table in (first, second))
    deviations = [np.sqrt(np.diag(covariance_white(table))) for table in tables]
    change = np.maximum(deviations[0] / deviations[1], deviations[1] / deviations[0]) - 1
    worst = int(np.argmax(change))
    return Roughness(float(change[worst]), fit.model.names[worst], jitter_in(fit.steps, fit.deviation))


def smoother_after_step(model: LoopModel) -> str:
    """The foreign FMU because of which the torque jitters, if its outputs after its step do not; or "".

    Between two steps an FMU in co-simulation may answer from where its solver has got to, which is beyond the end of
    the last step by chance.
    """
    label = model.first
    system = model.loop.systems[label]
    now = _jitter(model, label)
    for name, component in system.components.items():
        fmu = foreign_co_simulation(component)
        if fmu is None or name in system.after_step or fmu.feedthrough() == frozenset():
            continue
        other = replace(system, after_step=system.after_step | {name})
        try:
            after = _jitter(model.with_loop(systems={**model.loop.systems, label: other}), label)
        except FmuDidimError:  # a loop that is wired otherwise, or that such a delay makes unstable
            continue
        if after < SMOOTHER * now:
            return name
    return ""


def smoother_advice(model: LoopModel) -> str:
    """What makes the outputs of the foreign FMUs of a loop smoother, of what each of them offers; "" without any."""
    found = []
    for name, component in model.loop.systems[model.first].components.items():
        fmu = foreign_co_simulation(component)
        if fmu is None:
            continue
        smaller = f"a smaller tolerance of its own solver ({name}: {{tolerance: 1e-9}}, if the FMU uses it)"
        if fmu.fmu.interface(MODEL_EXCHANGE) is not None:
            found.append(
                f"Run the {name} with our integrator ({name}: {{interface: model-exchange}}), or with {smaller}."
            )
        else:
            found.append(
                f"Run the {name} with {smaller}; this FMU offers no model exchange, in which our integrator would run "
                "it. Outputs that step by design, as of an encoder, a converter or a switch, stay rough."
            )
    return " ".join(found)


def _jitter(model: LoopModel, label: str) -> float:
    """Largest change of the torque by tiny changes of all values, as a fraction of it."""
    torque = model.torque(model.start, label)
    moved = [model.torque(model.start * (1 + part), label) - torque for part in TINY_CHANGES]
    return float(max(np.linalg.norm(change) for change in moved) / np.linalg.norm(torque))


def _at_second_steps(fit: Fit, sizes: Array | None) -> Array:
    """The sensitivity (M, m, p) with other steps of the columns that are central differences."""
    model, table = fit.model, fit.jacobian.copy()
    rows: Mapping[str, slice] = model.experiments.output_rows
    length = np.linalg.norm(fit.jacobian / fit.deviation[:, None], axis=(0, 1))
    for (label, i), step in fit.steps.items():
        size = step_size(model, i, sizes)
        ladder = Ladder(fit.simulation(label), fit.outputs[rows[label]], i, size)
        for place in _second_places(step.place, 1 / max(float(length[i]) * size, DIFFERENCE_STEPS[0])):
            found = ladder.at(place)
            if found is not None:
                table[rows[label], :, i] = found.column
                break
    return table


def _second_places(place: int, deviation: float) -> list[int]:
    """Steps to verify one with: as long as a parameter is uncertain by itself, relative to its size, but longer than
    the first and not the longest; or else the next ones.

    What slopes are right in is a change by a standard deviation.
    """
    last = len(DIFFERENCE_STEPS) - 1
    uncertain = sum(step < deviation for step in DIFFERENCE_STEPS)
    wanted = [min(uncertain, last - 1), place + 1]
    return [*(found for found in wanted if place < found <= last), *([place - 1] if place else [])]
