"""Linear transformations, units, and the component that applies an offset between two others.

Source: "System Structure and Parameterization", version 1.0, Units and LinearTransformation.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from fmu_didim.base.errors import InputError
from fmu_didim.components import Component, ModelComponent
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import Block

TRANSFORMATION = "linear_transformation"
"""Name of the block that :func:`transforming_component` makes, by which the writer knows it again."""


@dataclass(frozen=True)
class Affine:
    """target = factor * source + offset."""

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, value: float) -> float:
        return self.factor * value + self.offset

    def then(self, following: Affine) -> Affine:
        """This one first, the following one after it."""
        return Affine(following.factor * self.factor, following.factor * self.offset + following.offset)


@dataclass(frozen=True)
class Unit:
    """A unit of one file: value in SI base units = factor * value + offset.

    Attributes:
        name: as the variables name it.
        exponents: of the base units kg, m, s, A, K, mol, cd, rad; None if the file does not define the unit.
    """

    name: str
    exponents: tuple[int, ...] | None = None
    factor: float = 1.0
    offset: float = 0.0


def conversion(source: Unit | None, target: Unit | None, *, where: str) -> Affine:
    """From values in one unit to values in another; the identity if either is unknown (None).

    An exponent of rad counts too: Hz and rad/s differ by 2 pi, and only it distinguishes them.

    Raises:
        InputError: the units differ in dimension, or one of two different ones is not defined.
    """
    if source is None or target is None or source == target:
        return Affine()
    if source.exponents is None or target.exponents is None:
        if source.name == target.name:
            return Affine()
        unknown = source if source.exponents is None else target
        raise InputError(
            f"The unit '{unknown.name}' is not defined, so nothing can be converted to or from it.", where=where,
            got=f"from '{source.name}' to '{target.name}'",
            next_step='Define it in Units with a BaseUnit, or set suppressUnitConversion="true".',
        )  # fmt: skip
    if source.exponents != target.exponents:
        raise InputError(
            "These units measure different quantities.", where=where, got=f"from '{source.name}' to '{target.name}'",
            next_step='Correct the units, or set suppressUnitConversion="true" beside a LinearTransformation.',
        )  # fmt: skip
    return Affine(source.factor / target.factor, (source.offset - target.offset) / target.factor)


def transforming_component(transformation: Affine) -> ModelComponent:
    """A component without state, input ``u`` and output ``y``: y = factor * u + offset.

    It stands directly before the component it feeds, so it changes neither order nor time of the loop.
    """
    x, u, p = ca.SX.sym("x", 0), ca.SX.sym("u"), ca.SX.sym("p", 2)
    block = Block(
        name=TRANSFORMATION,
        description="Linear transformation of a connection",
        inputs=(Variable("u", "", "input"),),
        outputs=(Variable("y", "", "output"),),
        states=(),
        parameters=(
            Variable("factor", "", "parameter", transformation.factor),
            Variable("offset", "", "parameter", transformation.offset),
        ),
        update=ca.Function("update", [x, u, p], [ca.SX(0, 1)]),
        output=ca.Function("output", [x, u, p], [p[0] * u + p[1]]),
        start=ca.Function("start", [u, p], [ca.SX(0, 1)]),
    )
    return ModelComponent(block, substeps=1)


def component_transformation(component: Component) -> Affine | None:
    """The transformation of a component made by :func:`transforming_component`; None for any other component."""
    if isinstance(component, ModelComponent) and component.block.name == TRANSFORMATION:
        values = component.parameter_values()
        return Affine(values["factor"], values["offset"])
    return None
