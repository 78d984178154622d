"""What a valid verdict excludes: for each kind of misfit the smallest size that would have been doubted."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from fmu_didim.base.documents import Number, Saved
from fmu_didim.checks.motion.dependence import residuals_of_fit, samples_of, tested_rows
from fmu_didim.checks.motion.misfits import GRAVITY, LINK_LENGTH, TORQUE_SCALE, Misfit, Misfits
from fmu_didim.checks.power.power import POWER, JointTest, smallest_size
from fmu_didim.fit.fit import Fit

HOW_TO_CHECK = {
    TORQUE_SCALE.what: "Hold a known weight at a measured lever arm: the torque must change by weight times arm.",
    GRAVITY.what: "Look the local value up; weigh a load that changes the holding torque by a known amount.",
    LINK_LENGTH.what: "Measure the distance of the axes with a ruler.",
}
"""What is taken on trust -> how to check it."""


class StatedResult(Saved):
    """The smallest size of a misfit that would have been doubted.

    Attributes:
        effect: name of the effect in the catalogue, or of a quantity of the case.
        what: the misfit in words; place: joint or axis, empty where it is one of the whole machine.
        parameters: of the effect at that size, SI.
    """

    effect: str
    what: str
    joint: int = Field(description="counted from 1")
    place: str
    size: Number = Field(description="in the unit; null where no size up to the largest would have been doubted")
    unit: str = Field(description="of the size, as it is shown")
    largest: float = Field(description="size up to which sizes were looked at, in the unit")
    parameters: dict[str, float] = Field(description="name -> value in SI units; of a size of one unit without a size")


class TrustResult(Saved):
    """What a case says of the machine and the data cannot show, or only a large error of it.

    Attributes:
        what: in words; place: of it, empty where it is of the whole machine.
        check: how to check it.
    """

    what: str
    place: str
    size: Number = Field(description="of the smallest error that would have been doubted, in per cent; null: none is")
    check: str


class PowerResult(Saved):
    """What a valid verdict excludes.

    Attributes:
        stated: by kind and joint; trusted: what is taken on trust.
    """

    power: float = Field(description="probability with which a misfit of the stated size is doubted")
    stated: list[StatedResult]
    trusted: list[TrustResult]


def power_of_fit(fit: Fit, misfits: Misfits) -> PowerResult | None:
    """What the verdict on a fit excludes, by the test for what follows the motion; None where the plant does not give
    the motion or the joints were not tested."""
    rows, found = tested_rows(fit), misfits.stated
    residuals = residuals_of_fit(fit, rows, misfits) if found else []
    if not residuals:
        return None
    signatures = np.stack([misfit.signature[samples_of(fit, rows)] for misfit in found], axis=2)
    tests = [JointTest.of(one, signatures[:, one.joint - 1], len(residuals)) for one in residuals]
    tested = [test for test in tests if test is not None]
    if not tested:
        return None
    sizes = [smallest_size(tested, k, misfit.load.stated.largest) for k, misfit in enumerate(found)]
    pairs = list(zip(found, sizes, strict=True))
    return PowerResult(
        power=POWER, stated=[_stated(m, size) for m, size in pairs if m.load.stated.what not in HOW_TO_CHECK],
        trusted=[
            TrustResult(what=m.load.stated.what, place=m.load.place, size=size, check=HOW_TO_CHECK[m.load.stated.what])
            for m, size in pairs
            if m.load.stated.what in HOW_TO_CHECK
        ],
    )  # fmt: skip


def _stated(misfit: Misfit, size: float | None) -> StatedResult:
    load = misfit.load
    amplitudes = {name: value * (1.0 if size is None else size) for name, value in load.amplitudes.items()}
    return StatedResult(
        effect=load.effect, what=load.stated.what, joint=load.joint, place=load.place, size=size,
        unit=load.stated.unit, largest=load.stated.largest, parameters={**load.shapes, **amplitudes},
    )  # fmt: skip
