"""A model alone: the fit of examples/house beside FMPy with scipy's least squares, tuned by hand, on the same data.

FMPy's part is what a user would write: one instance that is reset, one simulation a residual, differences with a step
that was tried out. Both find the same minimum; FMPy holds an input from the beginning of each step, so its values are
a little off.
"""

from __future__ import annotations

import runpy
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from fmu_didim import load_case
from fmu_didim.export import build_fmu
from tests.helpers import ROOT
from tests.tools.benchmarks.figure import Figure, Settings, interleaved

HOUSE = ROOT / "examples" / "house"
STEP = 1e-4
"""[1] Relative step of the differences: with scipy's own, 1.5e-8, the fit stays at its start or ends early."""


def ours() -> dict[str, tuple[float, float]]:
    """Value and standard deviation of each parameter."""
    case = load_case(HOUSE / "identify.yaml")
    estimate = case.estimator.estimate(case.model)
    found = zip(estimate.names, estimate.value, estimate.standard_deviation, strict=True)
    return {name: (float(value), float(deviation)) for name, value, deviation in found}


def with_fmpy() -> Callable[[], dict[str, float]]:
    """The fit by FMPy and scipy, its files read and its FMU unpacked already."""
    import fmpy
    from fmpy.fmi2 import FMU2Slave

    path = build_fmu(runpy.run_path(str(HOUSE / "make_fmu.py"))["house"]())
    folder, description = fmpy.extract(str(path)), fmpy.read_model_description(str(path))
    weather = np.loadtxt(HOUSE / "weather.csv", delimiter=",", skiprows=1)
    room = np.loadtxt(HOUSE / "room.csv", delimiter=",", skiprows=1)
    columns = [("time", float), ("T_out", float), ("T_beside", float)]
    inputs = np.array([tuple(row) for row in weather], dtype=columns)
    step = float(room[1, 0] - room[0, 0])

    def fit() -> dict[str, float]:
        instance = FMU2Slave(
            guid=description.guid, unzipDirectory=folder, instanceName="house",
            modelIdentifier=description.coSimulation.modelIdentifier,
        )  # fmt: skip
        instance.instantiate()

        def residual(values: Any) -> Any:
            instance.reset()
            result = fmpy.simulate_fmu(
                folder, start_time=room[0, 0], stop_time=room[-1, 0], output_interval=step, input=inputs,
                output=["T"], start_values={"R1": values[0], "R2": values[1]}, model_description=description,
                fmu_instance=instance, fmi_type="CoSimulation", terminate=True,
            )  # fmt: skip
            return np.interp(room[:, 0], result["time"], result["T"]) - room[:, 1]

        found = least_squares(residual, [0.05, 0.05], x_scale=[0.05, 0.05], diff_step=STEP, bounds=(1e-6, np.inf))
        instance.freeInstance()
        return {"R1": float(found.x[0]), "R2": float(found.x[1])}

    return fit


def run(settings: Settings) -> list[Figure]:
    """Time of FMPy with scipy over ours, in turn."""
    fmpy_fit = with_fmpy()
    mine, theirs = ours(), fmpy_fit()
    times = interleaved({"ours": ours, "fmpy": fmpy_fit}, repeats=settings.size(settings.repeats, 1), warm=False)
    apart = max(abs(mine[name][0] - theirs[name]) / mine[name][1] for name in theirs)
    medians = {f"{name} s": times.median(name) for name in times.seconds}
    note = (
        f"values at most {apart:.2g} standard deviations apart; ours with reading, checks of the start and deviations"
    )
    name = "a model of a house, two parameters: identification / FMPy with scipy.optimize, step tuned by hand"
    return [Figure(name, times.ratio("ours", "fmpy"), 2.0, "at most", medians, note)]
