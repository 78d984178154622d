"""Distances of segments from each other and from boxes, as CasADi expressions that an optimiser can differentiate.

Source: C. Ericson, *Real-Time Collision Detection*, 2005, section 5.1.9 (two segments).
"""

from __future__ import annotations

import casadi as ca

HALVINGS = 18
"""[1] Of the interval in which the nearest point of a segment is looked for: to a 260 000th of its length."""
ASIDE = 1e-7
"""[1] Part of a segment to both sides of a point, by which it is seen where the distance falls."""
NOTHING = 1e-16
"""[m2] Added to squares by which is divided, or of which the root is taken: 10 nm."""


def between_segments(p: ca.SX, q: ca.SX, r: ca.SX, s: ca.SX) -> ca.SX:
    """Distance in m of the segment from p to q (3,) and that from r to s; a point is a segment, too."""
    one, other, apart = q - p, s - r, p - r
    a, e, b = ca.dot(one, one), ca.dot(other, other), ca.dot(one, other)
    c, f = ca.dot(one, apart), ca.dot(other, apart)
    # The nearest points of both lines, and each in its segment; of parallel ones any point of the first will do.
    u = _within((b * f - c * e) / (a * e - b * b + NOTHING))
    v = _within((b * u + f) / (e + NOTHING))
    u = _within((b * v - c) / (a + NOTHING))
    gap = apart + u * one - v * other
    return ca.sqrt(ca.dot(gap, gap) + NOTHING)


def to_box(p: ca.SX, q: ca.SX, low: ca.SX, high: ca.SX) -> ca.SX:
    """Distance in m of the segment from p to q (3,) from a box along the axes; negative inside, the depth.

    The signed distance from a box is convex, and so is it along the segment: its least is found by halving. The point
    where it is does not count in the derivative, by which that is exact outside, where the distance is smooth
    (Danskin); inside it is that of one of the faces.
    """
    middle, half = (low + high) / 2, (high - low) / 2

    def here(at: ca.SX) -> ca.SX:
        return _signed(p + at * (q - p) - middle, half)

    left, right = ca.SX(0.0), ca.SX(1.0)
    for _ in range(HALVINGS):
        at = (left + right) / 2
        falls = here(at + ASIDE) < here(at - ASIDE)
        left, right = ca.if_else(falls, at, left), ca.if_else(falls, right, at)
    return ca.fmin(ca.fmin(here(ca.SX(0.0)), here(ca.SX(1.0))), here((left + right) / 2))


def _within(value: ca.SX) -> ca.SX:
    return ca.fmax(0.0, ca.fmin(1.0, value))


def _signed(x: ca.SX, half: ca.SX) -> ca.SX:
    """Signed distance of x (3,) from a box about zero."""
    beyond = ca.fabs(x) - half
    outside = ca.fmax(beyond, 0.0)
    deepest = ca.fmax(ca.fmax(beyond[0], beyond[1]), beyond[2])
    return ca.sqrt(ca.dot(outside, outside) + NOTHING) + ca.fmin(deepest, 0.0)
