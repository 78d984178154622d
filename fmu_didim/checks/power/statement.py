"""What a valid verdict excludes: for each kind of misfit the smallest size that would have been doubted."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from pydantic import Field

from fmu_didim.base.documents import Number, Saved
from fmu_didim.checks.motion.dependence import JointResidual, residuals_of_fit, samples_of, signatures_of, tested_rows
from fmu_didim.checks.motion.misfits import GRAVITY, LINK_LENGTH, TORQUE_SCALE, ZERO_TURNING, Misfit, Misfits
from fmu_didim.checks.power.power import POWER, JointTest, smallest_size
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.fit_uncertainty import fit_uncertainty, moves_of
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.model.workers import apart

HOW_TO_CHECK = {
    TORQUE_SCALE.what: "Hold a known weight at a measured lever arm: the torque must change by weight times arm.",
    GRAVITY.what: "Look the local value up; weigh a load that changes the holding torque by a known amount.",
    LINK_LENGTH.what: "Measure the distance of the axes with a ruler.",
    ZERO_TURNING.what: "Drive the joint to its mark or against its stop, and read the position there.",
}
"""What is taken on trust -> how to check it."""
EXCLUDES = "what a valid verdict excludes; null where it is another one, or that is not known"
"""Description of it in a saved document."""
TWO_DIGITS = 10.0
"""[1] From which a figure is shown without a fraction."""


class MovedResult(Saved):
    """The value that a misfit moves most, over its standard deviation, to first order.

    Attributes:
        size: of the misfit, in its unit: that from which it would have been doubted, or one where none is stated.
        parameter: name of the value.
        deviations: by which it is moved, in its standard deviations.
    """

    size: float
    parameter: str
    deviations: float
    percent: Number = Field(description="of the value; null where that is zero")

    @property
    def text(self) -> str:
        """It in words."""
        by, percent = abs(self.deviations), self.percent or 0.0
        share = f" ({percent:+.0f} %)" if abs(percent) >= TWO_DIGITS else f" ({percent:+.2g} %)" if percent else ""
        return f"{self.parameter} by {by:.{0 if by >= TWO_DIGITS else 1}f} sigma{share}"


class StatedResult(Saved):
    """The smallest size of a misfit that would have been doubted.

    Attributes:
        effect: name of the effect in the catalogue, or of a quantity of the case.
        what: the misfit in words; place: joint or axis, empty where it is one of the whole machine.
        parameters: of the effect at that size, SI.
        moves: the value that it moves most at that size.
    """

    effect: str
    what: str
    joint: int = Field(description="counted from 1")
    place: str
    size: Number = Field(description="in the unit; null where no size up to the largest would have been doubted")
    unit: str = Field(description="of the size, as it is shown")
    largest: float = Field(description="size up to which sizes were looked at, in the unit")
    parameters: dict[str, float] = Field(description="name -> value in SI units; of a size of one unit without a size")
    moves: MovedResult | None = None


class TrustResult(Saved):
    """What a case says of the machine and the data cannot show, or only a large error of it.

    Attributes:
        what: in words; place: of it, empty where it is of the whole machine.
        unit: of the size.
        check: how to check it.
        moves: the value that it moves most at that size.
    """

    what: str
    place: str
    size: Number = Field(description="of the smallest error that would have been doubted, in the unit; null: none is")
    unit: str = "%"
    check: str
    moves: MovedResult | None = None


class PowerResult(Saved):
    """What a valid verdict excludes.

    Attributes:
        stated: by kind and joint; trusted: what is taken on trust.
    """

    power: float = Field(description="probability with which a misfit of the stated size is doubted")
    stated: list[StatedResult]
    trusted: list[TrustResult]


def power_of_fit(
    fit: Fit, misfits: Misfits, deviation: Array | None = None, joints: Sequence[JointResidual] | None = None
) -> PowerResult | None:
    """What the verdict on a fit excludes, by the test for what follows the motion; None where the plant does not give
    the motion or the joints were not tested.

    Args:
        deviation: (p,) standard deviations of the values; by default those of the noise.
        joints: what the test looked at, where it is known.
    """
    rows, found = tested_rows(fit), misfits.stated
    if not found:
        return None
    table = moves_of(fit, [misfit.signature for misfit in found])  # before there are tables of all joints
    residuals = residuals_of_fit(fit, rows, misfits) if joints is None else joints
    if not residuals:
        return None
    places = samples_of(fit, rows)
    tests = [JointTest.of(one, signatures_of(found, places, one.joint), len(residuals)) for one in residuals]
    tested = [test for test in tests if test is not None]
    if not tested:
        return None
    searches = [partial(smallest_size, tested, k, misfit.load.stated.largest) for k, misfit in enumerate(found)]
    sizes = apart(searches, fit.model.threads)
    deviation = np.maximum(fit_uncertainty(fit).deviation if deviation is None else deviation, TINY)
    moved = [_moved(fit, *one, deviation) for one in zip(sizes, table.T, strict=True)]
    told = list(zip(found, sizes, moved, strict=True))
    return PowerResult(
        power=POWER, stated=[_stated(*one) for one in told if one[0].load.stated.what not in HOW_TO_CHECK],
        trusted=[
            TrustResult(
                what=m.load.stated.what, place=m.load.place, size=size, unit=m.load.stated.unit,
                check=HOW_TO_CHECK[m.load.stated.what], moves=moves,
            )
            for m, size, moves in told
            if m.load.stated.what in HOW_TO_CHECK
        ],
    )  # fmt: skip


def _moved(fit: Fit, size: float | None, moves: Array, deviation: Array) -> MovedResult:
    """What a misfit of a size, of one without a size, moves most; ``moves``: (p,) of the values by a size of one."""
    taken = 1.0 if size is None else size
    most = int(np.argmax(np.abs(moves) / deviation))
    by, value = float(taken * moves[most]), abs(float(fit.values[most]))
    return MovedResult(
        size=taken, parameter=fit.model.names[most], deviations=by / float(deviation[most]),
        percent=100 * by / value if value else None,
    )  # fmt: skip


def _stated(misfit: Misfit, size: float | None, moves: MovedResult) -> StatedResult:
    load = misfit.load
    amplitudes = {name: value * (1.0 if size is None else size) for name, value in load.amplitudes.items()}
    return StatedResult(
        effect=load.effect, what=load.stated.what, joint=load.joint, place=load.place, size=size,
        unit=load.stated.unit, largest=load.stated.largest, parameters={**load.shapes, **amplitudes}, moves=moves,
    )  # fmt: skip
