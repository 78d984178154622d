"""Whether two answers can be compared, what of them is, and what must be known of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.checks.validation import Validation
from fmu_didim.data.signals import Array
from fmu_didim.data.tables.readers import READER_OF
from fmu_didim.discovery.change.causes import Logged, Machine
from fmu_didim.discovery.change.difference import CHANGED, Difference, chance_of_sizes
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.results.comparison import ResidualChange
from fmu_didim.results.result import ParameterResult, ResultDocument

SAME_ROWS = 0.95
"""[1] Of the samples at the same instants, from which two logs are one: noise, even in coarse steps, repeats less."""
FEWEST_ROWS = 10
"""[samples] At the same instants, that are compared."""
SAME_VALUE = 1e-6
"""[1] Relative difference of values that are held, up to which they are the same: results keep more digits."""
FOLLOWS = 0.2
"""[1] Of the simulated torque of a joint, by which the inverse model along the saved motion may be off: the share of a
joint in a change of its torque is needed to some ten per cent, and logs of few samples tell accelerations no better."""
SAME_STEP = 1e-6
"""[1] Relative difference of two sampling steps, up to which they are one: stamps are rounded."""
SAME_INSTANT = 1e-9
"""[s] Between instants of two logs that are one."""
FEWEST_SAMPLES = 4.0
"""[samples] Independent ones of a joint, at least: with fewer, its noise is not known."""

CHANGE_RESULT_DOUBTED = CATALOGUE(
    "change-result-doubted", DOUBT, rank=10,
    meaning="One of the two results that are compared is doubtful. What moved its values beyond their intervals looks "
    "like a change of the machine, or hides one.",
    next_step="Settle the doubts of that result first, then compare again.",
)  # fmt: skip
CHANGE_REST = CATALOGUE(
    "change-rest", DOUBT, rank=11,
    meaning="The cause explains all but a small part of the change of the values, but that part is more than noise: "
    "the cause is not quite what the model of it says, or something smaller has changed, too.",
    next_step="Undo or settle the named cause, record another log, and compare again.",
)  # fmt: skip
CHANGE_IN_PART = CATALOGUE(
    "change-in-part", DOUBT, rank=11,
    meaning="No cause explains what the two logs differ by, but an effect that came or went would explain them far "
    "better than that nothing has changed. It leaves values that differ: it is a part of what has happened, or stands "
    "for something like it.",
    next_step="Look for that effect at the machine; run fmu-didim discover on both logs, and compare again with what "
    "it finds in the description.",
)  # fmt: skip
CHANGE_LACKS = CATALOGUE(
    "change-lacks", DOUBT, rank=13,
    meaning="Both logs show an effect that the model lacks. The values absorb a part of it, which along another "
    "motion, or where it has grown, looks like a change.",
    next_step="Run fmu-didim discover on both, add the effect to the description, and compare again.",
)  # fmt: skip
CHANGE_RESIDUAL = CATALOGUE(
    "change-residual", DOUBT, rank=12,
    meaning="The residual of a joint is not as large after as before. Either the noise of the log has changed, or the "
    "machine has got, or lost, something that the model lacks; the values absorb a part of that.",
    next_step="Compare the cases (fmu-didim compare BEFORE.yaml AFTER.yaml), which looks for effects, too; or run "
    "fmu-didim discover on both.",
)  # fmt: skip
CHANGE_HELD = CATALOGUE(
    "change-held", DOUBT, rank=14,
    meaning="A value is identified in one of the results and held in the other, or held at another value. The other "
    "values make up for it, and differ though the machine is the same.",
    next_step="Identify both with the same parameters and the same known values, then compare again.",
)  # fmt: skip
CHANGE_LOOP = CATALOGUE(
    "change-loop", DOUBT, rank=16,
    meaning="The two results were found with different loops: another controller, rate, order, delay or estimator "
    "option. If the machine itself did not change in that way, the values differ for that reason.",
    next_step="Use the same controller and loop in both cases, unless the machine itself was changed.",
)  # fmt: skip
CHANGE_PRIOR = CATALOGUE(
    "change-prior", DOUBT, rank=18,
    meaning="A result rests on a prior, which pulls its values: two with the same prior look more alike than the "
    "machines are.",
    next_step="Identify both without prior:, then compare again.",
)  # fmt: skip
CHANGE_MOTION = CATALOGUE(
    "change-motion", REMARK, rank=60,
    meaning="The two logs were recorded along different motions. What the model lacks acts differently along them, "
    "and moves the values apart without any change of the machine.",
    next_step="Repeat the motion of the first log.",
)  # fmt: skip


@dataclass(frozen=True)
class Answer:
    """One of two results that are compared.

    Attributes:
        place: ``before`` or ``after``; source: where it was read.
        document, validations: of the result; robot: with its values, None without a description.
    """

    place: str
    source: str
    document: ResultDocument
    validations: tuple[Validation, ...]
    robot: RobotDescription | None

    @property
    def shared(self) -> dict[str, ParameterResult]:
        """Name -> parameters that hold for all of its experiments."""
        return {name: p for name, p in self.document.parameters.items() if p.experiment is None}

    def values_of(self, names: Sequence[str]) -> tuple[Array, Array]:
        """(p,) values of these, and their (p, p) covariance."""
        every = list(self.document.parameters)
        places = [every.index(name) for name in names]
        covariance = np.array([[np.nan if v is None else v for v in row] for row in self.document.covariance])
        return np.array([self.shared[name].value for name in names]), covariance[np.ix_(places, places)]

    @property
    def samples(self) -> int:
        """Of the torques of all joints that were fitted."""
        fitted = (e.samples for e in self.document.experiments.values() if e.role == "estimation")
        return sum(fitted) * len(self.document.torque_unit)

    @cached_property
    def parameters(self) -> RobotParameters | None:
        """The base parameters of the robot; None without a description, or where it is not that of the result."""
        if self.robot is None:
            return None
        try:
            model = RobotModel(self.robot)
            found = RobotParameters(model, base_parameters(model))
        except FmuDidimError:
            return None
        own = {name for name, p in self.shared.items() if p.standard}
        return found if own <= set(found.names) and found.relations() == self.document.regrouping else None

    @property
    def fitted(self) -> list[Validation]:
        """Of the experiments that were fitted, as far as their torques were saved."""
        return [v for v in self.validations if v.role == "estimation" and not v.failure]

    def independent(self) -> Array:
        """(n,) independent samples by which the noise of each joint is known; infinite where it is stated."""
        document, n = self.document, len(self.document.torque_unit)
        found = np.full(n, float(self.samples // n))
        for noise in document.noise:
            if noise.joint <= n:
                alike = min(noise.lag1**2, 1.0)
                found[noise.joint - 1] = min(found[noise.joint - 1], self.samples // n * (1 - alike) / (1 + alike))
                if noise.noise_is_stated:
                    found[noise.joint - 1] = np.inf
        return np.asarray(np.maximum(found - len(document.parameters) / n, FEWEST_SAMPLES))


def refuse(answer: Answer) -> None:
    """Raise InputError where an answer holds no values that could be compared."""
    document = answer.document
    if document.verdict in ("refused", "not_settled") or not document.parameters:
        raise InputError(
            "A result without settled values cannot be compared.", where=answer.source or answer.place,
            got=document.verdict, valid="valid, doubtful",
            next_step="Follow the reasons of that result, identify again, then compare.",
        )  # fmt: skip
    if len(document.covariance) != len(document.parameters):
        raise InputError(
            "The result was saved without the covariance of its values.", where=answer.source or answer.place,
            next_step="Identify again with this version.",
        )  # fmt: skip


def difference(before: Answer, after: Answer) -> tuple[Difference, dict[str, str]]:
    """The change of what both have identified, and what is left out of it: name -> why.

    Raises:
        InputError: the answers are of different models, or nothing is there to compare.
    """
    refuse_other_models(before, after)
    left: dict[str, str] = {}
    for answer in (before, after):
        for name, p in answer.document.parameters.items():
            if p.experiment is not None:
                left[name] = f"has values of its own in the experiment {p.experiment} ({answer.place})"
            elif not (np.isfinite(p.std) and p.std > 0):
                left[name] = f"has no standard deviation {answer.place}"
    for one, other in ((before, after), (after, before)):
        for name in one.shared:
            if name not in other.document.parameters:
                left[name] = f"is identified {one.place} only"
    names = [name for name in before.shared if name in after.shared and name not in left]
    if not names:
        raise InputError(
            "The results have no parameter in common.", where="before, after", got="; ".join(
                f"{a.place}: {', '.join(a.document.parameters)}" for a in (before, after)),
            next_step="Identify the same parameters of the same model from both logs.",
        )  # fmt: skip
    value, covariance = zip(*(a.values_of(names) for a in (before, after)), strict=True)
    return Difference(
        tuple(names), tuple(before.shared[name].unit for name in names), value[0], value[1],
        covariance[0] + covariance[1], float(min(a.independent().min() for a in (before, after))),
        before.samples + after.samples,
    ), left  # fmt: skip


def refuse_other_models(before: Answer, after: Answer) -> None:
    """Raise InputError where names do not mean the same."""
    first, second = before.document, after.document
    units = {
        name: (before.shared[name].unit, after.shared[name].unit) for name in before.shared if name in after.shared
    }
    reasons = [f"{name} in {one} and in {other}" for name, (one, other) in units.items() if one != other]
    if first.labels != second.labels:
        reasons.append(f"{', '.join(first.labels)}; {', '.join(second.labels)}")
    of = [{line.partition(" = ")[0]: line for line in d.regrouping} for d in (first, second)]
    reasons += [
        f"{lines[0] or name}; {lines[1] or name}" for name in units
        if (lines := [grouped.get(name, "") for grouped in of])[0] != lines[1]
    ]  # fmt: skip
    if first.geometry != second.geometry:
        reasons.append("other frames or gravity")
    if reasons:
        raise InputError(
            "The results are of different models: the same name does not mean the same.", where="before, after",
            got="; ".join(reasons), next_step="Identify both logs with the same robot description or FMU.",
        )  # fmt: skip


def refuse_same_data(before: Answer, after: Answer) -> None:
    """Raise InputError where both answers come from the same torque: their noise is the same, so that nothing that the
    covariances say of the difference holds."""
    shares = [s for v in before.fitted for w in after.fitted if (s := same_rows(v, w)) is not None]
    same = max(shares, default=0.0) >= SAME_ROWS
    if not shares:
        first, second = (_digests(a.document) for a in (before, after))
        same = bool(first and second) and (first <= second or second <= first) and _overlap(before, after)
    if same:
        raise InputError(
            "Both results come from the same log.", where="before, after",
            got=" and ".join(a.source or a.document.name for a in (before, after)),
            valid="two logs that were recorded apart", next_step="Give the result of another log.",
        )  # fmt: skip


def same_rows(one: Validation, other: Validation) -> float | None:
    """Of the samples at the same instants, those with the same torque; None where there are too few."""
    if one.measured.shape[1] != other.measured.shape[1]:
        return None
    first, second = (np.round(v.time / SAME_INSTANT) for v in (one, other))
    _, i, k = np.intersect1d(first, second, return_indices=True)
    if i.size < min(FEWEST_ROWS, one.time.size, other.time.size):
        return None
    return float(np.mean((one.measured[i] == other.measured[k]).all(axis=1)))


def _digests(document: ResultDocument) -> set[str]:
    """Of the tables that a result was made of."""
    files: Mapping[str, str] = document.provenance.get("files", {})
    return {d for name, d in files.items() if any(name.lower().endswith(suffix) for suffix in READER_OF)}


def _overlap(before: Answer, after: Answer) -> bool:
    """Whether times of fitted experiments overlap."""
    spans = [
        [
            (e.get("first_s", -np.inf), e.get("last_s", np.inf)) for e in experiments_of(a)
            if e.get("role") == "estimation"
        ]
        for a in (before, after)
    ]  # fmt: skip
    return any(a <= d and c <= b for a, b in spans[0] for c, d in spans[1])


def experiments_of(answer: Answer) -> list[dict[str, Any]]:
    return list(answer.document.provenance.get("experiments", {}).values())


def known(before: Answer, after: Answer, left: Mapping[str, str]) -> list[Diagnostic]:
    """What must be known of a comparison."""
    return [*_doubted(before, after), *_held(before, after, left), *_loops(before, after), *_motions(before, after)]


def _doubted(before: Answer, after: Answer) -> Iterator[Diagnostic]:
    for answer in (before, after):
        if answer.document.verdict != "valid":
            codes = list(dict.fromkeys(reason.code for reason in answer.document.reasons))
            yield Diagnostic(
                CHANGE_RESULT_DOUBTED, f"The result is {answer.document.verdict}: {', '.join(codes)}.", answer.place
            )
        if answer.document.prior is not None:
            yield Diagnostic(
                CHANGE_PRIOR, f"The values rest on a prior ({answer.document.prior.source}).", answer.place
            )


def _held(before: Answer, after: Answer, left: Mapping[str, str]) -> Iterator[Diagnostic]:
    for name, why in left.items():
        if "only" in why:
            yield Diagnostic(CHANGE_HELD, f"{name} {why}: the other values make up for what it is held at.", name)
    shapes = [dict(a.document.provenance.get("shape_parameters", {})) for a in (before, after)]
    values = [shapes]
    if before.parameters is not None and after.parameters is not None:
        values.append([_known(a.parameters) for a in (before, after) if a.parameters is not None])
    for one, other in values:
        moved = [
            f"{name} {one.get(name, np.nan):.6g} and {other.get(name, np.nan):.6g}" for name in {**one, **other}
            if not np.isclose(one.get(name, np.nan), other.get(name, np.nan), rtol=SAME_VALUE, atol=0)
        ]  # fmt: skip
        if moved:
            yield Diagnostic(CHANGE_HELD, f"Held at different values before and after: {', '.join(moved)}.")


def _known(parameters: RobotParameters) -> dict[str, float]:
    """Name -> value of the standard parameters that act and are held."""
    base = parameters.base
    free = {*base.index.tolist(), *base.dependent.tolist()}
    return {base.standard_names[i]: float(base.known[i]) for i in parameters.model.active if i not in free}


NAMES_OF_FILES = ("source", "file", "guid", "archive", "origin")
"""Entries of a component that say where it is, not what."""


def _loops(before: Answer, after: Answer) -> Iterator[Diagnostic]:
    first, second = before.document.loop, after.document.loop
    keys = [k for k in {**first, **second} if k != "components" and first.get(k) != second.get(k)]
    parts = [loop.get("components", {}) for loop in (first, second)]
    for name in {**parts[0], **parts[1]}:
        described = name == "plant" and before.document.geometry is not None
        own = [{k: v for k, v in p.get(name, {}).items() if k not in NAMES_OF_FILES} for p in parts]
        if own[0] != own[1] and not described:  # the FMU of a description holds the values that it starts with
            keys.append(str(name))
    for key in ("low_pass_hz", "joint_weights"):
        if before.document.provenance.get(key) != after.document.provenance.get(key):
            keys.append(key)
    if before.document.estimator != after.document.estimator:
        keys.append("estimator")
    if keys:
        yield Diagnostic(CHANGE_LOOP, f"Not the same before and after: {', '.join(keys)}.")


def _motions(before: Answer, after: Answer) -> Iterator[Diagnostic]:
    motions = [
        {e.get("reference_sha256", e.get("inputs_sha256")) for e in experiments_of(a) if e.get("role") == "estimation"}
        for a in (before, after)
    ]
    if motions[0] != motions[1]:
        yield Diagnostic(
            CHANGE_MOTION, "The motions of the two logs differ.",
            condition="the model lacks nothing that acts differently along the two motions",
        )  # fmt: skip


def residual_changes(before: Answer, after: Answer, left: Array | None = None) -> list[ResidualChange]:
    """The residual of each joint before and after, by Fisher's ratio of two variances.

    Args:
        left: (2, n) standard deviations of what an effect leaves, where one explains the change.
    """
    first, second = before.document, after.document
    sizes = (first.noise_std, second.noise_std) if left is None else left.tolist()
    found, n = list[ResidualChange](), len(first.torque_unit)
    freedom = [np.where(np.isfinite(f := a.independent()), f, a.samples / n) for a in (before, after)]
    for j, (one, other) in enumerate(zip(*sizes, strict=True)):
        if one is None or other is None:
            continue
        p_value = chance_of_sizes(one, other, (freedom[0][j], freedom[1][j]))
        found.append(
            ResidualChange(
                label=first.labels[j], unit=first.torque_unit[j], before=one, after=other, p_value=p_value,
                changed=p_value < CHANGED / n,
            )
        )  # fmt: skip
    return found


def residual_diagnostics(found: list[ResidualChange]) -> list[Diagnostic]:
    """What is doubted of residuals that are not as large as before."""
    return [
        Diagnostic(
            CHANGE_RESIDUAL,
            f"The residual went from {r.before:.3g} to {r.after:.3g} {r.unit} (p = {r.p_value:.1e}).", r.label,
            r.after / max(r.before, TINY),
        )
        for r in found if r.changed
    ]  # fmt: skip


def machine(before: Answer, after: Answer) -> Machine | None:
    """The robot, with the motion of the log after; None without a description."""
    parameters = before.parameters
    if parameters is None:
        return None
    value = parameters.base.reduce(parameters.model.parameter_values)
    return Machine(parameters, value, _logged(after))


def _logged(answer: Answer) -> Logged | None:
    """The regressor along the saved motions; None where it does not give the simulated torque."""
    parameters, noise = answer.parameters, answer.document.noise_std
    if parameters is None or not answer.fitted or any(v is None for v in noise):
        return None
    value, tables = parameters.base.reduce(parameters.model.parameter_values), []
    for v in answer.fitted:
        joints = range(1, parameters.joint_count + 1)
        if not {f"{s}{j}" for j in joints for s in ("q", "dq")} <= set(v.motion) or v.time.size < FEWEST_ROWS:
            return None
        q, dq = (np.column_stack([v.motion[f"{s}{j}"] for j in joints]) for s in ("q", "dq"))
        ddq = np.gradient(dq, v.time, axis=0)
        step = np.diff(v.time)
        if np.allclose(step, step[0], rtol=SAME_STEP):  # of fourth order, from positions and velocities
            ddq[1:-1] = 2 * (q[2:] - 2 * q[1:-1] + q[:-2]) / step[0] ** 2 - (dq[2:] - dq[:-2]) / (2 * step[0])
        observed = parameters.observed_along(v.time, q, dq, ddq, value)
        regressor, rest = parameters.regressor(q, dq, ddq, observed=observed)
        tables.append((regressor, rest, v.simulated))
    regressor, rest, simulated = (np.concatenate(parts) for parts in zip(*tables, strict=True))
    off = np.linalg.norm(regressor @ value + rest - simulated, axis=0) / np.maximum(
        np.linalg.norm(simulated, axis=0), TINY)  # fmt: skip
    if (off > FOLLOWS).any():
        return None
    return Logged(regressor, rest, np.array([float(v or 0.0) for v in noise]))
