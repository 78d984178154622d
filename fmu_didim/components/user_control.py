"""A user's python-control system, or control law, as a component."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.base.imports import run_code
from fmu_didim.components.control import ControlComponent
from fmu_didim.data.signals import Array, Variable


def is_control(value: object) -> bool:
    """Whether an object is a python-control system of any class."""
    return hasattr(value, "nstates") and hasattr(value, "input_labels")


def wrap_control(
    system: Any, *, origin: str = "", initial_state: tuple[float, ...] = (), substeps: int | None = None
) -> ControlComponent:
    """A user's python-control system as a component.

    Args:
        system: ``StateSpace``, ``TransferFunction`` (single input and output, or with slycot) or
            ``NonlinearIOSystem``; discrete systems need a numeric ``dt``.
        origin: its name, for messages and provenance.
        initial_state: start value of the state, zero by default; also the parameters ``x_start1``, ``x_start2``, ...
        substeps: RK4 substeps in a communication step of a continuous system.

    Raises:
        InputError: the object is no such system, its ``dt`` is not numeric, or the state has another size.
    """
    system = _with_states(system, origin)
    state = tuple(float(v) for v in initial_state or (0.0,) * int(system.nstates))
    if len(state) != system.nstates:
        raise InputError(
            "The initial state has another size.", where=origin, got=len(state), valid=str(system.nstates),
            next_step="Give one number for each state.",
        )  # fmt: skip
    own = {name: float(cast(float, v)) for name, v in getattr(system, "params", {}).items() if np.isscalar(v)}
    starts = {f"x_start{i}": value for i, value in enumerate(state, start=1)}
    starts = {} if set(starts) & set(own) else starts
    return ControlComponent(
        system=system,
        inputs=tuple(Variable(name, "", "input") for name in system.input_labels),
        outputs=tuple(Variable(name) for name in system.output_labels),
        parameters=tuple(Variable(name, "", "parameter", value) for name, value in {**own, **starts}.items()),
        initial_state=state,
        substeps=substeps,
        origin=origin,
        sample_time=_sample_time(system, origin),
        state_parameters=tuple(starts),
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
            "This is not a python-control system that can be simulated.", where=origin, got=type(system).__name__,
            valid="StateSpace, TransferFunction, NonlinearIOSystem",
            next_step="Build it with python-control: control.ss, control.tf or control.nlsys.",
        )  # fmt: skip
    if None in (system.nstates, system.ninputs, system.noutputs):
        raise InputError(
            "The sizes of the python-control system are unknown.",
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
            "A discrete system needs its sample time.", where=origin, got=f"dt = {system.dt}", valid="dt in seconds",
            next_step="Build the system with its sample time, such as control.ss(A, B, C, D, 0.001).",
        )  # fmt: skip
    return float(system.dt)


LAW_INPUTS = ("q_ref", "dq_ref", "ddq_ref", "q", "dq", "ddq")
"""Arguments of a control law, each the (n,) inputs ``<name><j>`` of the controller."""


def law_arguments(function: Callable[..., Any], *, origin: str = "") -> tuple[str, ...]:
    """Names of the arguments without a default; raises InputError if it cannot be called by names.

    A function without any is no law, but returns a system.
    """
    parameters = _signature(function, origin).parameters.values()
    odd = [p.name for p in parameters if p.kind not in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    names = tuple(p.name for p in parameters if p.default is p.empty)
    unknown = [name for name in names if name not in (*LAW_INPUTS, "t")]
    if odd or unknown:
        raise InputError(
            "A control law has unknown arguments: they are passed by name, not by position.",
            where=origin, got=", ".join([*odd, *unknown]), valid=(*LAW_INPUTS, "t"),
            next_step="Write it as def law(q_ref, dq_ref, q, dq): return the (n,) commands; values with a default, "
            "kp=10.0, become parameters of the controller.",
        )  # fmt: skip
    return names


def _signature(function: Callable[..., Any], origin: str) -> inspect.Signature:
    try:
        return inspect.signature(function)
    except (TypeError, ValueError) as error:
        raise InputError(
            "The arguments of this callable are unknown.", where=origin, got=type(function).__name__,
            next_step="Wrap it: def law(q_ref, dq_ref, q, dq): ...",
        ) from error  # fmt: skip


def wrap_law(function: Callable[..., Any], joint_count: int, *, origin: str = "") -> ControlComponent:
    """A control law without states, ``law(q_ref, dq_ref, q, dq) -> (n,) commands``, as a component.

    Args:
        function: takes arrays (n,) under any of the names of :data:`LAW_INPUTS`, in any order, and the time ``t`` in s.
            Numbers with a default are parameters of the controller.
        joint_count: n; origin: its name, for messages and provenance.

    Raises:
        InputError: it has other arguments, raises, or does not return (n,) numbers.
    """
    import control

    names = law_arguments(function, origin=origin)
    stems = [name for name in names if name != "t"]
    gains = {
        p.name: float(p.default)
        for p in _signature(function, origin).parameters.values()
        if isinstance(p.default, int | float) and not isinstance(p.default, bool)
    }

    def command(time: float, _: Array, u: Array, values: Mapping[str, float]) -> Array:
        given: dict[str, Any] = dict(zip(stems, np.reshape(u, (len(stems), joint_count)), strict=True))
        if "t" in names:
            given["t"] = time
        return np.asarray(function(**given, **{name: values[name] for name in gains}), dtype=float).ravel()

    _try(lambda u: command(0.0, np.zeros(0), u, gains), len(stems), joint_count, origin)
    joints = range(1, joint_count + 1)
    system = control.nlsys(
        lambda t, x, u, p: np.zeros(0), command, states=0, params=gains,
        inputs=[f"{stem}{j}" for stem in stems for j in joints], outputs=[f"command{j}" for j in joints],
    )  # fmt: skip
    return wrap_control(system, origin=origin, substeps=1)


def _try(command: Callable[[Array], Array], stems: int, joint_count: int, origin: str) -> None:
    """Raise InputError where a law does not run, returns another number of commands, or keeps a state."""
    one = np.linspace(0.1, 0.2, stems * joint_count)
    found = [
        run_code(lambda u=u: command(u), what="control law", where=origin, got=origin)  # type: ignore[misc]
        for u in (one, -2 * one, one)
    ]
    if found[0].shape != (joint_count,):
        raise InputError(
            "A control law gives one command for each joint.", where=origin, got=f"{found[0].size} numbers",
            valid=f"{joint_count} numbers",
            next_step="Return an array with one command for each joint, from the base to the tip.",
        )  # fmt: skip
    if not np.array_equal(found[0], found[2], equal_nan=True):
        raise InputError(
            "The control law gives another command for the same inputs: it keeps something from call to call, which "
            "no simulation can take back to the start.", where=origin, got=f"{found[0]}, then {found[2]}",
            next_step="Give a controller with states as a python-control system (control.nlsys) or as a component.",
        )  # fmt: skip
