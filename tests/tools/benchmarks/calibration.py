"""Models alone: the fits of examples/house and examples/batch by this package and by others, on the same data.

FMPy with scipy's least squares is what a user would write and tune by hand: one instance that is reset, one simulation
a residual, differences with a step that was tried out. Both find the same minimum; FMPy holds an input from the
beginning of each step, so its values for the house are a little off. ModestPy and estim8 run with the settings of their
own pages.
"""

from __future__ import annotations

import runpy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from fmu_didim import load_case
from fmu_didim.data.signals import Array
from fmu_didim.export import build_fmu
from tests.helpers import ROOT
from tests.tools.benchmarks.figure import OFF, OVER, Figure, Settings, interleaved
from tests.tools.benchmarks.peers import ESTIM8, MODESTPY, Answer

STEP = 1e-4
"""[1] Relative step of the differences: with scipy's own, 1.5e-8, the fit stays at its start or ends early."""
REWEIGHTED = 4
"""[rounds] Of least squares with deviations by what is simulated: from then on no value moves by 0.001 sigma."""
STARTS = {"house": {"R1": 0.05, "R2": 0.05}, "batch": {"mu_max": 0.4, "Y_XS": 0.35, "X0": 0.2, "X0[second]": 0.2}}
"""Task -> where its parameters start, as in its case."""
NOISE = {"X": (0.02, 0.05), "S": (0.2, 0.0)}
"""Output of the batch -> absolute and relative standard deviation, as its case states them."""
TITLES = {"house": "a model of a house, two parameters", "batch": "a model of a batch, two replicates, four parameters"}
BY_HAND = "FMPy with scipy.optimize, step tuned by hand"

Values = Mapping[str, float]
Fit = Callable[[], Values]


