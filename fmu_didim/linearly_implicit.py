"""Linearly implicit integration of stiff blocks: steep friction, gears and bristles at the steps that the data ask for.

With x' = f(x, u, p) and T close to the stiff part of df/dx, a step of size h is

    (I - g T) k_i = f(x + h sum_j a_ij k_j) + sum_j c_ij k_j,    g = gamma h,    x(t + h) = x + h sum_i b_i k_i

The order holds for any T (a method of W type), so T holds only what is steep and cheap: slopes of friction, springs
and dampers of gears, bristles. For a robot (I - g T) k = ... becomes one system (M + g D) k_v = ..., that costs what an
explicit stage costs, and the step is stable however steep the friction is.

Sources: J. G. Verwer et al., "A second-order Rosenbrock method applied to photochemical dispersion problems", SIAM J.
Sci. Comput. 20 (1999), for ROS2; T. Steihaug, A. Wolfbrandt, Math. Comp. 33 (1979), for W methods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import casadi as ca


@dataclass(frozen=True)
class Scheme:
    """Coefficients of a method with two stages: a = a_21, c = c_21, b = (b_1, b_2)."""

    name: str
    gamma: float
    a: float
    c: float
    b: tuple[float, float]

    def constants(self) -> dict[str, float]:
        """The coefficients under their names in C."""
        return {
            "SCHEME_GAMMA": self.gamma, "SCHEME_A": self.a, "SCHEME_C": self.c,
            "SCHEME_B1": self.b[0], "SCHEME_B2": self.b[1],
        }  # fmt: skip


ROS2 = Scheme("ROS2", 1 - 1 / math.sqrt(2), 1.0, -2.0, (1.5, 0.5))
"""Order 2 for any T, L-stable where T is the Jacobian."""


@dataclass(frozen=True)
class LinearlyImplicit:
    """A stage of a linearly implicit step of a continuous block, with k_v the hidden unknowns it solves for:

        d = slopes(x, p);   residual(x, c, d, k_v, u, p, g) = 0  for  k_v = solution(x, c, d, u, p, g);
        k = stage(x, c, d, k_v, u, p, g)

    Attributes:
        slopes: (x, p) -> (nd,), what T is made of, taken once where the step begins.
        residual: -> (na,), symmetric in k_v; solution: -> (na,); stage: -> (nx,).
        rate: (x, p) -> 1/s, from which the number of substeps follows as from the rate bound of a block.
        resolution: (x, p) -> 1/s, likewise, of what must be resolved however little accuracy is asked for.
    """

    slopes: ca.Function
    residual: ca.Function
    solution: ca.Function
    stage: ca.Function
    rate: ca.Function
    resolution: ca.Function

    @property
    def hidden(self) -> int:
        """Number of hidden unknowns na."""
        return int(self.residual.numel_out(0))

    @property
    def slope_count(self) -> int:
        """Number of slopes nd."""
        return int(self.slopes.numel_out(0))

    @cached_property
    def explicit_stage(self) -> ca.Function:
        """(x, c, d, u, p, g) -> k."""
        sizes = [self.stage.numel_in(i) for i in (0, 1, 2, 4, 5, 6)]
        x, c, d, u, p, g = (ca.SX.sym(name, size) for name, size in zip("xcdupg", sizes, strict=True))
        hidden = self.solution(x, c, d, u, p, g)
        return ca.Function("stage", [x, c, d, u, p, g], [ca.densify(self.stage(x, c, d, hidden, u, p, g))])

    def step(self) -> ca.Function:
        """One step of :data:`ROS2`: (x, u, p, h) -> x(t + h), input held."""
        sizes = [self.stage.numel_in(i) for i in (0, 4, 5, 6)]
        x, u, p, h = (ca.SX.sym(name, size) for name, size in zip("xuph", sizes, strict=True))
        g, d = ROS2.gamma * h, self.slopes(x, p)
        first = self.explicit_stage(x, ca.SX.zeros(x.numel()), d, u, p, g)
        second = self.explicit_stage(x + ROS2.a * h * first, ROS2.c * first, d, u, p, g)
        following = x + h * (ROS2.b[0] * first + ROS2.b[1] * second)
        return ca.Function("substep", [x, u, p, h], [ca.densify(following)])
