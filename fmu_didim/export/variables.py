"""The variables of an exported block, as all versions of FMI describe them alike."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import SUBSTEP_TOLERANCE, Block
from fmu_didim.export.units import derivative_unit

SUBSTEPS_NAME = "substeps"
SUBSTEPS_ATTRIBUTES = {
    "name": SUBSTEPS_NAME,
    "description": "Integration substeps in a communication step; 0: chosen from the fastest rate",
    "causality": "parameter",
    "variability": "fixed",
    "initial": "exact",
}
"""The integer parameter of the number of substeps, but for its value reference and start."""

TOLERANCE_NAME = "relative_tolerance"
TOLERANCE_ATTRIBUTES = SUBSTEPS_ATTRIBUTES | {
    "name": TOLERANCE_NAME,
    "description": "Relative accuracy of the integration in co-simulation: finer than "
    f"{SUBSTEP_TOLERANCE:g} it takes more substeps; 0: what the master states, or {SUBSTEP_TOLERANCE:g}. "
    f"'{SUBSTEPS_NAME}' overrides it",
}
"""The real parameter of the accuracy, but for its value reference and start."""


@dataclass(frozen=True)
class Layout:
    """Value references of the variables of a block: one contiguous range a group, in this order.

    Attributes:
        inputs, outputs, states, parameters: the ranges of the four groups of the block.
        derivatives: the derivatives of the states; empty for a sampled block.
        substeps: the integer parameter ``substeps``; None for a sampled block.
        time: the independent variable, where the version of FMI has one.
        tolerance: the real parameter ``relative_tolerance``; None for a sampled block.
    """

    inputs: range
    outputs: range
    states: range
    parameters: range
    derivatives: range
    substeps: int | None
    time: int
    tolerance: int | None


def layout(block: Block) -> Layout:
    """The value references of a block; they depend on the sizes of its groups only."""
    ranges = []
    end = 0
    derivatives = block.states if block.sample_time is None else ()
    for group in (block.inputs, block.outputs, block.states, block.parameters, derivatives):
        ranges.append(range(end, end + len(group)))
        end += len(group)
    inputs, outputs, states, parameters, rates = ranges
    substeps, tolerance = (end, end + 2) if block.sample_time is None else (None, None)
    return Layout(inputs, outputs, states, parameters, rates, substeps, end + 1, tolerance)


@dataclass(frozen=True)
class ExportedVariable:
    """A variable of type Real, or Float64.

    Attributes:
        reference: its value reference; own: its name, unit and description.
        attributes: causality and variability, and how its start is found.
        start: start value; state: value reference of the state whose derivative it is; None if it is not a derivative.
    """

    reference: int
    own: Variable
    attributes: dict[str, str]
    start: str | None = None
    state: int | None = None


def exported_variables(block: Block) -> Iterator[ExportedVariable]:
    """All variables of a block in the order of their value references, derivatives included."""
    refs = layout(block)
    calculated = {"variability": "continuous" if block.sample_time is None else "discrete", "initial": "calculated"}
    for reference, v in zip(refs.inputs, block.inputs, strict=True):
        # Inputs of a sampled block are continuous too: they may change at any time, and are sampled.
        given = {"causality": "input", "variability": "continuous"}
        yield ExportedVariable(reference, v, given, repr(float(v.start)))
    for causality, places, variables in (("output", refs.outputs, block.outputs), ("local", refs.states, block.states)):
        for reference, v in zip(places, variables, strict=True):
            yield ExportedVariable(reference, v, {"causality": causality, **calculated})
    for reference, v in zip(refs.parameters, block.parameters, strict=True):
        variability = "fixed" if v.name in block.fixed else "tunable"
        given = {"causality": "parameter", "variability": variability, "initial": "exact"}
        yield ExportedVariable(reference, v, given, repr(float(v.start)))
    for reference, v, state in zip(refs.derivatives, block.states, refs.states, strict=False):
        rate = Variable(f"der({v.name})", derivative_unit(v.unit), "local")
        yield ExportedVariable(reference, rate, {"causality": "local", **calculated}, state=state)
