"""Whether a reference or measured positions are in other units than they should be: degrees, millimetres.

The torque of the start values along the reference, W(q, dq, ddq) theta + known, or simulated where the plant has no
regressor, is compared with the log as the reference is and with its columns converted. Scale and shape decide together,
so that start values may be off by a factor of three:

    u = mean over the joints of  1 - corr_j + |ln ratio_j| / ln OTHER_UNIT

Measured positions are compared with the reference, which they follow: the ratio of their ranges is one.
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
ROUGHLY = 1.5
"""[1] Factor within which two ranges are in the ratio of two units: a joint follows its reference to some percent."""
GIVE_UNIT = "columns: {q1: {name: q1, unit: deg}}; in Python Reference(t, q, unit='deg')"

REFERENCE_UNIT = CATALOGUE(
    "reference-unit", PROBLEM, rank=0,
    meaning="The reference is in degrees or millimetres, not in rad or m: its range is beyond that of any machine, and "
    "converted it explains the log.",
    next_step=f"Give its unit, {GIVE_UNIT}, or convert it to rad and m, with its derivatives.",
)  # fmt: skip
REFERENCE_UNIT_DOUBT = CATALOGUE(
    "reference-unit-doubtful", DOUBT, rank=2,
    meaning="The log looks like that of the reference converted from degrees to rad or from millimetres to m; the "
    "range of the motion is possible either way.",
    next_step=f"Check the unit of the reference. If it is not rad or m: {GIVE_UNIT}.",
)  # fmt: skip
POSITIONS_UNIT = CATALOGUE(
    "positions-unit", DOUBT, rank=2,
    meaning="The measured positions move as far as the reference would in another unit: degrees for rad, or "
    "millimetres for m.",
    next_step=f"Check the unit of the positions and of the reference. If it is not rad or m: {GIVE_UNIT}.",
)  # fmt: skip
UNITS = (("N.m", "degrees", math.pi / 180, LARGEST_RANGE, "rad"), ("N", "millimetres", 0.001, LARGEST_STROKE, "m"))
"""Unit of torque of the joints that are asked -> unit suspected, factor, largest range that a machine has."""


def unit_diagnostics(run: Simulation, given: Expected) -> list[Diagnostic]:
    """Units of the reference that would explain the log where those that it should have do not."""
    reference, count = run.experiment.reference, run.model.joint_count
    along = _nominal(run, given.columns, given.known) if given.columns is not None else given.nominal
    if not {f"q{j}" for j in range(1, count + 1)} <= set(reference.names) or (
        along is not None and unlikeness(given.measured, along) <= UNLIKE
    ):
        return []
    for kind, words, factor, largest, unit in UNITS:
        joints = _joints(run, kind)
        if not joints:
            continue
        names = {f"{signal}{j}" for signal in ("q", "dq", "ddq") for j in joints}
        scale = [factor if name in names else 1.0 for name in reference.names]
        converted = replace(reference, values=reference.values * scale)
        other = run.on(replace(run.experiment, reference=converted))
        try:
            regressor = run.model.parameters.has_regressor
            torque = _nominal(run, *rows_on(other, whole_reference(other))) if regressor else other.torque()
        except FmuDidimError:
            continue
        if unlikeness(given.measured, given.kept(torque)) <= LIKE:
            widest = max(float(np.ptp(reference.column(f"q{j}"))) for j in joints)
            code = REFERENCE_UNIT if widest > largest else REFERENCE_UNIT_DOUBT
            text = (
                f"The reference seems to be in {words}: converted, it explains the log, and its range is {widest:.4g}."
            )
            return [Diagnostic(code, text, run.label, widest, largest, unit)]
    return []


def position_diagnostics(run: Simulation) -> list[Diagnostic]:
    """Units of the measured positions that differ from those of the reference; nothing without positions."""
    reference, positions = run.experiment.reference, run.experiment.positions
    if positions is None:
        return []
    common = set(reference.names) & set(positions.names)
    for kind, words, factor, _, _ in UNITS:
        for name in (f"q{j}" for j in _joints(run, kind) if f"q{j}" in common):
            planned, measured = (float(np.ptp(table.column(name))) for table in (reference, positions))
            if not planned or not measured:
                continue
            larger, smaller = ("measured positions", "reference")[:: 1 if measured > planned else -1]
            ratio = max(measured / planned, planned / measured)
            if 1 / ROUGHLY < ratio * factor < ROUGHLY:
                text = (
                    f"The {larger} may be in {words}: the range of {name} is {ratio:.4g} times that of the {smaller}."
                )
                return [Diagnostic(POSITIONS_UNIT, text, run.label, ratio, 1.0)]
    return []


def _joints(run: Simulation, kind: str) -> list[int]:
    return [j for j, of in enumerate(run.model.parameters.torque_units, start=1) if of == kind]


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
