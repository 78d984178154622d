"""What a choice that the data do not decide does to the values: one step from the answer with another choice.

With the influence G of the outputs on the values and the residual r at the answer, both with another choice, the values
move by

    d = G_other r_other - G r

to first order. As nobody knows which choice is right, d counts as the half width of a rectangular distribution, whose
variance is d d' / 3 (JCGM 100:2008, 4.3.7): an interval of 95 % then holds the values of the other choice, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.fit_uncertainty import influences
from fmu_didim.model.loop_model import LoopModel


@dataclass(frozen=True)
class Choices:
    """Other choices than the one of an estimate, and what they do to its values.

    Attributes:
        chosen: what was chosen, in words.
        shifts: another choice, in words -> (p,) by which it moves the values.
        failed: other choices with which the loop cannot be simulated, and why.
        noise_alone: (p,) standard deviations of the values as if the choice was right.
    """

    chosen: str
    shifts: Mapping[str, Array]
    failed: Mapping[str, str]
    noise_alone: Array

    @property
    def largest(self) -> Array:
        """(p,) the largest shift of each value, without sign."""
        return np.asarray(np.abs([np.zeros(self.noise_alone.size), *self.shifts.values()]).max(axis=0))

    @property
    def covariance(self) -> Array:
        """(p, p) what the choice adds to the covariance of the values."""
        p = self.noise_alone.size
        return np.asarray(sum((np.outer(d, d) / 3 for d in self.shifts.values()), np.zeros((p, p))))


def choices_of(fit: Fit, chosen: str, others: Mapping[str, LoopModel], noise_alone: Array) -> Choices:
    """What other choices do to the values of a fit.

    Args:
        others: another choice, in words -> the model with it; its logs have the same samples.
    """
    own, shifts, failed = _step(fit), dict[str, Array](), dict[str, str]()
    for words, model in others.items():
        try:
            shifts[words] = _step(_at(fit, model)) - own
        except FmuDidimError as error:
            failed[words] = error.what
    return Choices(chosen, shifts, failed, noise_alone)


def _at(fit: Fit, model: LoopModel) -> Fit:
    """The same values with another model, integrated as finely."""
    loop = fit.model.loop
    model = replace(model, free_parameters=fit.model.free_parameters)
    model = model.with_loop(substeps=loop.substeps, substep_factor=loop.substep_factor)
    outputs = model.outputs(fit.values)
    jacobian = sensitivity(model, fit.values, outputs)
    return replace(fit, model=model, outputs=outputs, jacobian=jacobian, prediction=None, steps={})


def _step(fit: Fit) -> Array:
    """(p,) the linear step from a fit, beyond the limits of machines, too."""
    return np.asarray(np.tensordot(influences(fit)[0], fit.residual, axes=([0, 1], [0, 1])))
