"""The cheap experiment: which of some weights, hung where, and on which motion, tells drives from friction and load.

For each weight and place the motion is designed for two runs of it, one without and one with the weight; the weight
whose best motion leaves the smallest relative deviations is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fmu_didim.base.diagnostics import PROBLEM, by_weight
from fmu_didim.base.documents import validate
from fmu_didim.base.errors import InputError, SimulationError, UnknownNameError
from fmu_didim.case import Case
from fmu_didim.case.changes import merged
from fmu_didim.case.document import DRIVE, CaseDocument
from fmu_didim.case.free import loads_of
from fmu_didim.case.sources import LoadSource
from fmu_didim.dynamics.load import STEMS
from fmu_didim.dynamics.physical_set import FRICTION
from fmu_didim.model.free_parameter import load_parameters
from fmu_didim.workflow.excitation.design import Request, designed, robot_of
from fmu_didim.workflow.excitation.excited import Excited
from fmu_didim.workflow.excitation.planned import Peaks
from fmu_didim.workflow.excitation.space import end_of_last_link
from fmu_didim.workflow.excitation.weighed import Offer, Tried, Weighing

MOST_OFFERS = 30
"""[pairs] Of weight and place at most: each takes a design of its own, of seconds to minutes."""
FINALISTS = 2
"""[offers] The best of a rough comparison, whose motions are designed from all starts;"""
CLOSE = 1.2
"""[1] as far as their mean is not larger than that of the best by this factor: a rough motion is worse by less."""
OF_THE_WEIGHT = ("limits.torque", "excite")
"""Where errors are that another weight may not have: torque at rest beyond the limits, an optimisation that fails."""
STEEL = 7850.0
"""[kg/m3] Of a weight of which nothing is said: a ball of steel. A point would be the limit of what a body can be."""


def weighed(
    case: Case, request: Request, *, weights: Sequence[float], places: Sequence[Sequence[float]], label: str | None
) -> Excited:
    """The best weight, its place and its motion.

    Args:
        weights: kg; places: of the centre, m, in the frame of the last link; by default where the case has it, or the
            end of the last link.
        label: of the run with the weight; by default the first one with ``load:``.

    Raises:
        InputError: a weight or a place is none, the case has no run with a load or none without, or no weight can be
            moved; UnknownNameError, SimulationError: as of :func:`~fmu_didim.excite`.
    """
    robot = robot_of(case)
    empty, loaded = _runs(case, label)
    offers = _offers(case, loaded, weights, places, request)
    gains = tuple(name for name, entry in (case.document.identify or {}).items() if entry.of == DRIVE)
    friction = tuple(k for k, stem in zip(robot.names, robot.base.standard, strict=True) if _is_friction(stem))
    load = tuple(_load_values(_carrying(case, empty, loaded, offers[0]), loaded, offers[0]))
    own = replace(request, only=request.only or (*gains, *friction, *load))
    source = case.document.runs[loaded].load
    weighing = Weighing(
        empty=empty, loaded=loaded, tried=(), best=0, gains=gains, friction=friction, load=load, ranked=own.only,
        said=", ".join(request.only) or ("gains, friction and load" if gains else "friction and load"),
        mass_std=None if source is None or not gains else source.mass_std,
    )  # fmt: skip
    found = dict[int, Outcome]()
    wanted, is_rough = list(range(len(offers))), len(offers) > FINALISTS
    while True:
        for i in wanted:
            text = f"{offers[i].mass:g} kg at {offers[i].at} m" + (", roughly" if is_rough else "")
            request.progress(f"weight {i + 1} of {len(offers)}: {text}")
            found[i] = _tried(case, empty, loaded, offers[i], replace(own, is_rough=is_rough))
        weighing = _ranked(weighing, offers, [found[i] for i in range(len(offers))], wanted)
        if not is_rough:
            break
        wanted, is_rough = _finalists(weighing), False
    best = found[weighing.best]
    if not isinstance(best, Excited):
        raise best
    told = weighing.diagnostics(
        with_shapes=bool(best.around.space.checks), assumed=_assumed_gains(case, loaded, request)
    )  # fmt: skip
    return replace(best, weighing=weighing, diagnostics=tuple(by_weight([*best.diagnostics, *told])))


Outcome = Excited | InputError | SimulationError
"""Of a weight: its best motion, or why there is none."""


def _finalists(weighing: Weighing) -> list[int]:
    """Places of the offers whose motions are worth to be designed from all starts."""
    first, *others = weighing.order[:FINALISTS]
    least = weighing.tried[first].mean(weighing.ranked)
    return [
        first,
        *(i for i in others if not weighing.key(i)[0] and weighing.tried[i].mean(weighing.ranked) <= CLOSE * least),
    ]


def _ranked(weighing: Weighing, offers: Sequence[Offer], found: Sequence[Outcome], of: Sequence[int]) -> Weighing:
    """With what was found of all offers, of which the best among some places is taken."""
    made = [one for one in found if isinstance(one, Excited)]
    shown = set.intersection(*(set(one.in_mean) for one in made)) if made else set(weighing.ranked)
    ranked = tuple(name for name in weighing.ranked if name in shown or name in weighing.load)
    tried = tuple(_row(offer, one, i in of) for i, (offer, one) in enumerate(zip(offers, found, strict=True)))
    weighing = replace(weighing, tried=tried, ranked=ranked)
    return replace(weighing, best=min(of, key=weighing.key))


def _assumed_gains(case: Case, label: str, request: Request) -> list[str]:
    """Names of the gains that are taken for one though the log may be in another unit than the torque of the joint."""
    torque = case.document.runs[label].torque
    found = []
    for name, entry in (case.document.identify or {}).items():
        if entry.of != DRIVE or entry.start is not None or name in request.parameters:
            continue
        column = None if torque is None else torque.columns.get(f"tau{entry.joint}")
        brought = column is not None and (column.torque_constant is not None or column.gear_ratio is not None)
        if not brought and case.document.loop.drive_gains is None and (torque is None or torque.motors is None):
            found.append(name)
    return found


def _is_friction(standard: str) -> bool:
    return standard.rstrip("0123456789") in FRICTION


def _tried(case: Case, empty: str | None, loaded: str, offer: Offer, request: Request) -> Outcome:
    """The best motion with a weight; raises InputError for what does not lie at this weight."""
    own = _carrying(case, empty, loaded, offer)
    labels = [loaded] if empty is None else [empty, loaded]
    try:
        return designed(own, labels, request, _load_values(own, loaded, offer))
    except SimulationError as error:
        return error
    except InputError as error:
        if error.where.startswith(OF_THE_WEIGHT):
            return error
        raise


def _load_values(case: Case, loaded: str, offer: Offer) -> dict[str, float]:
    """Free parameter of the load -> its value with a weight, a ball of steel or with the inertia that the case has."""
    load, source = loads_of(case.document, robot_of(case))[loaded], case.document.runs[loaded].load
    about = None if source is None else source.inertia
    chi = LoadSource(mass=offer.mass, centre=offer.place, inertia=about or _of_ball(offer.mass)).known
    values = load.regrouping @ np.array([chi[stem] for stem in STEMS])
    return {free.name: float(value) for free, value in zip(load_parameters(load, loaded), values, strict=True)}


def _of_ball(mass: float) -> tuple[float, float, float, float, float, float]:
    """Inertia about the centre of a ball of steel: 2/5 m r^2, kg.m2."""
    radius = (3 * mass / (4 * math.pi * STEEL)) ** (1 / 3)
    inertia = 0.4 * mass * radius**2
    return inertia, inertia, inertia, 0.0, 0.0, 0.0


def _carrying(case: Case, empty: str | None, loaded: str, offer: Offer) -> Case:
    """The case with these two runs alone, one of them with the weight."""
    document = case.document
    taken_out = {label: None for label in document.experiments if label not in (empty, loaded)}
    load = {key: offer.load.get(key) for key in LoadSource.model_fields}
    entry: dict[str, Any] = {"load": load}
    changes: dict[str, Any] = {"validation": None, "experiments": taken_out}
    if loaded in document.experiments:
        changes["experiments"] = {**taken_out, loaded: entry}
    else:
        changes["train"] = entry
    content = merged(case.content, changes)
    content = {key: value for key, value in content.items() if value or key != "experiments"}
    return replace(case, document=validate(CaseDocument, content, where="case"))


def _row(offer: Offer, found: Outcome, is_final: bool) -> Tried:
    """A row of the table."""
    if not isinstance(found, Excited):
        problem = found.what + (f" ({found.got})" if found.got else "")
        return Tried(offer, None, np.zeros(0), np.zeros(0), problem, is_final=is_final)
    against = " ".join(str(d) for d in found.diagnostics if d.code.severity is PROBLEM)
    limits = found.bounds.torque
    peaks = Peaks.of(found.prediction.loop, limits.size).torque
    return Tried(offer, found.prediction.prospect, peaks, limits, against, is_final=is_final)


def _runs(case: Case, label: str | None) -> tuple[str | None, str]:
    """Labels of the run without and of the run with the weight."""
    runs = {label: run for label, run in case.document.runs.items() if run.role == "estimation"}
    carrying = [name for name, run in runs.items() if run.load is not None and run.load.same_as is None]
    if label is not None and label not in runs:
        raise UnknownNameError("experiment for the estimation", label, runs, where="experiment")
    if not carrying or (label is not None and runs[label].load is None):
        raise InputError(
            "No run carries a load, so that there is none to choose a weight for.", where=label or case.name,
            got=f"runs: {', '.join(runs)}",
            next_step="Add a run with load: {mass: ..., mass_std: ...} to experiments:, beside one without; its log "
            "need not exist yet. docs/howto/carry-a-load.md has such a case.",
        )  # fmt: skip
    chosen = label or carrying[0]
    source = runs[chosen].load
    chosen = source.same_as if source is not None and source.same_as is not None else chosen
    others = [name for name, run in runs.items() if run.load is None]  # none where an earlier result stands for it
    return next(iter(others), None), chosen


def _offers(
    case: Case, loaded: str, weights: Sequence[float], places: Sequence[Sequence[float]], request: Request
) -> list[Offer]:
    """All weights at all places.

    Raises:
        InputError: a weight or a place is none, or there are too many.
    """
    wrong = [w for w in weights if not (math.isfinite(w) and w > 0)]
    if not len(weights):
        raise InputError(
            "A place is for a weight, and none is offered.", where="at", got=f"{len(places)} places",
            next_step="Give the masses of the weights that you have, in kg: --weigh 0.5,1,2.",
        )  # fmt: skip
    if wrong:
        raise InputError(
            "A weight has a mass above zero.", where="weigh", got=", ".join(f"{w:g}" for w in wrong),
            valid="kg, above 0",
            next_step="Give the masses of the weights that you have, in kg: --weigh 0.5,1,2.",
        )  # fmt: skip
    for place in places:
        if len(place) != 3 or not all(math.isfinite(x) for x in place):
            raise InputError(
                "A place takes three numbers.", where="at", got=", ".join(f"{x:g}" for x in place),
                valid="x, y, z in m",
                next_step="Give the centre of the weight in the frame of the last link: --at=0.12,-0.03,0.",
            )  # fmt: skip
    usual, words = ((0.0, 0.0, 0.0), "") if len(places) else _usual_place(case, loaded, request)
    where = [(float(x), float(y), float(z)) for x, y, z in places] or [usual]
    masses, where = list(dict.fromkeys(map(float, weights))), list(dict.fromkeys(where))
    if len(masses) * len(where) > MOST_OFFERS:
        raise InputError(
            "These are too many weights and places: each pair takes a design of its own.", where="weigh, at",
            got=f"{len(masses)} x {len(where)}", valid=f"at most {MOST_OFFERS} pairs",
            next_step="Offer the lightest, the heaviest and one between, and the places that differ most.",
        )  # fmt: skip
    return [Offer(mass, place, _load(case, loaded, mass, place), words) for place in where for mass in masses]


OF_CASE, OF_SHAPE = "the centre: of the case's load", "the far end of the shape of the last link"


def _usual_place(case: Case, loaded: str, request: Request) -> tuple[tuple[float, float, float], str]:
    """Where the case has the centre of the load, or the end of the last link, and which of them, in words."""
    source = case.document.runs[loaded].load
    stated = None if source is None else source.centre
    if stated is not None:
        return stated, OF_CASE
    found = end_of_last_link(case, request.limits)
    if found is None:
        raise InputError(
            "Where the weight hangs is not known: the case states no centre: of its load, and no shape of the last "
            "link is given.", where="at",
            next_step="Give the centre of the weight, m in the frame of the last link: --at=0.12,-0.03,0; several "
            "--at are compared.",
        )  # fmt: skip
    return found, OF_SHAPE


def _load(case: Case, loaded: str, mass: float, place: tuple[float, float, float]) -> dict[str, Any]:
    """The entry ``load`` of a weight, in the form that the case has: with what it states of its load."""
    source = case.document.runs[loaded].load
    assert source is not None
    has_gains = any(entry.of == DRIVE for entry in (case.document.identify or {}).values())
    if source.mass is None and not has_gains:
        return {}
    found: dict[str, Any] = {"mass": mass}
    if source.mass_std is not None:
        found["mass_std"] = source.mass_std
    if source.centre is not None:
        found["centre"] = list(place)
    if source.inertia is not None and source.mass is not None:
        found["inertia"] = [value * mass / source.mass for value in source.inertia]
    return found
