"""The components of a loop: FMUs, python-control systems and CasADi models behind one interface."""

from fmu_didim.components.base import Component, Instance, SameObject, rename
from fmu_didim.components.block_control import to_control
from fmu_didim.components.control import block_as_control
from fmu_didim.components.fmu import FmuComponent, load_fmu
from fmu_didim.components.model import ModelComponent
from fmu_didim.components.user_control import is_control, law_arguments, wrap_control, wrap_law

__all__ = [
    "Component",
    "FmuComponent",
    "Instance",
    "ModelComponent",
    "SameObject",
    "block_as_control",
    "is_control",
    "law_arguments",
    "load_fmu",
    "rename",
    "to_control",
    "wrap_control",
    "wrap_law",
]
