"""Names of variables that a component lacks, or that are not of the kind that is asked for."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from fmu_didim.base.errors import InputError
from fmu_didim.components import Component, FmuComponent
from fmu_didim.components.fmu.chosen import states_of, visible

START = ".start"
"""What follows the name of a variable in the name of the parameter that is where it starts."""
NEAREST = 5
"""[names] That a message lists of all that are valid: models have thousands."""
ALIKE = 0.5
"""[1] Likeness of two names from which one may have been meant, by difflib; its own 0.6 loses ``room.T`` for ``T``."""


def unknown(kind: str, name: str, valid: Iterable[str], *, where: str, more: str = "") -> InputError:
    """The error of a name that a model lacks: the nearest valid ones, and how many there are.

    Args:
        more: another next step.
    """
    names = list(dict.fromkeys(valid))
    folded: dict[str, str] = {one.casefold(): one for one in reversed(names)}
    inside = [one for one in names if name.casefold() in one.casefold().replace("]", ".").split(".")]
    alike = [folded[one] for one in difflib.get_close_matches(name.casefold(), folded, n=NEAREST, cutoff=ALIKE)]
    near = list(dict.fromkeys([*inside, *alike]))[:NEAREST]
    listed = near if len(names) > NEAREST else names
    valid_text = ", ".join(listed) + (f"; {len(names)} in all" if len(names) > len(listed) else "")
    step = f"Did you mean {' or '.join(repr(one) for one in near)}?" if near else "Take one that the model has."
    if len(names) > NEAREST:
        step += " fmu-didim fmu info FILE lists them."
    return InputError(
        f"There is no {kind} named '{name}'.", where=where, got=name, valid=valid_text or "none",
        next_step=more or step,
    )  # fmt: skip


def unknown_parameter(model: Component, name: str, *, where: str) -> InputError:
    """The error of a name under ``identify`` that is no parameter of the model, but perhaps another variable."""
    valid = [v.name for v in model.parameters]
    more = ""
    if isinstance(model, FmuComponent):
        states = states_of(model)
        valid += [f"{state}{START}" for state in states]
        if name in states:
            more = f"It is a state. Where it starts is '{name}{START}': identify: {{{name}{START}: {{}}}}."
        elif name in {v.name for v in model.inputs}:
            more = "It is an input, which inputs: gives."
        elif name in visible(model):
            more = "The model computes it: identify a parameter that it depends on, or give it under measured:."
    return unknown("parameter of the model", name, valid, where=where, more=more)
