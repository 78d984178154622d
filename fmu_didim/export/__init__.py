"""Blocks as FMUs: C code by CasADi inside one fixed wrapper, compiled and zipped.

``path = build_fmu(block)`` is all most callers need.
"""

from fmu_didim.export.build import compile_console_program, compile_shared_library
from fmu_didim.export.c_code import generate_c
from fmu_didim.export.fmu import build_fmu
from fmu_didim.export.modelica import build_modelica
from fmu_didim.export.sources import compile_sources, source_compiler
from fmu_didim.export.variables import layout

__all__ = [
    "build_fmu",
    "build_modelica",
    "compile_console_program",
    "compile_shared_library",
    "compile_sources",
    "generate_c",
    "layout",
    "source_compiler",
]
