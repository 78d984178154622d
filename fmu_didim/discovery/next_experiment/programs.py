"""Candidate motions of a splitting experiment: Fourier series, and programs of moves, ramps, reversals and rests.

Each candidate has a few design variables u in [0, 1], so that the best one can be improved. Position, speed and
acceleration stay within the limits; the motion starts and ends at rest, at the same place, so that it can be repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from fmu_didim.data.excitation import Fourier
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.discovery.excitation.limits import WITHIN
from fmu_didim.discovery.excitation.series import Series
from fmu_didim.discovery.next_experiment.motions import Leg, Space, sampled, straight

DRAWS = 3
"""[motions] Fourier series among the first candidates."""

HARMONICS = 5
LADDER_SPEEDS = 5
LADDER_PART = 0.7
"""Part of the duration that one round of all these speeds takes."""

Design = Array
Build = Callable[[Design], "Fourier | Trajectory"]


@dataclass(frozen=True)
class Candidate:
    """A family of motions: ``build`` makes one from design variables (m,), which start at ``design``."""

    description: str
    build: Build
    design: Design


def candidates(space: Space, *, seed: int, draws: int = DRAWS) -> list[Candidate]:
    """Fourier series with random phases, programs of one kind, and mixtures of them; the same ones for a seed."""
    found = [_fourier(space, np.random.default_rng([seed, 1, i]), pace=(0.1, 0.3, 0.6)[i % 3]) for i in range(draws)]
    for i, names in enumerate(RECIPES):
        words = ", ".join(BLOCKS[name][0] for name in names)
        found.append(Candidate(words, _program(space, names, (seed, 2, i)), np.array([0.8, 0.5, 0.5, 0.5])))
    return found


def _fourier(space: Space, rng: np.random.Generator, *, pace: float) -> Candidate:
    n, limits = space.limits.low.size, space.limits
    cosine, sine = rng.normal(size=(n, HARMONICS)), rng.normal(size=(n, HARMONICS))
    centre = rng.uniform(0.4, 0.6, size=n)

    def build(u: Design) -> Fourier:
        weight = 10 ** (2 * (u[:HARMONICS] - 0.5)) / np.arange(1, HARMONICS + 1)
        periods = max(round(space.duration_s * (0.05 + 0.45 * u[HARMONICS])), 1)
        basis = Series(periods / space.duration_s, periods, n, harmonics=HARMONICS)
        return basis.excitation(basis.scaled(basis.projected(cosine * weight, sine * weight), limits, centre))

    return Candidate(f"a Fourier series of {HARMONICS} harmonics", build, np.array([0.5] * HARMONICS + [pace]))


def _point(space: Space, rng: np.random.Generator, margin: float = 0.0) -> Array:
    part = WITHIN * rng.uniform(margin, 1 - margin, size=space.limits.low.size) + (1 - WITHIN) / 2
    return np.asarray(space.limits.low + part * (space.limits.high - space.limits.low))


def _holds(space: Space, position: Array, u: Design, rng: np.random.Generator) -> Iterator[Leg]:
    """Rests at several positions, reached by quick moves."""
    for _ in range(3):
        target = _point(space, rng)
        yield straight(space, position, target, 0.3 + 0.7 * u[0], dwell_s=0.2 * 10 ** u[3])
        position = target


def _ladder(space: Space, position: Array, u: Design, rng: np.random.Generator) -> Iterator[Leg]:
    """Constant speeds on a logarithmic scale, each in both directions and for about the same time."""
    low, high = space.limits.low, space.limits.high
    slot = LADDER_PART * space.duration_s / LADDER_SPEEDS
    for pace in np.geomspace(0.3 + 0.7 * u[0], 10 ** (-0.3 - 2.2 * u[1]), LADDER_SPEEDS):
        used = 0.0
        while used < slot:
            # Towards the far end of each joint's range; a slow ramp covers what it can in half its time.
            near = WITHIN * rng.uniform(0.0, 0.15, size=low.size) + (1 - WITHIN) / 2
            target = np.where(position < (low + high) / 2, high - near * (high - low), low + near * (high - low))
            longest = float((np.abs(target - position) / (pace * space.limits.speed)).max())
            target = position + (target - position) * min(1.0, slot / 2 / longest)
            for start, end in ((position, target), (target, position)):
                leg = straight(space, start, end, float(pace), ramp=True)
                used += leg.move_s
                yield leg


def _reversals(space: Space, position: Array, u: Design, rng: np.random.Generator) -> Iterator[Leg]:
    """Small oscillations about a position at two speeds."""
    room = space.limits.high - space.limits.low
    small = np.where(np.isnan(space.lengths), room * 10 ** (-3 + 2 * u[2]), space.lengths * 10 ** (1.3 * u[2]))
    small = np.minimum(small, 0.3 * room)
    centre = _point(space, rng, 0.35)
    yield straight(space, position, centre, 0.3 + 0.7 * u[0])
    sign = rng.choice([-1.0, 1.0], size=room.size)
    for pace in (0.3 + 0.7 * u[0], 10 ** (-1 - 1.5 * u[1])):
        for k in range(4):
            target = centre + (small * sign if k % 2 == 0 else -small * sign)
            yield straight(space, centre if k == 0 else centre - (target - centre), target, float(pace), ramp=True)
        yield straight(space, target, centre, float(pace), ramp=True)


def _two_speeds(space: Space, position: Array, u: Design, rng: np.random.Generator) -> Iterator[Leg]:
    """A path at full speed, then the same path more slowly."""
    points = [_point(space, rng) for _ in range(3)]
    for pace in (1.0, 0.5 * 10 ** -u[1]):
        at = position
        for target in (*points, position):
            yield straight(space, at, target, (0.3 + 0.7 * u[0]) * float(pace))
            at = target


def _sweep(space: Space, position: Array, u: Design, rng: np.random.Generator) -> Iterator[Leg]:
    """From one end of the range to the other and back at constant speed."""
    edge = (1 - WITHIN) / 2 * (space.limits.high - space.limits.low)
    ends = [space.limits.low + edge, space.limits.high - edge]
    flip = rng.random(edge.size) < 0.5
    first, second = np.where(flip, *ends), np.where(flip, *reversed(ends))
    pace = 10 ** (-1.2 * u[1])
    for start, target in ((position, first), (first, second), (second, first)):
        yield straight(space, start, target, pace, ramp=True, dwell_s=0.1)


BLOCKS: Mapping[str, tuple[str, Callable[[Space, Array, Design, np.random.Generator], Iterator[Leg]]]] = {
    "holds": ("rests at several positions", _holds),
    "ladder": ("constant speeds on a logarithmic scale in both directions", _ladder),
    "reversals": ("small reversals at two speeds", _reversals),
    "two speeds": ("the same path at two speeds", _two_speeds),
    "sweep": ("sweeps over the whole range", _sweep),
}
RECIPES: tuple[tuple[str, ...], ...] = (
    *((name,) for name in BLOCKS),
    ("holds", "ladder"), ("holds", "two speeds"), ("reversals", "two speeds"), ("ladder", "reversals"),
    ("two speeds", "ladder", "sweep"), ("two speeds", "holds", "reversals", "ladder"),
)  # fmt: skip


def _program(space: Space, names: tuple[str, ...], seed: tuple[int, ...]) -> Build:
    """Blocks in turn until the duration is used, then back to the beginning and rest."""

    def build(u: Design) -> Trajectory:
        rng = np.random.default_rng(seed)
        start = _point(space, rng, 0.2)
        legs: list[Leg] = []
        position, used, filling = start, 0.0, True
        while filling:
            before = used
            for name in names:
                for leg in BLOCKS[name][1](space, position, u, rng):
                    home = straight(space, leg.target, start, 1.0).move_s
                    if used + leg.move_s + leg.dwell_s + home > space.duration_s:
                        filling = False
                        break
                    legs.append(leg)
                    position, used = leg.target, used + leg.move_s + leg.dwell_s
                if not filling:
                    break
            filling = filling and used > before
        if not np.array_equal(position, start):
            legs.append(straight(space, position, start, 1.0))
        return sampled(start, legs, space)

    return build
