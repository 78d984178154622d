"""Algebraic loops: outputs that depend at once on inputs that depend on them.

They are found in the structure of the components (which output depends at once on which input), and confirmed on
the running instances by derivatives, because a structure may only say what might depend.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from graphlib import CycleError, TopologicalSorter

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.components import SameObject
from fmu_didim.cosim.execution.running import LoopRun, Part
from fmu_didim.cosim.system import REFERENCE, Connection, System
from fmu_didim.data.signals import Array

TOLERANCE = 1e-12
MAXIMUM_ITERATIONS = 50
KEPT = 64
"""[loops] Whose structure is remembered: an identification simulates few of them some tens of times."""
_FELT = 1e-8
"""[1] Fraction of the largest derivative that still counts as a dependence."""


def algebraic_loops(system: System) -> list[list[str]]:
    """Cycles of signals ``component.output`` that depend on each other at once, by the structure.

    A delay, Jacobi order or a component of unknown structure breaks a cycle:
    where nothing is known, nothing is refused.
    """
    if system.jacobi:
        return []
    at_once: list[tuple[str, frozenset[tuple[str, str]]]] = []
    for name, component in system.components.items():
        pairs = component.feedthrough()
        if name in system.after_step:
            pairs = frozenset((y.name, u.name) for y in component.outputs for u in component.inputs)
        if pairs is not None and not system.delays.get(name):
            at_once.append((name, pairs))
    return [list(loop) for loop in _closed_by(SameObject(system.connections), tuple(at_once))]


@lru_cache(maxsize=KEPT)
def _closed_by(wiring: SameObject, at_once: tuple[tuple[str, frozenset[tuple[str, str]]], ...]) -> list[list[str]]:
    """The cycles by the connections, and of components the outputs that depend at once on inputs, as pairs of both."""
    sources: dict[str, list[str]] = {}
    connections: tuple[Connection, ...] = wiring.value  # type: ignore[assignment]
    for connection in connections:
        if not connection.source.startswith(f"{REFERENCE}."):
            sources.setdefault(connection.target, []).append(connection.source)
    follows: dict[str, list[str]] = {}
    for name, pairs in at_once:
        for output, given in pairs:
            follows.setdefault(f"{name}.{output}", []).extend(sources.get(f"{name}.{given}", []))
    return _cycles(follows)


def _cycles(follows: dict[str, list[str]]) -> list[list[str]]:
    """Strongly connected components of a directed graph that hold a cycle."""
    try:
        TopologicalSorter(follows).prepare()
        return []
    except CycleError:
        from scipy.sparse.csgraph import connected_components
    names = sorted({*follows, *(s for many in follows.values() for s in many)})
    graph = np.array([[b in follows.get(a, ()) for b in names] for a in names])
    _, labels = connected_components(graph, connection="strong")
    groups: dict[int, list[str]] = {}
    for name, label in zip(names, labels.tolist(), strict=True):
        groups.setdefault(label, []).append(name)
    return [group for group in groups.values() if len(group) > 1 or group[0] in follows.get(group[0], ())]


def really_closed(run: LoopRun, loops: list[list[str]]) -> list[list[str]]:
    """Those of the loops around which a change travels at the present instant of an initialised run.

    The derivatives of the outputs on a loop by the inputs on it decide: where they are zero, the structure states a
    dependence that the component does not have.
    """
    return [loop for loop in loops if _is_closed(run, loop)]


def _is_closed(run: LoopRun, loop: list[str]) -> bool:
    follows: dict[str, list[str]] = {name: [] for name in loop}
    for part in run.parts:
        outputs = [name for name in loop if name.startswith(f"{part.name}.")]
        ends = zip(part.wiring.targets.tolist(), part.wiring.sources.tolist(), strict=True)
        wires = [(target, run.names[source]) for target, source in ends if run.names[source] in loop]
        if not outputs or not wires:
            continue
        targets = sorted({target for target, _ in wires})
        own = [run.names.index(name) - part.place.start for name in outputs]
        direct, _ = part.instance.derivatives(own, targets, {})
        # Differences leave rounding where there is no dependence.
        felt = np.abs(direct) > _FELT * max(1.0, float(np.abs(direct).max()))
        for target, source in wires:
            for row in np.flatnonzero(felt[:, targets.index(target)]):
                follows[outputs[row]].append(source)
    return bool(_cycles(follows))


class LoopSolver:
    """Solves the algebraic loops of a run at each tick: x = pass(x), x the outputs of all components.

    Newton steps with the Jacobian by differences, kept from tick to tick while it converges.
    """

    def __init__(self) -> None:
        self._inverse: Array | None = None

    def solve(self, signals: Array, parts: Sequence[Part], time: float) -> None:
        """Make the outputs of the components at this tick consistent; raises SimulationError."""
        parts = [part for part in parts if not part.delayed and not part.after_step]
        if not parts:
            return
        places = np.concatenate([np.arange(p.place.start, p.place.stop) for p in parts])
        x = signals[places]
        for attempt in range(MAXIMUM_ITERATIONS):
            residual = self._pass(signals, places, parts, x) - x
            if np.abs(residual).max() <= TOLERANCE * max(1.0, float(np.abs(x).max())):
                return
            if self._inverse is None or attempt % 8 == 7:
                self._inverse = self._jacobian_inverse(signals, places, parts, x, residual)
            x = x - self._inverse @ residual
            if not np.isfinite(x).all():
                break
        raise SimulationError(
            "The algebraic loop has no solution that the iteration finds.",
            got=f"t = {time:.6g} s, residual {float(np.abs(residual).max()):.3g}",
            next_step="Put a delay of one sample on the component that closes the loop, or use the Jacobi order.",
        )

    def _pass(self, signals: Array, places: Array, parts: Sequence[Part], x: Array) -> Array:
        signals[places] = x
        for part in parts:
            part.gather(signals)
        for part in parts:
            part.instance.set()
            part.instance.get()
        return np.asarray(signals[places])

    def _jacobian_inverse(
        self, signals: Array, places: Array, parts: Sequence[Part], x: Array, residual: Array
    ) -> Array:
        jacobian = np.empty((x.size, x.size))
        for i in range(x.size):
            step = 1e-6 * max(1.0, abs(float(x[i])))
            moved = x.copy()
            moved[i] += step
            jacobian[:, i] = (self._pass(signals, places, parts, moved) - moved - residual) / step
        self._pass(signals, places, parts, x)
        return np.asarray(np.linalg.pinv(jacobian))
