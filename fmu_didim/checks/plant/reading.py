"""Whether reading the outputs of an FMU disturbs it: what was done about it, or a doubt."""

from __future__ import annotations

from collections.abc import Collection

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.components import FmuComponent
from fmu_didim.cosim import System
from fmu_didim.cosim.readings import readings

READING_MATTERS = 1e-4
"""[1] Change of an output by reading, as a fraction of its largest value, from which it is doubted: less is below the
noise of any log. Dymola 2023: 4e-3."""

READ_AFTER_STEPS = CATALOGUE(
    "outputs-after-last-step", REMARK, rank=92,
    meaning="Reading the outputs of an FMU between its inputs and its step changes what follows. None that is used "
    "follows the inputs at once, so that those after the last step are taken, which are the same.",
    next_step="Nothing; to have them read there all the same: plant: {outputs_after_step: false}.",
)  # fmt: skip
READING_ACTS = CATALOGUE(
    "reading-acts", DOUBT, rank=12,
    meaning="Reading the outputs of an FMU between its inputs and its step changes what follows, and one that is used "
    "follows the inputs at once, so that the case must say when it holds: before the step or, one period later, after "
    "it. No effect in drives, sensors or the clock of the log is named meanwhile: it could be a consequence.",
    next_step="Say when its outputs hold: controller: {outputs_after_step: true} of a controller that computes its "
    "command in the step, else false; or run it with interface: model-exchange.",
)  # fmt: skip


def reading_diagnostics(system: System, stated: Collection[str]) -> list[Diagnostic]:
    """What reading does to the FMUs of a loop.

    Args:
        stated: names of the components of which the case says when their outputs hold.
    """
    found = []
    for name, outputs in readings(system).items():
        component, change = system.components[name], f"{outputs.output} by {100 * outputs.reading.change:.2g} %"
        if isinstance(component, FmuComponent) and not component.reads_between:
            text = f"Its outputs are those after the last step: reading them before a step changes {change}."
            found.append(Diagnostic(READ_AFTER_STEPS, text, name, outputs.reading.change))
        elif name not in stated and outputs.reading.change > READING_MATTERS:
            at_once = ", ".join(sorted(outputs.used & outputs.at_once))
            text = f"Reading its outputs before a step changes {change}, and {at_once} follows the inputs at once."
            step = (
                f"If it computes that in its step, write {name}: {{outputs_after_step: true}}, else false; or run it "
                "with interface: model-exchange."
            )
            found.append(
                Diagnostic(READING_ACTS, text, name, outputs.reading.change, READING_MATTERS, "1", next_step=step)
            )
    return found
