"""Which FMU is the plant and which is the controller, by its signals against those of the log; and what its ports are.

A plant takes as many inputs as the log has torques, and gives positions. A controller takes set points and measurements
and gives as many outputs as there are torques. Where counts, units and names do not say so, the user is asked.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

from fmu_didim.base.documents import TO_FILL_IN
from fmu_didim.base.errors import InputError
from fmu_didim.components.fmu.description import FmuDescription
from fmu_didim.workflow.init.roles import Guess, Role, Side, guess

FmuRole = Literal["plant", "controller"]
OTHER: Mapping[FmuRole, FmuRole] = {"plant": "controller", "controller": "plant"}
_DRIVE: tuple[Role, ...] = ("tau", "current", "command")
_MOTION: tuple[Role, ...] = ("q", "dq", "ddq")
_SET_POINT = r"(^|[._])u_?s(_?\d+)?$|set.?point"
_MEASUREMENT = r"(^|[._])u_?m(_?\d+)?$|measurement"
"""Ports of the controllers of the Modelica Standard Library, and what it says of them, beside the words of columns."""
_AT_ONCE = {
    True: "an output follows an input at once, as in most controllers",
    False: "no output follows an input at once, as in most plants",
}
_MOST_SHOWN = 8
"""Ports of a side that a message shows."""


@dataclass(frozen=True)
class FmuPorts:
    """An FMU by its ports.

    Attributes:
        source: the file that was given; fmu: what it says of itself.
    """

    source: Path
    fmu: FmuDescription

    @cached_property
    def inputs(self) -> list[Guess]:
        """The guess for each input."""
        return self._guesses("input")

    @cached_property
    def outputs(self) -> list[Guess]:
        """The guess for each output."""
        return self._guesses("output")

    def _guesses(self, causality: str) -> list[Guess]:
        return [
            _port(name, variable.unit, variable.description)
            for variable in self.fmu.of_causality(causality)
            for name in variable.element_names()
        ]

    @property
    def follows_at_once(self) -> bool | None:
        """Whether an output depends on an input of the same instant; None where the FMU does not say of all of them."""
        stated = list((self.fmu.dependencies or {}).values())
        if any(stated):
            return True
        return None if None in stated or not stated else False


def _port(name: str, unit: str, description: str) -> Guess:
    """The guess for a port, by its unit, its name and, where these do not tell, its description."""
    found = guess(name, unit)
    text = found.name.lower() if found.side or found.role != "other" else f"{name} {description}".lower()
    side: Side = found.side
    if re.search(_SET_POINT, name.lower()) or (not side and re.search(_SET_POINT, text)):
        side = "reference"
    elif re.search(_MEASUREMENT, name.lower()) or (not side and re.search(_MEASUREMENT, text)):
        side = "measured"
    return Guess(found.name, found.unit, found.role, found.joint, side)


@dataclass(frozen=True)
class Reading:
    """The role of an FMU.

    Attributes:
        role: None where the signals do not tell; reason: for the role, or for each of them.
    """

    role: FmuRole | None
    reason: str


def reading(ports: FmuPorts, torques: int) -> Reading:
    """The role of an FMU by its own signals.

    Args:
        torques: how many the log has.
    """
    inputs, outputs = len(ports.inputs), len(ports.outputs)
    counts: set[FmuRole] = set()
    if inputs == torques and outputs >= torques:
        counts.add("plant")
    if outputs == torques and inputs >= torques:
        counts.add("controller")
    counted = f"{inputs} input{'s' if inputs != 1 else ''} and {outputs} output{'s' if outputs != 1 else ''}"
    counted += f" for {torques} torque{'s' if torques > 1 else ''} in the log"
    by_unit = _vote([g.role for g in ports.inputs if g.unit], [g.role for g in ports.outputs if g.unit])
    bare = [[guess(g.name, "").role for g in side] for side in (ports.inputs, ports.outputs)]
    by_name = _vote(*bare, takes_reference=any(g.side for g in ports.inputs))
    votes = {word: role for word, role in (("units", by_unit), ("names", by_name)) if role is not None}
    agreed = set(votes.values())
    if len(agreed) == 1:
        (role,) = agreed
        if role in counts or not counts or len(votes) == 2:
            return Reading(role, f"by the {' and '.join(votes)} of its signals, {counted}")
    elif not agreed and len(counts) == 1:
        return Reading(next(iter(counts)), f"by {counted}")
    hints = [f"its {word} are those of a {role}" for word, role in votes.items()]
    if ports.follows_at_once is not None:
        hints.append(_AT_ONCE[ports.follows_at_once])
    return Reading(None, "; ".join((counted, *hints)))


def _vote(inputs: Iterable[str], outputs: Iterable[str], *, takes_reference: bool = False) -> FmuRole | None:
    """The role that kinds of signals indicate: a plant takes torques or gives motion; None where they contradict.

    Args:
        takes_reference: whether inputs are named as set points or measurements, as those of a controller are.
    """
    inputs, outputs = set(inputs), set(outputs)
    votes: set[FmuRole] = set()
    if inputs & {*_DRIVE} and not inputs & {*_MOTION}:
        votes.add("plant")
    if inputs & {*_MOTION} and not inputs & {*_DRIVE}:
        votes.add("controller")
    if outputs & {*_MOTION}:
        votes.add("plant")
    elif outputs & {*_DRIVE}:
        votes.add("controller")
    if not votes and takes_reference:
        return "controller"
    return next(iter(votes)) if len(votes) == 1 else None


def assigned(
    fmus: Sequence[FmuPorts], torques: int, *, said: Mapping[Path, FmuRole], has_controller: bool
) -> dict[FmuRole, tuple[FmuPorts, str]]:
    """Plant and controller among the FMUs, each with the reason why it is taken for that.

    Args:
        torques: how many the log has; said: what the user says of a file, by its whole path.
        has_controller: whether something else than these FMUs is the controller.

    Raises:
        InputError: the role of an FMU is not clear, or two have the same.
    """
    readings = {
        p.source: Reading(said[p.source.resolve()], "as you say") if p.source.resolve() in said else reading(p, torques)
        for p in fmus
    }
    found: dict[FmuRole, tuple[FmuPorts, str]] = {}
    for ports in sorted(fmus, key=lambda p: (p.source.resolve() not in said, readings[p.source].role is None)):
        role, reason = readings[ports.source].role, readings[ports.source].reason
        left = [r for r in OTHER if r not in found and not (r == "controller" and has_controller)]
        if role is None and len(left) == 1:
            role, reason = left[0], f"as the {OTHER[left[0]]} is given by another file"
        if role is None:
            raise _unclear(ports, reason)
        if role in found:
            raise InputError(
                f"Two FMUs are taken for the {role}.", where=str(ports.source), got=str(found[role][0].source),
                next_step="Leave one out, or say what they are: --plant FILE --controller FILE.",
            )  # fmt: skip
        if role == "controller" and has_controller:
            raise InputError(
                "There are two controllers: a description or law, and an FMU that is taken for one.",
                where=str(ports.source), got=reason,
                next_step=f"Leave out --law or one of the files, or say that it is the plant: --plant {ports.source}",
            )  # fmt: skip
        found[role] = ports, reason
    return found


def _unclear(ports: FmuPorts, reason: str) -> InputError:
    shown = []
    for side in (ports.inputs, ports.outputs):
        names = [f"{g.name} in {g.unit}" if g.unit else g.name for g in side[:_MOST_SHOWN]]
        shown.append(", ".join([*names, *(["..."] if len(side) > _MOST_SHOWN else [])]) or "none")
    inputs, outputs = shown
    return InputError(
        "Whether this FMU is the plant or the controller cannot be told from its signals.", where=str(ports.source),
        got=reason,
        valid=f"as the plant it takes torques ({inputs}) and gives the motion ({outputs}); as the controller it takes "
        f"set points and measurements ({inputs}) and gives torques or commands ({outputs})",
        next_step=f"Say which: --plant {ports.source}, or --controller {ports.source}; or --model {ports.source} if it "
        "is calibrated as it is, with neither robot nor controller",
    )  # fmt: skip


@dataclass(frozen=True)
class _Signal:
    """A signal of the loop, ``name`` with the number of the joint, and what its port is taken for."""

    name: str
    roles: tuple[Role, ...]
    side: Side = ""
    needed: bool = False


_SIGNALS: Mapping[FmuRole, Mapping[str, tuple[_Signal, ...]]] = {
    "plant": {
        "inputs": (_Signal("tau", _DRIVE, needed=True),),
        "outputs": (_Signal("q", ("q",), needed=True), _Signal("dq", ("dq",)), _Signal("ddq", ("ddq",))),
    },
    "controller": {
        "inputs": (
            _Signal("q_ref", ("q",), "reference", needed=True), _Signal("dq_ref", ("dq",), "reference"),
            _Signal("ddq_ref", ("ddq",), "reference"), _Signal("q", ("q",), "measured", needed=True),
            _Signal("dq", ("dq",), "measured"),
        ),
        "outputs": (_Signal("command", _DRIVE, needed=True),),
    },
}  # fmt: skip


def mappings(ports: FmuPorts, role: FmuRole, joints: int) -> dict[str, dict[str, str]]:
    """Name in the loop -> name in the FMU, of ``inputs`` and ``outputs``; nothing where both are the same.

    What the names do not tell stands there to be filled in.
    """
    made: dict[str, dict[str, str]] = {}
    for side, own in (("inputs", ports.inputs), ("outputs", ports.outputs)):
        signals = _SIGNALS[role][side]
        if {g.name for g in own} <= {f"{s.name}{j}" for s in signals for j in range(1, joints + 1)}:
            continue
        made[side] = {}
        for signal in signals:
            each = {f"{signal.name}{j}": _meant(own, signal, j, joints) for j in range(1, joints + 1)}
            if signal.needed or all(each.values()):
                made[side] |= {name: port or TO_FILL_IN for name, port in each.items()}
    return made


_SIDES: Mapping[Side, tuple[Side, ...]] = {
    "reference": ("reference",), "measured": ("measured", ""), "": ("", "reference", "measured"),
}  # fmt: skip
"""Side of a signal -> what the name of its port may say: a set point says so."""


def _meant(own: Sequence[Guess], signal: _Signal, joint: int, joints: int) -> str | None:
    """The port that alone may be meant by a signal of a joint.

    A port of no known role is a position if its name says which side it is on, and a torque if nothing else is there.
    """
    of_joint = [g for g in own if g.joint == joint or (joints == 1 and g.joint is None)]
    sides = _SIDES[signal.side]
    found = [g for g in of_joint if g.role in signal.roles and g.side in sides]
    if not found and "q" in signal.roles and signal.side:
        found = [g for g in of_joint if g.role == "other" and g.side == signal.side]
    if not found and signal.roles == _DRIVE and len(own) == joints:
        found = [g for g in of_joint if g.role == "other"]
    return found[0].name if len(found) == 1 else None
