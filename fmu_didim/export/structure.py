"""Which variables of a block depend on which, from the sparsity of its equations."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca

from fmu_didim.dynamics.block import Block
from fmu_didim.export.variables import layout

Dependencies = dict[int, list[int]]
"""Value references of the variables that each variable depends on; all in ascending order."""


@dataclass(frozen=True)
class Structure:
    """FMI's model structure of a block, by value references.

    Attributes:
        outputs, derivatives: dependence on inputs and continuous states.
        initial: dependence of what initialisation calculates on inputs and parameters.
    """

    outputs: Dependencies
    derivatives: Dependencies
    initial: Dependencies


def model_structure(block: Block) -> Structure:
    """The structure of a block; a sampled block has no continuous states, and its discrete ones do not count."""
    refs = layout(block)
    x = ca.MX.sym("x", len(refs.states))
    u = ca.MX.sym("u", len(refs.inputs))
    p = ca.MX.sym("p", len(refs.parameters))
    running = ca.Function("running", [x, u, p], [block.output(x, u, p), block.update(x, u, p)])
    first = block.start(u, p)
    initial = ca.Function("initial", [u, p], [block.output(first, u, p), block.update(first, u, p), first])
    sampled = block.sample_time is not None
    knowns = [(1, refs.inputs)] if sampled else [(1, refs.inputs), (0, refs.states)]
    calculated = {0: refs.outputs} if sampled else {0: refs.outputs, 1: refs.derivatives, 2: refs.states}
    return Structure(
        outputs=_dependencies(running, {0: refs.outputs}, knowns),
        derivatives=_dependencies(running, {1: refs.derivatives}, knowns),
        initial=_dependencies(initial, calculated, [(0, refs.inputs), (1, refs.parameters)]),
    )


def _dependencies(
    function: ca.Function, unknowns: dict[int, range], knowns: Iterable[tuple[int, range]]
) -> Dependencies:
    """For each row of the results of a function, the value references of the arguments it depends on."""
    found: dict[int, set[int]] = {reference: set() for rows in unknowns.values() for reference in rows}
    for result, rows in unknowns.items():
        for argument, columns in knowns:
            if rows and columns:
                for row, column in zip(*function.jac_sparsity(result, argument).get_triplet(), strict=True):
                    found[rows[row]].add(columns[column])
    return {reference: sorted(found[reference]) for reference in sorted(found)}
