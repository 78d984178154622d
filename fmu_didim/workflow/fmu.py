"""The verb ``fmu``: what an FMU says of itself, and how it behaves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from fmu_didim.components.fmu import FmuProbe, info_lines, load_fmu, probe_fmu, read_description
from fmu_didim.components.fmu.description import MODEL_EXCHANGE
from fmu_didim.export import build_modelica


def fmu_info(file: Path) -> str:
    """Version, interfaces, platforms, and variables with units and start values, one a line."""
    return "\n".join(info_lines(read_description(_as_fmu(file))))


def fmu_check(
    file: Path,
    *,
    interface: str | None = None,
    step_size: float | None = None,
    time_limit_s: float = 120.0,
    say: Callable[[str], None],
) -> FmuProbe:
    """How an FMU behaves: reset, saved state, feed-through, parameters; and how it is run again.

    Args:
        file: an FMU, or a Modelica file, which becomes one and is run in model exchange by default, as in a case.
        interface: ``co-simulation`` or ``model-exchange``; step_size: communication step, s.
        time_limit_s: for all questions; say: takes each question before it is asked.
    """
    made = load_fmu(_as_fmu(file), interface=interface or (MODEL_EXCHANGE if _is_modelica(file) else None))
    return probe_fmu(made, step_size=step_size, whole_s=time_limit_s, say=say)


def _is_modelica(file: Path) -> bool:
    return file.suffix.lower() == ".mo"


def _as_fmu(file: Path) -> Path:
    """The FMU of a file; raises BuildError where a Modelica file cannot become one."""
    return build_modelica(file) if _is_modelica(file) else file
