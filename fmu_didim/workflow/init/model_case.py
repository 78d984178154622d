"""Writing the case of a model: an FMU alone, what drove it and what was measured of it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from fmu_didim.base.documents import TO_FILL_IN
from fmu_didim.components.fmu.description import FLOAT_TYPES, MODEL_EXCHANGE, FmuDescription, FmuVariable
from fmu_didim.data.units import known_unit
from fmu_didim.workflow.init.data_file import DataFile
from fmu_didim.workflow.init.inventory import Inventory
from fmu_didim.workflow.init.model_columns import MOST_SHOWN, Match, ModelFile, matched, variables
from fmu_didim.workflow.init.model_runs import ModelRun, model_runs
from fmu_didim.workflow.init.texts import CASE_FILE, flow, named_from, rendered, time_entry

MOST_ACTIVE = 2
"""Parameters that are identified before the user says which: any more may be too many for any data."""
MOST_LISTED = 30
"""Parameters that the case lists; all others are counted."""
_NOT_IDENTIFIED = ("substeps", "relative_tolerance")
"""Parameters that say how an FMU computes."""
_INITIAL = r"start|init|(^|[._])\w{1,2}_?0$"
"""In the name of a parameter: it is where the model starts."""
_SETTING = (
    r"^_|(^|\.)settings\.|toler|(rel|abs)_?tol|(step|time)_?(step|size)|step(size)?_?(max|min|ctrl)|max_?(step|order|iter)"
    r"|\bdt_?(min|max)?$|solver|slow_?start|plot|log_?level|verbos|debug|run_?stats"
)
"""In the name of a parameter: it says how the FMU computes or what it writes, and is nothing of what it models."""
_LIMIT = r"(^|[._])(min|max)(imum)?$|limit|threshold|(^|[._])(bits|counts|offset|start_time|stop_time|end_time)$"
"""In the name of a parameter: data seldom show it."""
_NATURE = r"(^|[._])(g|g_n|pi|eps|sigma|k_B|N_A|c_0)$"
_SIGNED = ({"m": 1}, {"rad": 1}, {"K": 1}, {"s": 1}, {"A": 1}, {"kg": 1, "m": 2, "s": -3, "A": -1})
"""Units of what may well be below zero: places, angles, temperatures, instants, currents, voltages."""


def model_case(found: Inventory, out: Path) -> tuple[dict[str, str], list[tuple[str, str, str]]]:
    """The text of the case by the name of its file; and what the FMU and each column was taken for.

    Raises:
        InputError: the files show no output of the model, or which belong together is not clear.
    """
    assert found.model is not None
    ports, reason = found.model
    fmu, files = ports.fmu, matched(ports.fmu, found.data)
    runs = model_runs(files)
    fitted = [run for run in runs if not run.held_out]
    short = len(fitted) == 1 and len(runs) <= 2
    entries = [{"label": run.label, "held_out": run.held_out, **_entries(run, out)} for run in runs]
    active, others = _parameters(fmu)
    others += _starts(fmu, is_source=ports.source.suffix.lower() == ".mo")
    text = rendered(
        "model.yaml.j2", name=ports.source.stem, model=named_from(out, ports.source), short=short, runs=entries,
        edit=TO_FILL_IN, active=active, others=others[:MOST_LISTED], more=len(others[MOST_LISTED:]),
        undriven=_undriven(fmu, runs), file=named_from(out, ports.source),
    )  # fmt: skip
    return {CASE_FILE: text}, [(ports.source.name, "", f"the model: {reason}"), *_told(fmu, files, runs)]


def _entries(run: ModelRun, out: Path) -> dict[str, Any]:
    """The entries of inputs and of what was measured, and the notes beside them."""
    notes: list[str] = []
    inputs = None if run.inputs is None else _entry(run.inputs, run.inputs.inputs, out, notes)
    measured = [_entry(file, file.outputs, out, notes) for file in run.measured]
    if run.is_guess:
        notes.append("nothing but the order of the files says that these belong together: check it")
    return {
        "inputs": inputs, "measured": measured[0] if len(measured) == 1 else measured,
        "notes": [note for note in dict.fromkeys(notes) if note],
    }  # fmt: skip


def _entry(file: ModelFile, matches: Sequence[Match], out: Path, notes: list[str]) -> Any:
    """A file as a case names it: its path alone where its columns have the names of the variables."""
    data = file.data
    time = time_entry(data)
    if time:
        notes.append(f"time of {data.path.name}: {time['time_note']}")
    columns = {match.name: match.column for match in matches}
    for match in matches:
        if not match.is_clear:
            notes.append(f"{match.name}: {match.reason or 'which of ' + ', '.join(match.columns)}")
    if not time and all(match.is_clear and _is_found(data, match) for match in matches):
        return named_from(out, data.path)
    times = {"time": time["time"]} if time else {}
    return {"file": named_from(out, data.path), **times, "columns": columns}


def _is_found(data: DataFile, match: Match) -> bool:
    """Whether a column is found by the name of the variable."""
    alike = [match.name == name or data.table.find(match.name) == name for name in match.columns]
    return all(alike)


def _parameters(fmu: FmuDescription) -> tuple[list[dict[str, str]], list[dict[str, str]]]:
    """The parameters that are identified at first, and all others, each with its entry and what is said of it."""
    offered = [
        v for v in fmu.variables
        if v.is_settable and v.type in FLOAT_TYPES and not v.shape and v.start is not None
        and v.name not in _NOT_IDENTIFIED
    ]  # fmt: skip
    offered.sort(key=_is_setting)
    likely = [v for v in offered if _is_likely(v)]
    of_limits = [v for v in offered if _is_likely(v, or_limit=True)]  # mu_max, where nothing else is there
    active = ([v for v in likely if v.unit] or likely or of_limits)[:MOST_ACTIVE]
    return [_listed(v) for v in active], [_listed(v) for v in offered if v not in active]


def _starts(fmu: FmuDescription, *, is_source: bool) -> list[dict[str, str]]:
    """Where the states start, which can be identified where this project integrates the model."""
    if not is_source and fmu.interface(MODEL_EXCHANGE) is None:
        return []
    known = {v.name: v for v in fmu.variables}
    derived = [match[1] for name in known if (match := re.fullmatch(r"der\((.+)\)", name))]
    listed = [(name, known.get(name)) for name in dict.fromkeys([*fmu.states, *derived])]
    return [
        {"name": flow(f"{name}.start"), "entry": "{}", "said": f"{v.unit if v else ''}: where it starts".strip(": ")}
        for name, v in listed
    ]


def _is_setting(v: FmuVariable) -> bool:
    return bool(re.search(_SETTING, v.name, re.IGNORECASE))


def _is_likely(v: FmuVariable, *, or_limit: bool = False) -> bool:
    if float(v.start or 0) == 0 or _is_setting(v) or re.search(_NATURE, v.name):
        return False
    return not re.search(_INITIAL if or_limit else f"{_INITIAL}|{_LIMIT}", v.name, re.IGNORECASE)


def _listed(v: FmuVariable) -> dict[str, str]:
    known = known_unit(v.unit) if v.unit else None
    is_positive = float(v.start or 0) > 0 and known is not None and known.powers and known.powers not in _SIGNED
    said = f"{float(v.start or 0):g} {v.unit}".strip() + (f": {v.description}" if v.description else "")
    return {"name": flow(v.name), "entry": "{minimum: 0}" if is_positive else "{}", "said": " ".join(said.split())}


def _undriven(fmu: FmuDescription, runs: Sequence[ModelRun]) -> str:
    """The inputs that no file has, with the values at which they stay."""
    driven = {match.name for run in runs if run.inputs is not None for match in run.inputs.inputs}
    open_ = [v for v in variables(fmu, "input") if v.name not in driven]
    shown = [f"{v.name} = {float(_number(v)):g} {v.unit}".strip() for v in open_[:MOST_SHOWN]]
    return ", ".join([*shown, *(["..."] if len(open_) > MOST_SHOWN else [])])


def _number(v: FmuVariable) -> float:
    return {"true": 1.0, "false": 0.0}.get(v.start or "0") or float(v.start or 0) if v.start != "false" else 0.0


def _told(fmu: FmuDescription, files: Sequence[ModelFile], runs: Sequence[ModelRun]) -> Iterator[tuple[str, str, str]]:
    """File, column and what it was taken for."""
    inputs = {v.name for v in variables(fmu, "input")}
    for file in files:
        data = file.data
        used = any(file is run.inputs or file in run.measured for run in runs)
        for clock in dict.fromkeys(data.table.times.values()) or [data.clock()]:
            rate = data.rate_hz() if clock and not data.table.times else None
            if clock:
                yield data.path.name, clock, f"time{f', a row in {1 / rate:.3g} s' if rate else ''}"
        for match in file.matches if used else ():
            kind = "input" if match.name in inputs else "output"
            for column in match.columns:
                if match.is_clear:
                    unit = data.table.unit(column)
                    given = f" in {unit}" if unit else f" in {match.unit}, as no unit is given" if match.unit else ""
                    yield data.path.name, column, f"{kind} {match.name}{given}, {match.reason}"
                else:
                    yield data.path.name, column, f"perhaps the {kind} {match.name}".replace(TO_FILL_IN, "measured")
        for column in file.left if used else [g.name for g in data.guesses]:
            yield data.path.name, column, "not used"
        for note in data.table.notes:
            yield data.path.name, "", note
    for run in runs:
        if run.held_out:
            names = ", ".join(file.data.path.name for file in run.measured)
            yield names, "", "held out: it only judges the answer"
