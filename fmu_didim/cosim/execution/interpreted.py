"""The loop over the ticks in Python: for any component, and the meaning that ``loop.c`` follows bit for bit."""

from __future__ import annotations

import numpy as np

from fmu_didim.cosim.execution.algebraic_loops import LoopSolver
from fmu_didim.cosim.execution.running import CHECK_INTERVAL, LoopRun, Observer


def run_interpreted(
    run: LoopRun, observe: Observer | None = None, solver: LoopSolver | None = None, *, careful: bool = False
) -> None:
    """Run all ticks and fill the recording of the run; ``careful``: look at all values whenever they change."""
    table, signals, rows, time_of = run.table, run.signals, run.rows, run.time_of
    count, parts, lag, jacobi = table.shape[1], run.parts, run.lag, run.system.jacobi
    instances = {part.name: part.instance for part in parts}
    one_rate = all(part.every == 1 for part in parts)
    time = run.start
    for k in range(run.end):
        time = time_of(k)
        signals[:count] = table[min(k, table.shape[0] - 1)]
        if run.delayed and rows[k] >= 0:
            run.sampled[rows[k]] = signals
        due = parts if one_rate else [part for part in parts if k % part.every == 0]
        if jacobi:
            for part in due:
                part.gather(signals)
        for part in due:
            if not jacobi:
                part.gather(signals)
            part.apply(k)
            if careful:
                run.look(part, time)
        if solver is not None:
            solver.solve(signals, due, time)
        _record(run, k, count)
        if observe is not None and k >= lag and rows[k - lag] >= 0:
            observe(int(rows[k - lag]), instances)
        if run.beat is not None:
            run.beat()
        if careful or k % CHECK_INTERVAL == 0:
            _check_bounds(run, time)
        for part in parts:
            if k % part.every == part.every - 1 and not part.after_step:
                part.lead(table, k)
                part.advance(k - part.every + 1)
                if careful:
                    run.look(part, time_of(k + 1))
    _check_bounds(run, time)


def _record(run: LoopRun, k: int, count: int) -> None:
    row = run.rows[k]
    if not run.delayed:
        if row < 0:
            return
        run.applied[row] = run.signals
    elif row >= 0:
        run.applied[row, :count] = run.signals[:count]
    for part in run.parts:
        late = run.rows[k - part.lag] if k >= part.lag else -1
        if run.delayed and late >= 0:
            run.applied[late, part.place] = run.signals[part.place]
        if run.delayed and row >= 0 and not part.delayed:
            run.sampled[row, part.place] = run.signals[part.place]
        if late >= 0:
            run.record[late, part.given] = part.inputs


def _check_bounds(run: LoopRun, time: float) -> None:
    # Written so that NaN counts as outside.
    inside = (run.signals >= run.lowest) & (run.signals <= run.highest)
    if not inside.all():
        raise run.diverged(int(np.flatnonzero(~inside)[0]), time)
