"""All codes of diagnostics, as ``fmu-didim check --codes`` and the page of codes show them."""

from __future__ import annotations

import importlib
import pkgutil

import fmu_didim.checks
import fmu_didim.workflow
from fmu_didim.base.diagnostics import CATALOGUE, Code, Severity
from fmu_didim.report.terminal import wrapped


def all_codes() -> list[Code]:
    """Every code that any verb can name: by severity, then by rank, then by name.

    The modules that define them are those of the checks, and those that the verbs import.
    """
    for package in (fmu_didim.checks, fmu_didim.workflow):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)
    order = list(Severity)
    return sorted(CATALOGUE, key=lambda code: (order.index(code.severity), code.rank, code.name))


def codes_text() -> str:
    """The codes with what they mean and what to do, at most 100 columns wide."""
    lines = []
    for code in all_codes():
        lines += [f"{code.name} ({code.severity.value})", *wrapped(code.meaning, "  ", "  ")]
        lines += wrapped(code.next_step, "  Next: ", "    ") if code.next_step else []
    return "\n".join(lines) + "\n"
