"""Whether the values of an estimate are physical: friction, links, and the inertia matrix in all positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.distributions import chi2_isf, normal_isf
from fmu_didim.base.errors import IdentificationError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.base_parameters import BaseParameters
from fmu_didim.dynamics.physical_set import FRICTION
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.fit.feasibility import Nearest, nearest_physical
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import POSITIVE, RobotParameters

EIGENVALUE_TOLERANCE = 1e-9
"""[1] To which the smallest scaled eigenvalue of the inertia matrix is searched for."""
NEGATIVE_FRICTION = 2.0
"""[standard deviations] Below zero, beyond which friction would drive the machine: one of forty is by chance."""
FALSE_UNPHYSICAL = 1e-3
"""[1] Probability with which noise alone moves a physical robot so far from physical values. The squared distance is a
chi-square with as many degrees of freedom as inequalities are active at the nearest values."""
POPULATION = 15
"""[points a joint] Of positions among which the smallest eigenvalue is searched: usual."""
GENERATIONS = 60
"""[generations] More of them move the eigenvalue by less than 1 %."""

FRICTION_NEGATIVE = CATALOGUE(
    "friction-negative", DOUBT, rank=60,
    meaning="A friction parameter lies below zero by more than its uncertainty: this friction would drive the machine.",
    next_step="Run fmu-didim discover CASE.yaml: another effect, a wrong gain or a late clock may be the cause.",
)  # fmt: skip
NOT_PHYSICAL = CATALOGUE(
    "not-physical", DOUBT, rank=55,
    meaning="These base parameters are physically impossible: within their uncertainty no links of positive mass have "
    "them.",
    next_step="Run fmu-didim discover CASE.yaml, and check geometry, gravity, gains and clock: an impossible "
    "inertia of a link may compensate an error there.",
)  # fmt: skip
MASS_INDEFINITE = CATALOGUE(
    "mass-matrix-indefinite", DOUBT, rank=57,
    meaning="The inertia matrix is not positive definite in all positions that the joints can have: there the model "
    "cannot be simulated.",
    next_step="Use the model only along motions like those of the data, or excite the joint more strongly.",
)  # fmt: skip


def physical_diagnostics(model: LoopModel, covariance: Array) -> list[Diagnostic]:
    """Physically impossible values of a model, known with a covariance (p, p); none without a robot description.

    Where experiments have values of their own, those of each are checked.
    """
    if not isinstance(model.parameters, RobotParameters):
        return []
    robot, base, values = model.parameters.model, model.parameters.base, model.start
    low, high = joint_range(model)
    found: dict[tuple[str, str], Diagnostic] = {}
    has_own = any(map(model.free_parameters.has_own_base, model.experiments))
    for label in model.experiments if has_own else (model.first,):
        acting = model.free_parameters.map_to_base(label)
        theta, part = model.theta(values, label), acting @ covariance @ acting.T
        of_experiment = [*negative_friction(base, theta, part), *far_from_physical(robot, base, theta, part)]
        for diagnostic in (*of_experiment, *indefinite(model.parameters, theta, part, low, high)):
            found.setdefault((diagnostic.code.name, diagnostic.text), diagnostic)
    return list(found.values())


def joint_range(model: LoopModel) -> tuple[Array, Array]:
    """Lowest and highest positions (n,): those of the description, else a whole turn; of a prismatic joint without
    limits the range of the references."""
    assert isinstance(model.parameters, RobotParameters)
    low, high = [], []
    for j, joint in enumerate(model.parameters.model.description.joints, start=1):
        if joint.limits is not None:
            ends = joint.limits
        elif joint.type == "revolute":
            ends = (-np.pi, np.pi)
        else:
            columns = [e.reference.column(f"q{j}") for e in model.experiments.values() if f"q{j}" in e.reference.names]
            reached = np.concatenate([np.zeros(1), *columns])
            ends = (float(reached.min()), float(reached.max()))
        low.append(ends[0])
        high.append(ends[1])
    return np.array(low), np.array(high)


def negative_friction(base: BaseParameters, theta: Array, covariance: Array) -> list[Diagnostic]:
    """Friction parameters below zero by more than two standard deviations."""
    deviation, found = np.sqrt(np.diag(covariance)), []
    for name, standard, unit, value, sigma in zip(base.names, base.standard, base.units, theta, deviation, strict=True):
        stem = standard.rstrip("0123456789")
        if stem in FRICTION and value < -NEGATIVE_FRICTION * sigma:
            excess, place = float(value / sigma if sigma > 0 else -np.inf), f"joint {standard.removeprefix(stem)}"
            text = f"{name} = {value:.3g} ± {sigma:.2g} {unit} is negative by {-excess:.1f} standard deviations."
            found.append(Diagnostic(FRICTION_NEGATIVE, text, place, excess, -NEGATIVE_FRICTION, "standard deviations"))
    return found


def far_from_physical(robot: RobotModel, base: BaseParameters, theta: Array, covariance: Array) -> list[Diagnostic]:
    """Base parameters that physical links cannot have within their uncertainty: all together, else one by one.

    Together they show more than each alone; but where many inequalities are active, chance explains a distance that is
    too far for a single one.
    """
    try:
        near = nearest_physical(robot, base, theta, covariance)
        bound = float(np.sqrt(chi2_isf(FALSE_UNPHYSICAL, max(near.constraints, 1))))
        if near.distance > bound:
            return [_not_physical(base, theta, near, bound)]
        bound = float(normal_isf(FALSE_UNPHYSICAL / base.count))
        # Physical values stay so when all are multiplied: only a sign can be wrong of one alone.
        suspects = np.flatnonzero(theta < -bound * np.sqrt(np.diag(covariance)))
        single = [nearest_physical(robot, base, theta, covariance, alone=int(i)) for i in suspects]
    except IdentificationError as error:
        return [Diagnostic(NOT_PHYSICAL, error.what, next_step=error.next_step)]
    worst = max(single, key=lambda one: one.distance, default=near)
    return [_not_physical(base, theta, worst, bound)] if worst.distance > bound else []


def _not_physical(base: BaseParameters, theta: Array, near: Nearest, bound: float) -> Diagnostic:
    name, unit = base.names[near.parameter], base.units[near.parameter]
    if len(near.link) > 1:
        place = f"joints {' and '.join(map(str, near.link))}"
        holder, kind = f"No coupled motors of {place} have", "motors"
    else:
        place = f"link {''.join(map(str, near.link))}"
        holder, kind = f"No {place} of positive mass has", "links"
    text = (
        f"{holder} these values: the nearest that physical {kind} have are "
        f"{near.distance:.1f} standard deviations away, where chance explains {bound:.1f}; {name} would move most, "
        f"from {theta[near.parameter]:.3g} to {near.values[near.parameter]:.3g} {unit}."
    )
    return Diagnostic(NOT_PHYSICAL, text, place, near.distance, bound, "standard deviations")


def indefinite(
    parameters: RobotParameters, theta: Array, covariance: Array, low: Array, high: Array
) -> list[Diagnostic]:
    """An inertia matrix that is not positive definite at some position between low and high, (n,) each."""
    worst = worst_position(parameters, theta, low, high)
    if worst.eigenvalue > POSITIVE:
        return []
    joint, name, slopes = parameters.weakest(worst.position, theta)
    sigma = float(np.sqrt(max(float(slopes @ covariance @ slopes), 0.0)))
    where = ", ".join(f"{v:.3g}" for v in worst.position)
    text = (
        f"The inertia matrix is not positive definite at q = ({where}): its smallest scaled eigenvalue is "
        f"{worst.eigenvalue:.2g} ± {sigma:.2g}, of the motion of joint {joint}, most of it by {name}."
    )
    return [Diagnostic(MASS_INDEFINITE, text, f"joint {joint}", worst.eigenvalue, POSITIVE, "1")]


@dataclass(frozen=True)
class Worst:
    """Where the scaled inertia matrix has its smallest eigenvalue: position (n,) and the eigenvalue."""

    position: Array
    eigenvalue: float


def worst_position(parameters: RobotParameters, theta: Array, low: Array, high: Array) -> Worst:
    """The smallest eigenvalue of the scaled inertia matrix over a range of positions, (n,) each, by differential
    evolution (Storn, Price, Journal of Global Optimization 11, 1997)."""
    from scipy.optimize import differential_evolution  # slow to import

    robot, chi = parameters.model, parameters.base.expand(theta)
    found = differential_evolution(
        lambda positions: robot.inertia_along(positions.T, chi), list(zip(low, high, strict=True)), vectorized=True,
        updating="deferred", init="latinhypercube", popsize=POPULATION, maxiter=GENERATIONS, polish=False, seed=0,
        tol=0.0, atol=EIGENVALUE_TOLERANCE,
    )  # fmt: skip
    return Worst(np.asarray(found.x), float(found.fun))
