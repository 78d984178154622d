"""Identify the dynamic parameters of robots and drives from motor torque alone (DIDIM).

The verbs: :func:`load_case`, :func:`identify`, :func:`simulate_case`, :func:`build_fmu`, :func:`load_fmu`,
:func:`read_robot`, :func:`read_controller`. They are imported when first used.
"""

from __future__ import annotations

import importlib
from typing import Any

_HOMES = {
    "load_case": "fmu_didim.case",
    "identify": "fmu_didim.workflow",
    "simulate_case": "fmu_didim.workflow",
    "discover": "fmu_didim.workflow",
    "export_ssp": "fmu_didim.workflow",
    "build_fmu": "fmu_didim.export",
    "load_fmu": "fmu_didim.components",
    "read_ssp": "fmu_didim.ssp",
    "write_ssp": "fmu_didim.ssp",
    "to_control": "fmu_didim.components",
    "read_robot": "fmu_didim.robot",
    "read_controller": "fmu_didim.controllers",
    "FmuDidimError": "fmu_didim.errors",
}
__all__ = sorted(_HOMES)  # pyright: ignore
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'fmu_didim' has no attribute '{name}'; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    return __all__