def ours(task: str) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of each parameter."""
    case = load_case(ROOT / "examples" / task / "identify.yaml")
    estimate = case.estimator.estimate(case.model)
    found = zip(estimate.names, estimate.value, estimate.standard_deviation, strict=True)
    return {name: (float(value), float(deviation)) for name, value, deviation in found}


@cache
def fmu(task: str) -> Path:
    """The FMU of an example, compiled for this machine."""
    script = runpy.run_path(str(ROOT / "examples" / task / "make_fmu.py"))
    return build_fmu(script[task]())


def table(task: str, name: str) -> Array:
    """A table of an example, an empty cell not a number."""
    return np.genfromtxt(ROOT / "examples" / task / f"{name}.csv", delimiter=",", skip_header=1)


@dataclass(frozen=True)
class ByFmpy:
    """An FMU that FMPy simulates again and again: unpacked once, one instance that is reset."""

    folder: str
    description: Any
    instance: Any

    @staticmethod
    def of(task: str) -> ByFmpy:
        """That of an example."""
        import fmpy
        from fmpy.fmi2 import FMU2Slave

        path = str(fmu(task))
        folder, description = fmpy.extract(path), fmpy.read_model_description(path)
        instance = FMU2Slave(
            guid=description.guid, unzipDirectory=folder, instanceName=task,
            modelIdentifier=description.coSimulation.modelIdentifier,
        )  # fmt: skip
        instance.instantiate()
        return ByFmpy(folder, description, instance)

    def outputs(self, time: Array, names: Sequence[str], values: Values, inputs: Any = None) -> Array:
        """(N, m) outputs at equidistant instants."""
        import fmpy

        self.instance.reset()
        result = fmpy.simulate_fmu(
            self.folder, start_time=time[0], stop_time=time[-1], output_interval=time[1] - time[0], input=inputs,
            output=list(names), start_values=dict(values), model_description=self.description,
            fmu_instance=self.instance, fmi_type="CoSimulation", terminate=True,
        )  # fmt: skip
        return np.column_stack([np.interp(time, result["time"], result[name]) for name in names])


def _least_squares(residual: Callable[[Array], Array], values: Values, begin: Array) -> Array:
    scale = list(values.values())
    return least_squares(residual, begin, x_scale=scale, diff_step=STEP, bounds=(1e-6, np.inf)).x


def house_by_hand() -> Fit:
    """The fit of the house by FMPy and scipy, its files read and its FMU unpacked already."""
    model, start = ByFmpy.of("house"), STARTS["house"]
    room = table("house", "room")
    columns = [("time", float), ("T_out", float), ("T_beside", float)]
    weather = np.array([tuple(row) for row in table("house", "weather")], dtype=columns)

    def residual(values: Array) -> Array:
        return model.outputs(room[:, 0], ["T"], dict(zip(start, values, strict=True)), weather)[:, 0] - room[:, 1]

    return lambda: dict(zip(start, _least_squares(residual, start, np.array([*start.values()])), strict=True))


def batch_by_hand() -> Fit:
    """The same of the batch; samples are weighted anew with what the fit before has simulated."""
    model, start = ByFmpy.of("batch"), STARTS["batch"]
    tables = [table("batch", name) for name in ("batch_1", "batch_2")]
    taken = np.isfinite(np.vstack(tables)[:, 1:])

    def simulated(values: Array) -> Array:
        shared = {"mu_max": values[0], "Y_XS": values[1]}
        runs = zip(tables, values[2:], strict=True)
        return np.vstack([model.outputs(rows[:, 0], list(NOISE), {**shared, "X0": x0}) for rows, x0 in runs])

    def fit() -> Values:
        values, measured = np.array([*start.values()]), np.vstack(tables)[:, 1:]
        for _ in range(REWEIGHTED):
            columns = zip(simulated(values).T, NOISE.values(), strict=True)
            deviation = np.column_stack([np.hypot(absolute, part * y) for y, (absolute, part) in columns])

            def residual(tried: Array, deviation: Array = deviation) -> Array:
                return ((simulated(tried) - measured) / deviation)[taken]

            values = _least_squares(residual, start, values)
        return dict(zip(start, values, strict=True))

    return fit


def house_by_modestpy(rounds: int) -> Answer | str:
    """The house by ModestPy, its bounds a decade to each side of the start."""
    folder, start = ROOT / "examples" / "house", STARTS["house"]
    return MODESTPY.answer({
        "fmu": str(fmu("house")), "inputs": str(folder / "weather.csv"), "measured": str(folder / "room.csv"),
        "known": {}, "estimated": {name: [value, value / 10, value * 10] for name, value in start.items()},
        "rounds": rounds,
    })  # fmt: skip


def batch_by_estim8(rounds: int) -> Answer | str:
    """The batch by estim8, with bounds as on its pages."""
    folder = ROOT / "examples" / "batch"
    time = table("batch", "batch_1")[:, 0]
    found = ESTIM8.answer({
        "fmu": str(fmu("batch")), "noise": NOISE, "rounds": rounds,
        "tables": {"first": str(folder / "batch_1.csv"), "second": str(folder / "batch_2.csv")},
        "bounds": {"mu_max": [0.1, 0.9], "Y_XS": [0.1, 1.0], "X0": [0.02, 0.4], "X0_second": [0.02, 0.4]},
        "own": {"X0_second": {"of": "X0", "in": "second"}}, "time": [time[0], time[-1], time[1] - time[0]],
    })  # fmt: skip
    if isinstance(found, str):
        return found
    return Answer({name.replace("_second", "[second]"): value for name, value in found.values.items()}, found.seconds)


PEERS = {"house": (MODESTPY.name, house_by_modestpy, 1), "batch": (ESTIM8.name, batch_by_estim8, 3)}
"""Task -> a tool that can state it, how, and how many rounds: ModestPy takes minutes for each. It has no replicates and
no outputs at instants of their own, estim8 has no recorded inputs, so each has one task."""


def _off(values: Values, found: Mapping[str, tuple[float, float]]) -> float:
    """Largest distance from ours in standard deviations."""
    return max(abs(found[name][0] - values[name]) / found[name][1] for name in found)


def _figures(task: str, by_hand: Fit, settings: Settings) -> list[Figure]:
    """A task by this package over the same by hand, and by a tool."""
    found, hand = ours(task), by_hand()
    times = interleaved(
        {"ours": lambda: ours(task), "by hand": by_hand}, repeats=settings.size(settings.repeats, 1), warm=False
    )
    mine, (tool, answer_of, rounds) = times.median("ours"), PEERS[task]
    medians = {"ours s": mine, "theirs s": times.median("by hand"), OFF: _off(hand, found)}
    note = "ours with reading, checks of the start and standard deviations"
    made = [Figure(f"{TITLES[task]}{OVER}{BY_HAND}", times.ratio("ours", "by hand"), 2.0, "at most", medians, note)]
    name = f"{TITLES[task]}{OVER}{tool}, settings of its pages"
    answer = "absent: a quick run makes no environment" if settings.quick else answer_of(rounds)
    if isinstance(answer, str):
        return [*made, Figure(name, None, None, note=answer)]
    medians = {"ours s": mine, "theirs s": answer.seconds, OFF: _off(answer.values, found)}
    return [*made, Figure(name, mine / answer.seconds, None, "at most", medians, "its imports not counted; all cores")]


def run(settings: Settings) -> list[Figure]:
    """Time and distance of the others, of each task."""
    by_hand = {"house": house_by_hand, "batch": batch_by_hand}
    return [figure for task, prepared in by_hand.items() for figure in _figures(task, prepared(), settings)]
