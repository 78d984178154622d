"""Whether a reference is in other units than it should be: degrees for radians, millimetres for metres.

The torque of the nominal values along the reference, W(q, dq, ddq) theta + known, is compared with the log for the
reference as it is and converted. Scale and shape decide together, so that start values may be off by a factor of three:

    u = mean over the joints of  1 - corr_j + |ln ratio_j| / ln OTHER_UNIT
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, Diagnostic
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.checks.data.expected import Expected
from fmu_didim.checks.data.torque_channel import OTHER_UNIT, correlation_and_ratio
from fmu_didim.data.signals import Array
from fmu_didim.estimators.reference_start import rows_on, whole_reference
from fmu_didim.model.loop_model import Simulation

UNLIKE = 1.0
"""[1] Unlikeness of the log to the torque of the nominal values along the reference, 1 - correlation + |ln ratio| /
ln OTHER_UNIT, mean over the joints, from which other units of the reference are tried,"""
LIKE = 0.5
"""[1] and below which they explain the log."""
LARGEST_RANGE = 4 * math.pi
"""[rad] Of a joint, two turns: if degrees explain the log, they are taken for granted."""
LARGEST_STROKE = 20.0
"""[m] Of a joint: if millimetres explain the log, they are as well."""

REFERENCE_UNIT = CATALOGUE(
    "reference-unit", PROBLEM, rank=0,
    meaning="The reference is in degrees or millimetres, not in rad or m: its range is beyond that of any machine, and "
    "converted it explains the log.",
    next_step="Convert the reference to rad and m, with its derivatives.",
)  # fmt: skip
REFERENCE_UNIT_DOUBT = CATALOGUE(
    "reference-unit-doubtful", DOUBT, rank=2,
    meaning="The log looks like that of the reference converted from degrees to rad or from millimetres to m; the "
    "range of the motion is possible either way.",
    next_step="Check the unit of the reference; it must be rad or m, with its derivatives.",
)  # fmt: skip
UNITS = (("N.m", "degrees", math.pi / 180, LARGEST_RANGE, "rad"), ("N", "millimetres", 0.001, LARGEST_STROKE, "m"))
"""Unit of torque of the joints that are asked -> unit suspected, factor, largest range that a machine has."""


def unit_diagnostics(run: Simulation, given: Expected) -> list[Diagnostic]:
    """Other units of the reference that explain the log where the right ones do not."""
    if given.columns is None or unlikeness(given.measured, _nominal(run, given.columns, given.known)) <= UNLIKE:
        return []
    reference = run.experiment.reference
    for kind, words, factor, largest, unit in UNITS:
        joints = [j for j, of in enumerate(run.model.parameters.torque_units, start=1) if of == kind]
        if not joints:
            continue
        names = {f"{signal}{j}" for signal in ("q", "dq", "ddq") for j in joints}
        scale = [factor if name in names else 1.0 for name in reference.names]
        converted = replace(reference, values=reference.values * scale)
        other = run.on(replace(run.experiment, reference=converted))
        try:
            columns, known = rows_on(other, whole_reference(other))
        except FmuDidimError:
            continue
        left = unlikeness(given.measured, _nominal(run, columns, known))
        if left <= LIKE:
            widest = max(float(np.ptp(reference.column(f"q{j}"))) for j in joints)
            code = REFERENCE_UNIT if widest > largest else REFERENCE_UNIT_DOUBT
            text = (
                f"The reference seems to be in {words}: converted, it explains the log, and its range is {widest:.4g}."
            )
            return [Diagnostic(code, text, run.label, widest, largest, unit)]
    return []


def unlikeness(measured: Array, expected: Array) -> float:
    """How unlike a torque is to the expected one, (N, n) each: the mean u over the joints that move."""
    correlation, ratio = correlation_and_ratio(measured, expected)
    with np.errstate(divide="ignore"):
        difference = np.abs(np.log(np.maximum(ratio, 0.0))) / math.log(OTHER_UNIT)
    moving = np.ptp(measured, axis=0) > 0
    if not moving.any():
        return 0.0
    # One joint that has nothing in common with its torque counts as two that are opposite.
    return float(np.mean(np.minimum(1 - correlation + difference, 2.0)[moving]))


def _nominal(run: Simulation, columns: Array, known: Array | None) -> Array:
    torque = columns @ run.values[: columns.shape[2]]
    return torque if known is None else torque + known
