"""What each parameter does to each output near some values, and which combinations the data hardly know.

    change_ij = 0.01 |v_j| rms(d y_i / d v_j)           of output i by one per cent of parameter j, in its unit
    R = V^-1 C V^-1,  V = diag |v|                      covariance of the logarithms; R e_k = s_k^2 e_k

A direction e_k with a large s_k is a ridge: along it the parameters may move together by s_k, relative to themselves,
and the outputs move no more than noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import LoopModel

PER_CENT = 0.01
"""[1] Change of a parameter whose effect is reported."""
RIDGE = 0.1
"""[1] Relative standard deviation of a combination of parameters from which it is reported, where its parameters are
each known better beside the others:"""
BEYOND = 3.0
"""[1] by this ratio at least, for the parameter that takes the largest part in it."""
LEADING = 0.3
"""[1] Fraction of the largest part in a direction from which a parameter is named."""
MOST_RIDGES = 3
"""[directions] That are reported, the least known first."""


@dataclass(frozen=True)
class Ridge:
    """A combination of parameters that the data hardly know.

    Attributes:
        parts: name -> relative change of the parameter along it, the largest 1 or -1; std: relative standard deviation
            of the largest along it.
    """

    parts: dict[str, float]
    std: float

    @property
    def text(self) -> str:
        """In words."""
        first, *others = self.parts
        ways = " and ".join(f"{name} by {self.parts[name]:+.2g} times that" for name in others)
        size = f"{100 * self.std:.2g} %" if self.std < 1 else "more than its own size"
        return f"{first} may move by {size}, {ways}, relative to themselves, and the outputs hardly change"


@dataclass(frozen=True)
class LocalSensitivity:
    """The effects of parameters near some values.

    Attributes:
        names: (p,) of the parameters; outputs: (m,) of the outputs; units: (m,).
        change: (p, m) rms of the change of each output by one per cent of each parameter, of its scale where it is
            zero.
        ridges: the least known combination first.
    """

    names: tuple[str, ...]
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    change: Array
    ridges: tuple[Ridge, ...] = ()

    @property
    def idle(self) -> tuple[str, ...]:
        """Parameters that change no output."""
        return tuple(name for name, row in zip(self.names, self.change, strict=True) if not row.any())


def output_names(model: LoopModel) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of all outputs: of the joints, or of what was measured of any model, and what stands beside."""
    channels = {c.name: c.unit for e in model.experiments.values() for c in e.channels}
    further = model.experiments.channels
    return (*model.loop.labels, *further), (*model.parameters.torque_units, *(channels[name] for name in further))


def local_sensitivity(
    model: LoopModel, values: Array, jacobian: Array, covariance: Array | None
) -> LocalSensitivity:  # fmt: skip
    """From a sensitivity (M, m, p) at values (p,), and the covariance (p, p) where there is one."""
    size = np.where(values == 0, [one.scale for one in model.free_parameters], np.abs(values))
    counts = model.output_counts[: jacobian.shape[1]]
    rms = np.sqrt((jacobian**2).sum(axis=0) / counts[:, None])  # (m, p)
    names, units = (part[: counts.size] for part in output_names(model))
    ridges = () if covariance is None else ridges_of(model.names, size, covariance)
    return LocalSensitivity(model.names, names, units, PER_CENT * rms.T * size[:, None], ridges)


def ridges_of(names: tuple[str, ...], size: Array, covariance: Array) -> tuple[Ridge, ...]:
    """The combinations that a covariance (p, p) leaves open, of parameters of these sizes (p,)."""
    relative = covariance / np.outer(size, size)
    if names and np.isfinite(relative).all():
        squares, directions = np.linalg.eigh(relative)
        alone = 1 / np.sqrt(np.maximum(np.diag(np.linalg.pinv(relative)), np.finfo(float).tiny))
    else:
        return ()
    found = []
    for square, direction in zip(squares[::-1], directions.T[::-1], strict=True):
        first = int(np.argmax(np.abs(direction)))
        std = float(np.sqrt(max(square, 0.0)) * abs(direction[first]))
        places = [int(i) for i in np.argsort(-np.abs(direction)) if abs(direction[i]) > LEADING * abs(direction[first])]
        if len(places) > 1 and std > RIDGE and std > BEYOND * alone[first]:
            found.append(Ridge({names[i]: float(direction[i] / direction[first]) for i in places}, std))
    return tuple(found[:MOST_RIDGES])
