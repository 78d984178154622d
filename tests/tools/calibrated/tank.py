"""A tank whose outlet drains it, as an FMU of PythonFMU: ``pythonfmu build -f tank.py``.

    area dh/dt = inflow - outlet sqrt(2 g h)

level h in m, area of the tank and of its outlet in m^2, inflow in m^3/s; Torricelli's law.
"""

from math import sqrt
from typing import Any

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

GRAVITY = 9.81
"""[m/s^2]"""
PARTS = 10
"""[steps] Of the midpoint rule in one communication step."""


class Tank(Fmi2Slave):
    """The tank, which drains from 0.5 m."""

    author = "fmu_didim"
    description = "Tank with an outlet"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.h, self.area, self.outlet, self.inflow = 0.5, 0.05, 0.0008, 0.001
        self.register_variable(Real("h", causality=Fmi2Causality.output))
        for name in ("area", "outlet", "inflow"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, current_time: float, step_size: float) -> bool:
        for _ in range(PARTS):
            middle = self.h + step_size / PARTS / 2 * self._rate(self.h)
            self.h += step_size / PARTS * self._rate(middle)
        return True

    def _rate(self, h: float) -> float:
        return (self.inflow - self.outlet * sqrt(2 * GRAVITY * max(h, 0.0))) / self.area
