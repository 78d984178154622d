"""The columns of an effect in the torque balance along a motion.

Passed through the response of the closed loop (:mod:`fmu_didim.fit.derivatives.load_response`) they are its signature:
the change of the logged torque, to first order.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product

import casadi as ca
import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.dynamics.effects import PAYLOAD, JointType, Search, Surroundings, TorqueEffect, start_name
from fmu_didim.dynamics.robot.observed_states import states_along
from fmu_didim.dynamics.robot.vectorised import Vectorised
from fmu_didim.model.motion import Motion


def search_grid(search: Mapping[str, Search], defaults: Mapping[str, float]) -> Iterator[dict[str, float]]:
    """All combinations of the grids of the searched shapes, with the values that are known; the others at their
    defaults."""
    for values in product(*map(_values, search.values())):
        yield {**defaults, **{n: float(v) for n, v in zip(search, values, strict=True)}}


def _values(search: Search) -> list[float]:
    grid = (np.geomspace if search.logarithmic else np.linspace)(search.lowest, search.highest, search.count).tolist()
    return [*grid, *(one for one in search.known if one not in grid)]


class TorqueSignature:
    """Columns of one torque effect at one joint on a motion, for any shapes."""

    def __init__(
        self, effect: TorqueEffect, joint: int, joint_types: tuple[JointType, ...], shape_names: tuple[str, ...]
    ):
        self.effect, self.joint, self._shape_names = effect, joint, shape_names
        n, kind = len(joint_types), joint_types[joint]
        self._states = effect.states(kind)
        q, dq, ddq = (ca.SX.sym(name, n) for name in ("q", "dq", "ddq"))
        load, time = ca.SX.sym("load"), ca.SX.sym("t")
        z = ca.SX.sym("z", len(self._states))
        link = ca.SX.sym("link", n, len(PAYLOAD))
        shapes = ca.SX.sym("s", len(shape_names))
        at = Surroundings(
            joint=joint, joint_type=kind, all_q=q, all_dq=dq, all_ddq=ddq, load=load, time=time,
            state=tuple(ca.vertsplit(z)) if self._states else (),
            link={name: link[:, i] for i, name in enumerate(PAYLOAD)},
        )  # fmt: skip
        by_name = dict(zip(shape_names, ca.vertsplit(shapes) if shape_names else (), strict=True))
        columns = []
        for column in effect.columns(at, by_name):
            full = ca.SX.zeros(n)
            for row, value in column.items() if isinstance(column, Mapping) else ((joint, column),):
                full[row] = value
            columns.append(full)
        self.count = len(columns)
        inputs, table = [q, dq, ddq, load, time, z, ca.vec(link), shapes], ca.densify(ca.vertcat(*columns))
        self._columns = Vectorised(ca.Function("columns", inputs, [table]))
        rates = ca.vertcat(*effect.rates(at, by_name))
        self._rates = ca.Function("rates", [z, q, dq, time, shapes], [ca.densify(rates)]) if rates.numel() else None

    def columns(self, motion: Motion, shapes: Mapping[str, float], states: Array | None = None) -> Array:
        """(K, n, m) columns at the ticks of the motion; ``states`` (K, nz) if the effect has any."""
        count, n = motion.q.shape
        link = motion.links[self.joint].transpose(2, 1, 0).reshape(-1, count)
        state = np.zeros((0, count)) if states is None else states.T
        load, time = motion.load[None, :, self.joint], motion.time[None]
        values = [shapes[name] for name in self._shape_names]
        flat = self._columns(count, [motion.q.T, motion.dq.T, motion.ddq.T, load, time, state, link, values])
        return np.ascontiguousarray(flat.reshape(count, self.count, n).transpose(0, 2, 1))

    @property
    def has_states(self) -> bool:
        """Whether the columns depend on states, for which the motion at all ticks is needed."""
        return self._rates is not None

    def states(self, motion: Motion, shapes: Mapping[str, float]) -> Array:
        """(K, nz) states along a motion at all ticks."""
        assert self._rates is not None
        n, rates, s = motion.joint_count, self._rates, ca.DM([shapes[name] for name in self._shape_names])
        return states_along(
            lambda z, x: rates(z, x[:n], x[n : 2 * n], x[2 * n], s),
            np.array([motion.starts.get(start_name(v.name, self.joint + 1), v.start) for v in self._states]),
            motion.time,
            np.column_stack([motion.q, motion.dq, motion.time]),
        )
