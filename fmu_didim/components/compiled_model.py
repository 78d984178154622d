"""Models as compiled code."""

from __future__ import annotations

from dataclasses import replace

from fmu_didim.base.errors import BuildError
from fmu_didim.components.base import Component
from fmu_didim.components.fmu import load_fmu
from fmu_didim.components.model import ModelComponent
from fmu_didim.export import build_fmu


def with_compiled_twin(component: ModelComponent) -> ModelComponent:
    """The model with its equations compiled to C (by the code of its FMU), which the compiled loop then runs.

    The compiled code is kept by its content; it gives no derivatives, which are those of the equations. Where there is
    no C compiler, or where values are not in SI units, the model stays as it is.
    """
    try:
        twin = load_fmu(build_fmu(component.block, directional=False))
    except BuildError:
        return component
    if _units(twin) != _units(component):  # what is not in SI units here is in an FMU
        return component
    twin = twin.built_from(component.block)
    named = twin.with_names(component.inputs, component.outputs)
    if component.substeps is not None:
        named = named.with_substeps(component.substeps) or named  # type: ignore[assignment]
    return replace(component, twin=named)


def _units(component: Component) -> dict[str, str]:
    """Units of what goes in and comes out, by name."""
    return {v.name: v.unit for v in (*component.inputs, *component.outputs, *component.parameters)}
