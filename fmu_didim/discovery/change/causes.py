"""Causes that move several values at once, each as the directions in which base parameters move by it.

With b = chi_b + K chi_d the base parameters of standard ones chi (:mod:`fmu_didim.dynamics.base_parameters`):

* a point mass m at c in the frame of the last link adds m (1, c, c_y^2 + c_z^2, -c_x c_y, ...) to M, MX, ..., XX, XY,
  ... of that link: b moves by m a(c);
* friction of a joint moves the parameters whose torque depends on the velocity of this joint alone;
* a drive that gives a torque of another size than it says, tau_j (1 + g) = (W b)_j (1 + g) in the log of joint j, moves
  them by g (W' P W)^-1 W' P E_j W b along the motion of the log, with P the weights of the joints by their noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.discovery.change.contest import Form
from fmu_didim.model.parameters import RobotParameters

SAME_DIRECTION = 1e-9
"""[1] One minus the squared cosine of two directions, below which they are one."""
POINTS = 6
"""[points] Random ones at which it is asked what a torque depends on."""
SEED = 20240301
"""[1] Of the generator of these points, so that they are the same each time: any will do."""
NO_SPREAD = 1e-9
"""[1] Relative difference of two torques that are one: rounding."""
ANYWHERE = (0.31, 0.23, 0.17)
"""[1] Of the length of the robot: a place of a payload that is nothing special, to see what of it shows."""
STEP = 1e-4
"""[1] Of that length, over which slopes are taken there: moments are polynomials of the place."""
RANK = 1e-8
"""[1] Of the largest singular value, below which a direction is none."""
JOINT_TORQUE_SCALE = "joint_torque_scale"
"""Kind of the cause that the log of one joint has another scale."""
REACHES = (0.3, -0.3, 1.0)
"""[1] Of the length of the robot, at which the search for the place of a payload begins."""


@dataclass(frozen=True)
class Logged:
    """The motion of a log along which torques are looked at.

    Attributes:
        regressor: (N, n, b) of the base parameters; known: (N, n) torque of all that is not identified.
        noise: (n,) standard deviation of the residual of each joint.
    """

    regressor: Array
    known: Array
    noise: Array


@dataclass(frozen=True)
class Machine:
    """A robot whose values are compared.

    Attributes:
        parameters: its base parameters; value: (b,) theirs before.
        logged: along the motion after; None where it is not known.
    """

    parameters: RobotParameters
    value: Array
    logged: Logged | None = None


def forms_of(names: Sequence[str], units: Sequence[str], machine: Machine | None) -> list[Form]:
    """All forms of causes of values with these names.

    Args:
        names: (p,) of what is compared: base parameters that are held in one of the answers are not among them.
    """
    rows = [] if machine is None else [
        placed for form in _of_machine(machine, names) if (placed := _placed(form, machine, names)) is not None
    ]  # fmt: skip
    singles = [
        Form("parameter", 0, f"{name} alone", (name,), (units[i],), constant(np.eye(len(names))[:, [i]]))
        for i, name in enumerate(names)
    ]
    frictions = {form.names[0] for form in rows if form.kind == "friction" and form.cost == 1}
    kept = [form for form in singles if form.names[0] not in frictions]
    named = []
    for form in rows:
        twin = next((s for s in kept if form.cost == 1 and _alike(form, s)), None)
        named.append(form if twin is None else replace(form, same_as=twin.names[0]))
        kept = [s for s in kept if s is not twin]
    return [*named, *kept]


def constant(columns: Array) -> Callable[[Array], Array]:
    """The directions of a linear form."""
    return lambda x: columns


def _alike(one: Form, other: Form) -> bool:
    a, b = (form.columns(form.starts[0])[:, 0] for form in (one, other))
    return bool(1 - (a @ b) ** 2 / ((a @ a) * (b @ b)) < SAME_DIRECTION)


def _placed(form: Form, machine: Machine, names: Sequence[str]) -> Form | None:
    """A form over base parameters (b,) as one over what is compared; None where nothing of it is left."""
    base = list(machine.parameters.base.names)
    pick = np.array([[float(own == name) for own in base] for name in names])
    original = form.columns
    placed = replace(form, columns=lambda x: pick @ original(x))
    return placed if np.abs(placed.columns(form.starts[0])).any(axis=0).all() else None


def _of_machine(machine: Machine, names: Sequence[str]) -> Iterator[Form]:
    parameters = machine.parameters
    unit = dict(zip(parameters.base.names, parameters.base.units, strict=True))
    groups = friction_groups(parameters)
    groups = {j: [i for i in own if parameters.base.names[i] in names] for j, own in groups.items()}
    yield from _friction(parameters, {j: own for j, own in groups.items() if own}, machine.value, unit)
    yield from _payload(parameters)
    yield from _gains(machine)


def friction_groups(parameters: RobotParameters) -> dict[int, list[int]]:
    """Joint, from 1 -> places of the base parameters whose torque depends on nothing but its velocity, and on that."""
    n, rng = parameters.joint_count, np.random.default_rng(SEED)
    q, other_q = rng.uniform(-2, 2, size=(2, POINTS, n))
    ddq, other_ddq = rng.uniform(-2, 2, size=(2, POINTS, n))
    dq, base = rng.uniform(0.5, 2, size=(POINTS, n)) * rng.choice([-1, 1], size=(POINTS, n)), parameters.base
    observed = np.zeros((POINTS, len(parameters.model.observed)))

    def at(q: Array, dq: Array, ddq: Array) -> Array:
        return parameters.regressor(q, dq, ddq, observed=observed)[0]

    first, same, rest = at(q, dq, ddq), at(other_q, dq, other_ddq), at(q, np.roll(dq, 1, axis=0), ddq)
    found: dict[int, list[int]] = {}
    for i in range(base.count):
        if base.regrouping[i].any():
            continue
        acts = np.abs(first[:, :, i]).max(axis=0)
        joint = int(np.argmax(acts))
        alone = np.delete(acts, joint).max(initial=0.0) == 0
        still = np.allclose(first[:, joint, i], same[:, joint, i], rtol=NO_SPREAD, atol=0)
        if alone and still and not np.allclose(first[:, joint, i], rest[:, joint, i]):
            found.setdefault(joint + 1, []).append(i)
    return found


def _friction(
    parameters: RobotParameters, groups: dict[int, list[int]], value: Array, unit: dict[str, str]
) -> Iterator[Form]:
    base, eye = parameters.base, np.eye(parameters.base.count)
    for joint, own in groups.items():
        sets = [[i] for i in own] + ([own] if len(own) > 1 else [])
        for each in sets:
            names = tuple(base.names[i] for i in each)
            yield Form(
                "friction", joint, f"friction of joint {joint}", names, tuple(unit[name] for name in names),
                constant(eye[:, each]),
            )  # fmt: skip
    if len(groups) < 2:
        return
    every = [i for own in groups.values() for i in own]
    stems = sorted({base.standard[i].rstrip("0123456789") for i in every})
    alike = [[i for i in every if base.standard[i].rstrip("0123456789") == stem] for stem in stems]
    columns = np.column_stack([np.where(np.isin(np.arange(base.count), own), value, 0.0) for own in alike])
    title = "friction of all joints"
    if columns.any(axis=0).all():
        yield Form(
            "friction_everywhere", 0, title, tuple(f"{stem} of all" for stem in stems), ("1",) * len(stems),
            constant(columns),
        )  # fmt: skip
    names = tuple(base.names[i] for i in every)
    title = f"friction of joints {', '.join(map(str, groups))}, each by itself"
    yield Form(
        "friction_of_each", 0, title, names, tuple(unit[name] for name in names), constant(eye[:, every])
    )  # fmt: skip


def _payload(parameters: RobotParameters) -> Iterator[Form]:
    """A point mass on the last link: at its axis, anywhere, and a body of any shape."""
    joint, title = parameters.joint_count, "payload on the last link"
    size = _length(parameters)

    def column(c: Array) -> Array:
        return _of_point(parameters, c)

    generic = size * np.array(ANYWHERE)
    table, places = column(generic), list[int]()
    if not np.abs(table).any():
        return
    if np.abs(origin := column(np.zeros(3))).any():
        yield Form("payload", joint, title, ("mass",), ("kg",), constant(origin[:, None]))
    whole = table[:, None] / np.linalg.norm(table)
    for k in range(3):
        h = STEP * size * np.eye(3)[k]
        slope = (column(generic + h) - column(generic - h)) / (2 * STEP * size)
        if (norm := np.linalg.norm(slope)) > 0:
            tried = np.column_stack([whole, slope / norm])
            if np.linalg.svd(tried, compute_uv=False)[-1] > RANK:
                whole, places = tried, [*places, k]
    if places:

        def columns(x: Array) -> Array:
            c = np.zeros(3)
            c[places] = x
            return column(c)[:, None]

        starts = np.array([size * reach * np.eye(len(places))[k] for k in range(len(places)) for reach in REACHES])
        names = ("mass", *(f"c{'xyz'[k]}" for k in places))
        yield Form("payload", joint, title, names, ("kg", *("m" for _ in places)), columns, starts)
    left, sizes, _ = np.linalg.svd(_of_body(parameters), full_matrices=False)
    rank = int((sizes > RANK * sizes[0]).sum())
    if rank > 1 + len(places):
        names = tuple(f"direction {k + 1}" for k in range(rank))
        yield Form("payload", joint, title, names, ("",) * rank, constant(left[:, :rank]))


def _length(parameters: RobotParameters) -> float:
    """m, of all links together; 1 where there is none."""
    joints = parameters.model.description.joints
    return float(sum(abs(j.a) + abs(j.d) for j in joints if j.type == "revolute")) or 1.0


def _of_link(parameters: RobotParameters, values: dict[str, float]) -> Array:
    """(b,) by which base parameters move with these of the last link."""
    base = parameters.base
    chi, joint = np.zeros(len(base.standard_names)), parameters.joint_count
    for stem, value in values.items():
        name = f"{stem}{joint}"
        if name in base.standard_names:
            chi[base.standard_names.index(name)] = value
    return base.reduce(chi)


def _of_point(parameters: RobotParameters, c: Array) -> Array:
    """(b,) by a mass of 1 kg at c (3,) in the frame of the last link."""
    x, y, z = c
    return _of_link(parameters, {
        "M": 1.0, "MX": x, "MY": y, "MZ": z, "XX": y * y + z * z, "YY": x * x + z * z, "ZZ": x * x + y * y,
        "XY": -x * y, "XZ": -x * z, "YZ": -y * z,
    })  # fmt: skip


def _of_body(parameters: RobotParameters) -> Array:
    """(b, 10) by each inertial parameter of the last link."""
    stems = ("M", "MX", "MY", "MZ", "XX", "YY", "ZZ", "XY", "XZ", "YZ")
    return np.column_stack([_of_link(parameters, {stem: 1.0}) for stem in stems])


def _gains(machine: Machine) -> Iterator[Form]:
    """A torque of one joint, or of all, that is not what the log says."""
    parameters, value = machine.parameters, machine.value
    n = parameters.joint_count
    if (logged := machine.logged) is None:
        if n == 1 and not parameters.base.known.any():
            yield Form(JOINT_TORQUE_SCALE, 1, "torque scale of joint 1", ("gain",), ("1",), constant(value[:, None]))
        return
    weight = 1 / np.maximum(logged.noise, np.finfo(float).tiny)
    table = (logged.regressor * weight[:, None]).reshape(-1, value.size)
    size = np.maximum(np.linalg.norm(table, axis=0), np.finfo(float).tiny)
    torque = (logged.regressor @ value + logged.known) * weight
    for j in range(n):
        right = np.where(np.arange(n) == j, torque, 0.0).ravel()
        moved = np.linalg.lstsq(table / size, right, rcond=None)[0] / size
        yield Form(
            JOINT_TORQUE_SCALE, j + 1, f"torque scale of joint {j + 1}", ("gain",), ("1",), constant(moved[:, None]),
            scales=frozenset({j + 1}),
        )  # fmt: skip
    if n > 1:
        moved = np.linalg.lstsq(table / size, torque.ravel(), rcond=None)[0] / size
        yield Form(
            "torque_scale", 0, "torque scale of all joints", ("gain",), ("1",), constant(moved[:, None]),
            scales=frozenset(range(1, n + 1)),
        )  # fmt: skip
