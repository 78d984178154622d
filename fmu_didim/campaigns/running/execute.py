"""One run, from its content to its row, in the process of a worker."""

from __future__ import annotations

import socket
import sys
import tempfile
import time
import traceback
from collections import OrderedDict
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from fmu_didim.base.diagnostics import DiagnosedError
from fmu_didim.base.errors import FmuDidimError, FmuError, IdentificationError, SimulationError
from fmu_didim.campaigns.planning.fields import with_written_descriptions
from fmu_didim.campaigns.planning.plan import Content
from fmu_didim.campaigns.planning.truth import (
    Truth,
    hidden_effects,
    noisy_logs,
    regrouped,
    simulated_truth,
    with_simulated_logs,
)
from fmu_didim.campaigns.running.store import ANSWERED, FAILED, MEMORY_LIMIT, REFUSED
from fmu_didim.case import Case, load_case
from fmu_didim.estimators import Didim
from fmu_didim.estimators.starts.start import start_values
from fmu_didim.results.findings import FindingsDocument
from fmu_didim.results.result import ResultDocument
from fmu_didim.workflow.discover import discover
from fmu_didim.workflow.identify import identify

PREPARED = 4
"""[cases] Loaded cases that a worker caches; runs of one case follow each other."""

ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "FMU_DIDIM_WORKERS": "1"}
"""Of every worker process: one thread each, as there are as many workers as cores."""


@dataclass(frozen=True)
class Task:
    """A run as it is sent to a worker.

    Attributes:
        id, design, data, seed: as of the run; verb: ``identify`` or ``discover``; content: of the case.
        files: folder for all result files; empty for none.
    """

    id: str
    design: str
    data: str
    seed: int
    verb: str
    content: Content
    files: str = ""


@dataclass(frozen=True)
class Trial:
    """The outcome of loading a case: its error, or why its runs may fail; both empty where it is good."""

    problem: str = ""
    doubt: str = ""


@dataclass
class WorkerState:
    """The state of a worker process between runs.

    Attributes:
        scratch: folder of this process; prepared: the last cases with their truth, by design.
    """

    scratch: tempfile.TemporaryDirectory[str] = field(default_factory=tempfile.TemporaryDirectory)
    prepared: OrderedDict[str, tuple[Case, Truth | None]] = field(default_factory=OrderedDict)


def start_worker(process: Any, memory_mb: float) -> None:
    """Initialise a worker process and limit its memory, where the system can do that."""
    process.state = WorkerState()
    if sys.platform == "linux":
        import resource

        bytes_ = int(memory_mb * 2**20)
        resource.setrlimit(resource.RLIMIT_DATA, (bytes_, bytes_))


def execute(process: Any, task: Task) -> dict[str, Any]:
    """The row of a run, with its error if it fails."""
    begun, begun_cpu = time.perf_counter(), time.process_time()
    row: dict[str, Any] = {
        "id": task.id, "design": task.design, "data": task.data, "seed": task.seed, "status": ANSWERED,
        "host": socket.gethostname(), "started": datetime.now(UTC).isoformat(timespec="milliseconds"),
    }  # fmt: skip
    try:
        row |= _answer(process.state, task)
    except DiagnosedError as error:
        row |= refusal(error, [d.code.name for d in error.found])
    except IdentificationError as error:
        row |= refusal(error, [])
    except FmuDidimError as error:
        row |= {"status": FAILED, "message": str(error)}
    except MemoryError as error:
        row |= {"status": MEMORY_LIMIT, "message": f"The run needs more memory than its limit. {error}".strip()}
    except Exception as error:  # noqa: BLE001 - one bad run must not end the others; its row says so
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(last.filename).name}, line {last.lineno}"
        row |= {"status": FAILED, "message": f"{type(error).__name__}: {error} ({place})"}
    return row | {"seconds": time.perf_counter() - begun, "cpu_seconds": time.process_time() - begun_cpu}


def refusal(error: FmuDidimError, codes: list[str]) -> dict[str, Any]:
    """Entries of the row of a refused run."""
    return {"status": REFUSED, "verdict": "refused", "message": str(error), "reasons": codes}


def _answer(state: WorkerState, task: Task) -> dict[str, Any]:
    case, truth = prepared(state, task)
    out = task.files or None
    if task.verb == "discover":
        return _findings(discover(case, out, **task.content.options).document, case, truth)
    return _result(identify(case, out).document, case, truth)


def prepared(state: WorkerState, task: Task) -> tuple[Case, Truth | None]:
    """The case of a run with its data; runs of one design share the loaded case."""
    content = task.content
    if task.design not in state.prepared:
        state.prepared[task.design] = _loaded(Path(state.scratch.name), task)
        while len(state.prepared) > PREPARED:
            state.prepared.popitem(last=False)
    state.prepared.move_to_end(task.design)
    case, truth = state.prepared[task.design]
    if truth is None:
        return case, None
    return case.with_signals(noisy_logs(truth, content.noise, task.data)), truth


