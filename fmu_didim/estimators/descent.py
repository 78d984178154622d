"""Progress of the iterations from one start: a better point, a step to be halved, or failure."""

from __future__ import annotations

import numpy as np

from fmu_didim.data.signals import Array

MAXIMUM_HALVINGS = 6
"""[halvings] Most for a step of DIDIM that does not improve the fit."""
GROWTH = 1.5
"""[1] A step after which the error is this many times that of the best point is halved."""
ERROR_FLOOR = 1e-3
"""[%] A smaller change of the relative torque error counts as none: data without noise."""
USELESS_ERROR = 50.0
"""[%] A start with a larger torque error, whose first step does not bring it below, is given up for another."""


class Descent:
    """The best point of the iterations from one start, and how the next one compares.

    Attributes:
        best: values (p,) and error in percent; rises: points since then; count: all; failure: of the last one.
    """

    def __init__(self, *, is_last: bool) -> None:
        self.best: tuple[Array, float] = (np.zeros(0), np.inf)
        self.rises = self.count = 0
        self.failure = ""
        self._is_last, self._halvings, self._before = is_last, 0, np.nan
        self._last = np.nan

    def judged(self, theta: Array, error: float, failure: str) -> str:
        """``taken``, ``halved`` (towards the best point), ``over`` (no better one was found) or ``failed``."""
        self.count += 1
        begun = np.isfinite(self.best[1])
        is_useless = begun and self.best[1] > USELESS_ERROR and not self._is_last
        if not failure and begun and error > GROWTH * self.best[1]:
            failure = f"the error grew to {error:.3g} %"
        if not failure and is_useless and error > USELESS_ERROR:
            failure = f"the torque error is still {error:.0f} % after a step"
        self.failure = failure
        if failure:
            self._halvings += 1
            if not begun or is_useless:
                return "failed"
            return "halved" if self._halvings <= MAXIMUM_HALVINGS else "over"
        self._halvings, self._before, self._last = 0, self._last, error
        if error < self.best[1]:
            self.best, self.rises = (theta, error), 0
        else:
            self.rises += 1
        return "taken"

    def steady(self, error: float, tolerance: float) -> bool:
        """Whether the error of a point that was taken is that of the one before."""
        return bool(abs(error - self._before) <= max(tolerance * self._before, ERROR_FLOOR))
