"""Linearly implicit integration of stiff blocks: steep friction, gears, bristles at the steps of the data.

The midpoint rule with one evaluation a step, at a midpoint that is extrapolated from the last step. With f(x, u, p) the
derivative of x, T close to the stiff part of df/dx and m = k of the step before, a step of size h is

    (I - h Theta T) k = f(x + h/2 m) - h/2 T m,    x(t + h) = x + h k

with Theta = 1/2 + O(h^2). Its order is two for any T, because k - m is of the order of h; so T holds only what is steep
and cheap: slopes of friction, springs and dampers of gears, bristles. For a robot (I - h Theta T) k = ... becomes one
system (M + h D) k_v = ..., and the step costs what one stage of an explicit method costs, however steep friction is.
Theta grows to 1 where the step is much longer than what T damps: the rule would only be A-stable with 1/2. The first
step of a run knows no other: m = 0 there, which is one error of second order.

Sources: E. Hairer, G. Wanner, *Solving Ordinary Differential Equations II*, sections IV.3 (midpoint and theta methods)
and IV.7 (linearly implicit methods); H. Podhaisky, R. Weiner, B. A. Schmitt, "Linearly-implicit two-step methods and
their implementation in Nordsieck form", Appl. Numer. Math. 56 (2006), for methods of W type that use the step before;
W. Liniger, R. A. Willoughby, "Efficient integration methods for stiff systems of ordinary differential equations",
SIAM J. Numer. Anal. 7 (1970), for a Theta that follows the step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

NAME = "linearly implicit midpoint rule"
"""The method, as results name it."""


@dataclass(frozen=True)
class LinearlyImplicit:
    """A linearly implicit step of a continuous block, with the hidden unknowns a that it solves for:

        residual(x, m, a, u, p, h) = 0  for  a = solution(x, m, u, p, h);
        (x, m) of the next step = following(x, m, a, u, p, h)

    m (nm,) is what a step remembers of the one before, zero at the start of a run.

    Attributes:
        residual: -> (na,), linear in a, but for friction by the load; solution: -> (na,); following: -> (nx,), (nm,).
        rate: (x, p) -> 1/s, from which the number of substeps follows as from the rate bound of a block.
        resolution: (x, p) -> 1/s, likewise, of what must be resolved however little accuracy is asked for.
        symmetric: whether d residual / d a is symmetric.
    """

    residual: ca.Function
    solution: ca.Function
    following: ca.Function
    rate: ca.Function
    resolution: ca.Function
    symmetric: bool = True

    @property
    def hidden(self) -> int:
        """Number of hidden unknowns na."""
        return int(self.residual.numel_out(0))

    @cached_property
    def resolves_all(self) -> bool:
        """Whether nothing must be resolved, at any values of the parameters."""
        x, p = (ca.SX.sym(name, self.resolution.numel_in(i)) for i, name in enumerate("xp"))
        return bool(ca.SX(self.resolution(x, p)).is_zero())

    @property
    def memory(self) -> int:
        """Number nm of what a step remembers."""
        return int(self.following.numel_out(1))

    def step(self, name: str = "step") -> ca.Function:
        """One step with the input held: (x, m, u, p, h) -> x, m of the next."""
        sizes = [self.solution.numel_in(i) for i in range(5)]
        x, m, u, p, h = (ca.SX.sym(name, size) for name, size in zip("xmuph", sizes, strict=True))
        following = self.following(x, m, self.solution(x, m, u, p, h), u, p, h)
        return ca.Function(name, [x, m, u, p, h], ca.cse([ca.densify(part) for part in following]))