def _loaded(scratch: Path, task: Task) -> tuple[Case, Truth | None]:
    content, folder = task.content, Path(task.content.folder)
    case = with_written_descriptions(content.case, scratch)
    if content.truth is None:
        return load_case(case, folder=folder), None
    truth = simulated_truth(with_written_descriptions(content.truth, scratch), folder)
    logs = noisy_logs(truth, {}, task.data)
    return load_case(with_simulated_logs(case, truth.outputs), folder=folder, signals=logs), truth


def try_case(process: Any, task: Task) -> Trial:
    """Load a case before any of its runs, simulate its machine and check its start values."""
    try:
        case, _ = prepared(process.state, task)
        start = getattr(case.estimator, "start", None)
        if isinstance(start, Mapping):
            start_values(case.model, start)
        for component in case.model.loop.systems[case.model.first].components.values():
            component.instantiate().close()
    except (SimulationError, FmuError) as error:  # the loop may diverge at this value, or an FMU fail in a step
        return Trial(doubt=str(error)) if _can_be_loaded(process.state, task.content) else Trial(str(error))
    except FmuDidimError as error:
        return Trial(str(error))
    except Exception as error:  # noqa: BLE001 - such as the code of a controller of the user
        return Trial(f"{type(error).__name__}: {error}")
    return Trial()


def _can_be_loaded(state: WorkerState, content: Content) -> bool:
    """Whether a case fails only when it runs: its rows then say so, and the other runs go on."""
    case = with_written_descriptions(content.case, Path(state.scratch.name))
    try:
        load_case(case, folder=content.folder, require_torque=False)
    except FmuDidimError:
        return False
    return True


def _result(document: ResultDocument, case: Case, truth: Truth | None) -> dict[str, Any]:
    """The row of an identification."""
    known = partial(_true, truth, regrouped(case.parameters))
    didim = document.stages.get(Didim.name)
    parameters = []
    for name, p in document.parameters.items():
        entry = {"name": name, "unit": p.unit, "value": p.value, "std": p.std, "low": p.interval[0],
                 "high": p.interval[1], "true": known(name)}  # fmt: skip
        if didim is not None and name in didim.value:
            paper = didim.formulas.get("paper", {}).get(name)
            entry |= {"didim_value": didim.value[name], "didim_std": didim.std[name], "paper_std": paper}
        parameters.append(entry)
    held_out = [document.relative_error_percent[label].total for label, e in document.experiments.items()
                if e.role == "validation" and label in document.relative_error_percent]  # fmt: skip
    return {
        "verdict": document.verdict, "reasons": [reason.code for reason in document.reasons],
        "conditions": document.conditions,
        "message": document.advice if document.verdict == "not_settled" else "",
        "iterations": document.iterations, "finish_iterations": document.finish_iterations,
        "error_percent": document.fitted_error_percent.total if document.fitted_error_percent else None,
        "held_out_percent": max((e for e in held_out if e is not None), default=None),
        "condition_number": document.condition_number, "parameters": parameters,
    }  # fmt: skip


def _true(truth: Truth | None, own: Mapping[str, str], name: str) -> float | None:
    """The true value of a parameter, if the same parameters are regrouped into it in both models."""
    if truth is None or name not in truth.values:
        return None
    value, with_it = truth.values[name]
    return value if with_it == own.get(name.partition("[")[0], "") else None


_OF_FINDINGS = {"answer", "findings", "curves", "gap", "ratio_interval", "error_percent"}
"""Entries of ``findings.json`` that a row holds, as JSON."""


def _findings(document: FindingsDocument, case: Case, truth: Truth | None) -> dict[str, Any]:
    """The row of a discovery."""
    known = partial(_true, truth, regrouped(case.parameters))
    gaps = [pair for label, pair in document.gap.items() if document.roles.get(label) == "validation"]
    parameters = [
        {"name": p.name, "unit": p.unit, "value": p.value, "std": p.std, "low": p.interval[0], "high": p.interval[1],
         "true": known(p.name)}
        for p in document.base_parameters
    ]  # fmt: skip
    return {
        "verdict": document.verdict, "reasons": [reason.code for reason in document.reasons],
        "conditions": document.conditions,
        "answer": document.answer, "named": "+".join(f"{f.effect}@{f.joint}" for f in document.findings),
        "hidden": hidden_effects(truth.robot, case.robot) if truth is not None else None,
        "gap_before": gaps[0].before if gaps else None, "gap_after": gaps[0].after if gaps else None,
        "findings": document.model_dump_json(include=_OF_FINDINGS, by_alias=True), "parameters": parameters,
    }  # fmt: skip


def close_worker(process: Any) -> None:
    """Remove the scratch folder of a worker process."""
    with suppress(OSError):
        process.state.scratch.cleanup()
