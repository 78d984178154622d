"""The timing that a case asks for: own rates, delays in samples or seconds, outputs after the step."""

from __future__ import annotations

from dataclasses import replace

from fmu_didim.case.document import CaseDocument
from fmu_didim.components import Component
from fmu_didim.errors import InputError
from fmu_didim.master import System

TOLERANCE = 1e-6
"""Relative distance of two rates from a whole ratio that still counts as rounding of the numbers in the file."""


def communication_step(document: CaseDocument, controller: Component) -> float:
    """Step h of the loop in s: ``loop.rate_hz``, else ``controller.rate_hz``, else the controller's sample time."""
    own = None if document.controller is None else document.controller.rate_hz
    for rate in (document.loop.rate_hz, own):
        if rate is not None:
            return 1.0 / rate
    if controller.sample_time is None:
        raise InputError(
            "The control rate is unknown.", where="loop",
            next_step="Give loop: {rate_hz: ...}; this controller states none.",
        )  # fmt: skip
    return controller.sample_time


def delay_in_samples(document: CaseDocument, step: float) -> float:
    """Delay of the command in samples of the loop."""
    if document.loop.delay_s is not None:
        return document.loop.delay_s / step
    return document.loop.delay_samples


def with_timing(system: System, document: CaseDocument) -> System:
    """The loop with the rates of its components and the treatment of algebraic loops that the case asks for.

    Raises:
        InputError: a rate is no whole multiple or divisor of the rate of the loop.
    """
    every: dict[str, int] = {}
    substeps: dict[str, int] = {}
    assert document.controller is not None  # else the loop is that of an archive, with its own timing
    sources = {"controller": document.controller, "plant": document.plant}
    for name, source in sources.items():
        if source.rate_hz is None:
            continue
        ratio = 1.0 / (system.step_size * source.rate_hz)
        if _is_whole(ratio):
            every[name] = round(ratio)
        elif _is_whole(1.0 / ratio):
            substeps[name] = round(1.0 / ratio)
        else:
            raise InputError(
                "The rate of a component must be a whole multiple or divisor of the rate of the loop.",
                where=f"{name}.rate_hz", got=f"{source.rate_hz:g} Hz in a loop of {1.0 / system.step_size:g} Hz",
                next_step="Choose loop: {rate_hz: ...} as a common multiple.",
            )  # fmt: skip
    return replace(
        system,
        every=every,
        substeps=substeps,
        after_step=frozenset(name for name, source in sources.items() if source.outputs_after_step),
        algebraic_loops=document.loop.algebraic_loops,
    )


def _is_whole(ratio: float) -> bool:
    return ratio >= 1 - TOLERANCE and abs(ratio - round(ratio)) <= TOLERANCE * ratio
