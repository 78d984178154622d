"""A user's python-control system as a component."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.components.control import ControlComponent
from fmu_didim.data.signals import Variable


def wrap_control(
    system: Any, *, origin: str = "", initial_state: tuple[float, ...] = (), substeps: int | None = None
) -> ControlComponent:
    """A user's python-control system as a component.

    Args:
        system: ``StateSpace``, ``TransferFunction`` (single input and output, or with slycot) or
            ``NonlinearIOSystem``; discrete systems need a numeric ``dt``.
        origin: its name, for messages and provenance.
        initial_state: start value of the state, zero by default.
        substeps: RK4 substeps in a communication step of a continuous system.

    Raises:
        InputError: the object is no such system, its ``dt`` is not numeric, or the state has another size.
    """
    system = _with_states(system, origin)
    state = initial_state or (0.0,) * int(system.nstates)
    if len(state) != system.nstates:
        raise InputError("The initial state has another size.", where=origin, got=len(state), valid=str(system.nstates))
    return ControlComponent(
        system=system,
        inputs=tuple(Variable(name, "", "input") for name in system.input_labels),
        outputs=tuple(Variable(name) for name in system.output_labels),
        parameters=tuple(
            Variable(name, "", "parameter", float(cast(float, value)))
            for name, value in getattr(system, "params", {}).items()
            if np.isscalar(value)
        ),
        initial_state=tuple(float(v) for v in state),
        substeps=substeps,
        origin=origin,
        sample_time=_sample_time(system, origin),
    )


def _with_states(system: Any, origin: str) -> Any:
    """The system as equations of states, with known sizes."""
    import control

    if isinstance(system, control.TransferFunction):
        try:
            system = control.ss(system)
        except ValueError as error:
            raise InputError(
                "This transfer function cannot be simulated.",
                where=origin,
                got=str(error),
                next_step="Its numerator must not have a higher degree than its denominator.",
            ) from error
        except control.ControlMIMONotImplemented as error:
            raise InputError(
                "A transfer function with several inputs or outputs needs the package slycot.",
                where=origin,
                next_step="Give a StateSpace, or install slycot.",
            ) from error
    if not isinstance(system, control.StateSpace | control.NonlinearIOSystem):
        raise InputError(
            "This is not a python-control system that can be simulated.",
            where=origin,
            got=type(system).__name__,
            valid="StateSpace, TransferFunction, NonlinearIOSystem",
        )
    if None in (system.nstates, system.ninputs, system.noutputs):
        raise InputError(
            "The python-control system does not say its sizes.",
            where=origin,
            next_step="Give inputs, outputs and states to control.nlsys.",
        )
    return system


def _sample_time(system: Any, origin: str) -> float | None:
    """In seconds; None for a continuous system."""
    if not system.isdtime(strict=True):
        return None
    if system.dt is True or not system.dt > 0:
        raise InputError(
            "A discrete system needs its sample time.", where=origin, got=f"dt = {system.dt}", valid="dt in seconds"
        )
    return float(system.dt)
