"""What a load on the last link tells, and what it does not: gains that rest on its weight, runs that were exchanged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.load import Load, body_of, unit_of_body
from fmu_didim.estimators.starts.gains import free_gains
from fmu_didim.fit.estimate import Estimate

GAIN_KNOWN = 0.1
"""[1] Relative standard deviation of a gain, from which it is hardly known: data sheets state torque constants to a
tenth."""
SURELY_THERE = 3.0
"""[standard deviations] That the mass of a load must be above zero: less than one in 700 by chance."""
ONE_PERCENT = 0.01
"""[1] Of the mass, for which it is told what values would do."""

LOAD_TOLD = CATALOGUE(
    "load-is-the-difference", REMARK, rank=67,
    meaning="A load is what a run carries more than the runs without one: a tool that is mounted in all of them is a "
    "part of the robot.",
    next_step="Nothing, if the runs without load: carried no weight.",
)  # fmt: skip
LOAD_MASS_STATED = CATALOGUE(
    "load-mass-stated", REMARK, rank=67,
    meaning="Gains of drives, and with them all masses, inertias and frictions, are proportional to the stated mass of "
    "a load: torques alone do not tell a wrong one.",
    next_step="Weigh the load, and give mass_std: so that intervals contain its uncertainty.",
)  # fmt: skip
LOAD_ABSENT = CATALOGUE(
    "load-absent", DOUBT, rank=3,
    meaning="A run that is said to carry a load carries hardly anything more than the others, or less.",
    next_step="Check which run is the loaded one; a load that is too light for this motion is not told from none.",
)  # fmt: skip
GAIN_UNKNOWN = CATALOGUE(
    "drive-gain-unknown", DOUBT, rank=43,
    meaning="The gain of a drive is hardly known: what is known of the load puts hardly any torque on its joint.",
    next_step="Move that joint with more acceleration, hang the load farther from its axis, or take a heavier one; or "
    "take its gain out of identify: and give it by the torque constant of the log.",
)  # fmt: skip


@dataclass(frozen=True)
class Carried:
    """What an experiment carried.

    Attributes:
        body: name of a quantity -> value, standard deviation, unit; see :func:`~fmu_didim.dynamics.load.body_of`.
        unseen: parameters of the load that move no torque; also: other experiments with the same load.
    """

    body: Mapping[str, tuple[float, float, str]]
    unseen: tuple[str, ...]
    also: tuple[str, ...]


def carried(estimate: Estimate) -> dict[str, Carried]:
    """Label of an experiment -> what it carried; a load that several carry under the first of them."""
    model, found = estimate.model, dict[str, Carried]()
    for label, load in model.loads.items():
        alike = [other for other, one in model.loads.items() if one is load]
        if label != alike[0]:
            continue
        places = [i for i, _ in model.free_parameters.loads(label)]
        body = body_of(load, estimate.value[places], estimate.covariance[np.ix_(places, places)])
        quantities = {name: (*both, unit_of_body(name)) for name, both in body.items()}
        found[label] = Carried(quantities, load.unseen, tuple(alike[1:]))
    return found


def load_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """What is to be said of loads; nothing where no run carries one."""
    model = estimate.model
    found = list[Diagnostic]()
    labels = dict.fromkeys(k.experiment for k in model.free_parameters if k.is_load)
    for label in labels:
        assert label is not None
        found += _of_load(estimate, label, model.loads[label])
    if labels or model.loads:
        text = "Loads are what these runs carry more than the others; a tool mounted in all runs is part of the robot."
        found.append(Diagnostic(LOAD_TOLD, text, ", ".join(model.loads), condition="the other runs carry no load"))
    return found + (_of_gains(estimate) if model.loads else [])


def _of_load(estimate: Estimate, label: str, load: Load) -> list[Diagnostic]:
    """A load that is not there."""
    value: Array = estimate.value if estimate.unlimited is None else estimate.unlimited
    if "M" not in load.alone:
        return []
    i = estimate.model.free_parameters.loads(label)[load.stems.index("M")][0]
    sigma = float(estimate.standard_deviation[i])
    if value[i] >= SURELY_THERE * sigma:
        return []
    text = f"The load has a mass of {value[i]:.3g} \u00b1 {sigma:.2g} kg: hardly any, or the runs are exchanged."
    return [Diagnostic(LOAD_ABSENT, text, label, float(value[i] / sigma), SURELY_THERE, "standard deviations")]


def _of_gains(estimate: Estimate) -> list[Diagnostic]:
    """Gains of drives: on what they rest, and which of them are hardly known."""
    gains = free_gains(estimate.model)
    if not gains:
        return []
    found = []
    for joint, i in sorted(gains.items()):
        relative = float(estimate.standard_deviation[i] / np.abs(estimate.value[i]))
        if relative > GAIN_KNOWN:
            text = (
                f"The gain of the drive is {estimate.value[i]:.3g} \u00b1 {estimate.standard_deviation[i]:.2g} "
                f"({100 * relative:.0f} %): what is known of the load hardly loads this joint."
            )
            found.append(Diagnostic(GAIN_UNKNOWN, text, f"joint {joint + 1}", relative, GAIN_KNOWN, "1"))
    masses = {label: one.body["mass"] for label, one in carried(estimate).items() if "mass" in one.body}
    words = ", ".join(
        f"{mass:.4g}{f' ± {sigma:.2g}' if sigma else ''} kg ({label})" for label, (mass, sigma, _) in masses.items()
    )
    text = (
        f"Gains of drives rest on the mass of the load, {words}: {100 * ONE_PERCENT:.0f} % more of it is as much more "
        "of every gain, mass, inertia and friction."
    )
    found.append(Diagnostic(LOAD_MASS_STATED, text, condition=f"the load weighs what the case says, {words}"))
    return found
