"""How a column of a file becomes a signal: its name there, unit, scale, sign, and the side of the gear it is of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from pydantic import Field, model_validator

from fmu_didim.base.documents import Positive, Strict
from fmu_didim.base.errors import InputError
from fmu_didim.data.units import UnitDefinition, known_unit


class Column(Strict):
    """A column of a file; written short as its name alone.

        signal = sign * (scale * number - zero) * (its unit in SI) * torque_constant * gear

    where gear is 1 / gear_ratio of positions, velocities and accelerations, and gear_ratio of torques.

    Attributes:
        name: in the file, by default that of the signal; a number counts the columns from 1 where the file has no
            header.
        unit: of the numbers times ``scale``, such as deg, rpm, mm, Nm, A; by default what the file states, else SI.
        scale: such as 0.01 where the file counts hundredths; sign: -1 where the axis counts the other way round.
        zero: what the file shows, times ``scale`` and in ``unit``, where the signal is zero: the offset of an axis, or
            of a current sensor.
        gear_ratio: where the column is of the motor side: turns of the motor in one of the joint; of a prismatic joint
            rad of the motor for 1 m.
        torque_constant: of a torque logged as a current, in N.m/A (N/A), of the same kind of ampere as the log.
        rated: what 100 % is, of a torque logged in per cent (``unit: '%'``, ``'‰'`` or ``'1'``): in N.m (N), that of
            the motor with ``gear_ratio``; of a current in A, with ``torque_constant``.
    """

    name: str = ""
    unit: str | None = None
    scale: float = Field(default=1.0, allow_inf_nan=False)
    sign: Literal[1, -1] = 1
    zero: float = Field(default=0.0, allow_inf_nan=False)
    gear_ratio: Positive | None = None
    torque_constant: Positive | None = None
    rated: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _name_alone(cls, value: Any) -> Any:
        if isinstance(value, (str, int)) and not isinstance(value, bool):
            return {"name": str(value)}
        if isinstance(value, dict) and isinstance(value.get("name"), int):
            return {**value, "name": str(value["name"])}
        return value

    @model_validator(mode="after")
    def _sensible(self) -> Column:
        if self.scale == 0:
            raise ValueError("scale: 0 would make the signal zero")
        if self.unit is not None and self.unit != "1" and known_unit(self.unit) is None:
            raise ValueError(
                f"the unit '{self.unit}' is not known, or may mean two things; write it as deg, rad, rpm, mm, m, Nm, "
                "N, A, ms, %, or as N.m, rad/s2; a factor goes into scale:"
            )
        return self


class TimeColumn(Strict):
    """The instants of the rows; written short as the name of the column alone.

    Attributes:
        name: of the column; by default ``t`` or ``time`` (``Zeit``), with or without a unit behind it.
        unit: such as ms; by default what the file states, else s.
        rate_hz: rows are 1 / rate apart. Without ``name``: where the file has no reliable time column.
            With it: the stamps are rounded, and each row belongs to the nearest instant of that rate.
        jittered: the stamps are jittered readings of an even clock, whose instants are taken instead: of the rate that
            is given, or that fits. Refused where rows are missing or the period changes.
        polled: columns of positions in the file, whose motion tells the tick of each row: a program read the newest
            sample of a machine with an even clock of ``rate_hz`` at its own pace, some twice, others never. A row that
            shows a tick again is left out.
        start_s: instant of the first row, where there is no time column.
    """

    name: str | None = None
    unit: str | None = None
    rate_hz: Positive | None = None
    jittered: bool = False
    polled: tuple[str, ...] = ()
    start_s: float = Field(default=0.0, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _name_alone(cls, value: Any) -> Any:
        return {"name": str(value)} if isinstance(value, (str, int)) and not isinstance(value, bool) else value

    @model_validator(mode="after")
    def _is_a_time(self) -> TimeColumn:
        known = None if self.unit is None else known_unit(self.unit)
        if self.unit is not None and (known is None or known.powers != {"s": 1}):
            raise ValueError(f"'{self.unit}' is not a unit of time; valid: s, ms, us, ns, min")
        if self.start_s and (self.name is not None or self.rate_hz is None):
            raise ValueError("start_s goes with rate_hz and without name")
        if self.jittered and self.start_s:
            raise ValueError("jittered: the stamps say when the first row is, not start_s")
        if self.polled and (self.rate_hz is None or self.jittered or self.start_s):
            raise ValueError("polled goes with rate_hz, that of the machine's clock, and without jittered and start_s")
        return self

    @property
    def is_rebuilt(self) -> bool:
        """Whether its stamps are put right by what is known of the clock behind them."""
        return self.jittered or bool(self.polled)


LARGEST_FACTOR = 1e30
"""[1] By which the numbers of a column are multiplied at most, and one over it at least: squares of what is beyond
overflow."""
MOTION = {"q": 0, "dq": 1, "ddq": 2}


@dataclass(frozen=True)
class Target:
    """The kind of a signal in a case.

    Attributes:
        units: valid SI units, as exponents; empty if any will do.
        names: the same in words; order: of the derivative of a position, None of a torque; is_torque: of a joint.
        own: the unit in which the signal is wanted where it is that of a variable of a model, SI or not.
    """

    units: tuple[dict[str, int], ...] = ()
    names: tuple[str, ...] = ()
    order: int | None = None
    is_torque: bool = False
    own: UnitDefinition | None = None


def target(
    signal: str, torque_units: tuple[str, ...] = (), *, is_command: bool = False, unit: str | None = None
) -> Target:
    """The kind of a signal by its name: ``q<j>``, ``dq<j>``, ``ddq<j>`` and ``tau<j>`` of joints, or another.

    Args:
        torque_units: (n,) N.m or N of each joint, where they are known.
        is_command: whether ``tau<j>`` are commands of any unit.
        unit: of the variable of a model that the signal belongs to, whatever its name; None where it belongs to none.
    """
    if unit is not None:
        of_model = known_unit(unit) if unit else None
        return Target(() if of_model is None else (of_model.powers,), (unit,), own=of_model)
    if not is_of_joint(signal):
        return Target()
    stem = signal.rstrip("0123456789")
    if stem == "tau" and is_command:
        return Target()
    j = int(signal[len(stem) :])
    known = torque_units[j - 1 : j] or ("N.m", "N")
    if stem == "tau":
        return Target(tuple(_powers(unit) for unit in known), tuple(known), None, True)
    order = MOTION[stem]
    lengths = ["rad" if unit == "N.m" else "m" for unit in known]
    names = tuple(unit + ("", "/s", "/s2")[order] for unit in lengths)
    return Target(tuple(_powers(unit) for unit in names), names, order)


def is_of_joint(signal: str) -> bool:
    """Whether it is a position, velocity, acceleration or torque of a joint: ``q<j>``, ``dq<j>``, ``ddq<j>``,
    ``tau<j>``."""
    stem = signal.rstrip("0123456789")
    return stem != signal and stem in (*MOTION, "tau")


def _powers(unit: str) -> dict[str, int]:
    known = known_unit(unit)
    assert known is not None
    return known.powers


@dataclass(frozen=True)
class Conversion:
    """signal = factor * number - shift.

    Attributes:
        unit: of the column; from_file: whether the file states it and numbers had to be converted from it.
        contradicts: another unit that the file states, or empty.
    """

    factor: float
    shift: float = 0.0
    unit: str = ""
    from_file: bool = False
    contradicts: str = ""


def conversion(
    signal: str, column: Column, stated: str, wanted: Target, *, where: str, of_motor: bool = False
) -> Conversion:
    """How the numbers of a column become a signal in SI units.

    Args:
        stated: unit in the file, or empty; wanted: what the signal must be; where: file and column, for messages.
        of_motor: whether it is that of a motor, which turns whatever its joint does.

    Raises:
        InputError: the unit cannot become that of the signal.
    """
    unit = column.unit if column.unit is not None else stated
    definition = known_unit(unit) if unit else None
    factor = column.sign * column.scale
    if column.gear_ratio is not None:
        factor *= column.gear_ratio if wanted.order is None else 1.0 / column.gear_ratio
    if column.rated is not None:
        _check_rated(unit, definition, wanted, where)
        factor *= column.rated
    elif definition is not None:
        _check(signal, unit, definition, column, wanted, where, of_motor=of_motor or column.gear_ratio is not None)
    offset = 0.0
    if definition is not None:
        factor *= definition.factor
        if wanted.own is not None:
            factor /= wanted.own.factor
            offset = (definition.offset - wanted.own.offset) / wanted.own.factor
    if column.torque_constant is not None:
        factor *= column.torque_constant
    other = known_unit(stated) if stated and column.unit is not None else None
    differs = other is not None and definition is not None and other != definition
    from_file = column.unit is None and definition is not None and (definition.factor != 1.0 or offset != 0.0)
    if wanted.own is not None:
        from_file = from_file and definition != wanted.own
    if not 1 / LARGEST_FACTOR <= abs(factor) <= LARGEST_FACTOR:
        raise InputError(
            "A column is multiplied by a number that no unit and no gear has.", where=where, got=f"{factor:g} in all",
            valid=f"{1 / LARGEST_FACTOR:g} to {LARGEST_FACTOR:g}, or negative",
            next_step=f"Correct scale:, gear_ratio:, rated: or torque_constant: of {signal}.",
        )  # fmt: skip
    shift = factor / column.scale * column.zero - offset
    return Conversion(factor, shift, unit, from_file, stated if differs else "")


def _check_rated(unit: str, definition: UnitDefinition | None, wanted: Target, where: str) -> None:
    """Raise InputError where a column is no torque, or is not logged in parts of a rated one."""
    if not wanted.is_torque:
        raise InputError(
            "Only a torque is logged in parts of a rated one.", where=where, got="rated: ...", valid="tau1, tau2, ...",
            next_step="Take rated: out; a factor goes into scale:.",
        )  # fmt: skip
    if definition is None or definition.powers:
        raise InputError(
            "A torque given in parts of a rated one needs per cent as its unit.", where=where, got=unit or "no unit",
            valid="unit: '%', '‰' or '1'", next_step="Give the one in which the log has it, or take rated: out.",
        )  # fmt: skip


def _check(
    signal: str, unit: str, definition: UnitDefinition, column: Column, wanted: Target, where: str, *, of_motor: bool
) -> None:
    powers = definition.powers
    valid, names = wanted.units, wanted.names
    if of_motor and valid:  # the motor turns, whatever the joint does
        names = ("N.m",) if wanted.is_torque else (("rad", "rad/s", "rad/s2")[wanted.order or 0],)
        valid = tuple(_powers(name) for name in names)
    if column.torque_constant is not None:
        names, valid = ("A",), ({"A": 1},)
    if definition.offset and wanted.own is None:
        raise InputError(
            "A unit with an offset cannot be the unit of this signal.", where=where, got=unit,
            next_step="Convert the signal before, or give the unit of differences, such as K for degC.",
        )  # fmt: skip
    if not valid or powers in valid:
        return
    raise InputError(
        f"The unit of {signal} is not one of its kind.", where=where, got=unit, valid=" or ".join(names) or "1",
        next_step=_advice(powers, wanted),
    )  # fmt: skip


def _advice(powers: dict[str, int], wanted: Target) -> str:
    if wanted.is_torque and powers == {"A": 1}:
        return (
            "A current becomes a torque by torque_constant: ... (N.m/A, of the same kind of ampere: peak or effective) "
            "beside unit:, on the motor side with gear_ratio:; or is it the command: quantity: command?"
        )
    if not powers and wanted.is_torque:
        return "Parts of a rated torque: give it beside unit:, rated: 40 (N.m; of the motor, with gear_ratio:)."
    if wanted.order is not None and powers == {"s": -max(wanted.order, 1)}:
        return "1/min and Hz may count turns or radians: write unit: rpm (or rev/s) if they count turns."
    if wanted.order is not None and not powers:
        return "If these are counts of an encoder: scale: 360/counts with unit: deg."
    return "Give unit: of the column, of what it really holds; and check that it is the right column."
