"""The description of an FMU as text."""

from __future__ import annotations

from collections.abc import Iterator

from fmu_didim.components.fmu.description import OPTION_TYPES, PORT_TYPES, REAL_TYPES, FmuDescription, FmuVariable


def info_lines(fmu: FmuDescription) -> Iterator[str]:
    """Version, interfaces, platforms, clocks, and variables with type, unit and start value, one a line."""
    yield f"{fmu.name}: FMI {fmu.version}, by {fmu.tool or 'an unknown tool'}"
    yield f"binaries: {', '.join(fmu.platforms) or 'none'}"
    for interface in fmu.interfaces:
        abilities = {
            "saves its state": interface.has_state,
            "gives derivatives": interface.has_derivatives,
            "takes variable steps": interface.has_variable_step,
            "has event mode": interface.has_event_mode,
            "may return early": interface.may_return_early,
            "only once in a process": interface.once_per_process,
            "needs its tool": interface.needs_execution_tool,
        }
        yield f"{interface.kind}: {', '.join(name for name, has in abilities.items() if has) or 'nothing declared'}"
    if fmu.state_count:
        yield f"continuous states: {fmu.state_count}, event indicators: {fmu.indicator_count}"
    for clock in fmu.clocks:
        interval = f"{clock.interval:g} s" if clock.interval is not None else "not given"
        yield f"clock {clock.name}: {clock.causality}, {clock.variability} interval, {interval}"
    groups = {f"{c}s": [v for v in fmu.variables if v.causality == c] for c in ("input", "output", "parameter")}
    groups["start values"] = [v for v in fmu.variables if v.is_start_value and v.type in REAL_TYPES]
    for title, found in groups.items():
        if title == "start values" and not found:
            continue
        yield ""
        yield f"{title}: {len(found)}"
        for v in found:
            yield f"  {v.name:32} {v.type:9} {v.unit:12} {v.start or '':14} {_note(v)}{v.description}".rstrip()


def _note(variable: FmuVariable) -> str:
    """Marks a variable that the loop cannot use."""
    types = OPTION_TYPES + REAL_TYPES if variable.causality == "parameter" else PORT_TYPES
    return "" if variable.type in types else "(not offered) "
