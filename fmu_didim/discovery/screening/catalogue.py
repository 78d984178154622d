"""The signatures of the whole catalogue on one simulated motion: the change of the logged torque, to first order.

That of an effect in the torque balance is its columns at the motion, passed through the response of the closed loop.
That of any other effect is the difference of two simulations of the closed loop, or a derivative.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array, Variable
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import InBlackBox, Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.dynamics.effects import Effect, Search, TorqueEffect
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.fit.derivatives.load_response import LoadResponse, load_response
from fmu_didim.fit.derivatives.repetition import Beginning, change_of_outputs
from fmu_didim.fit.derivatives.sensitivity import by_variation, sensitivity
from fmu_didim.fit.derivatives.torque_signature import TorqueSignature, search_grid
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.solver.accuracy import at_most_resolving
from fmu_didim.model.free_parameter import PLANT, FreeParameter, joint_parameter, plain_name
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.model.motion import Motion, simulated_motion
from fmu_didim.model.workers import side_by_side

GRID_LIMIT = 400
"""[shapes] Tried of one effect at most; a finer grid is thinned."""
REPEATS = 0.05
"""[1] Fraction of the RMS of the change that an effect makes, below which two of its periods are the same: elastic
gears ring for a while."""
TOGETHER = 32
"""[shapes] Whose loads the closed loop answers in one go."""
ABREAST = 16
"""[candidates] Whose signatures are made side by side between two looks at the time."""
SEEN = 0.1
"""[1] Fraction of the largest column of an effect below which another is of second order: a tilt out of the plane."""
LARGEST_COLUMN = 1e12
"""[SI] A larger column comes from states that the offline integration could not follow."""
STIFFEST = 1e-12
"""[SI] Smallest compliance that is turned into a stiffness."""
TORQUE_TRIALS = (0.03, 0.2)
"""[1] Sizes simulated of an effect that is a torque, as fractions of that of the joint."""
TRIALS = (0.35, 0.75)
"""[1] Places simulated of a parameter on a logarithmic range: a smaller and a larger one."""
STIFFNESS_TRIALS = (0.35, 0.5, 0.65, 0.8)
"""[1] More of them for a stiffness, with which the loop resonates."""
LINEAR_TRIAL = 0.75
"""[1] Place simulated on a range that is not logarithmic."""
RESOLVED = 4
"""[1] Times the fewest substeps that resolve the resonance of a gear, with which errors of it are tried at most: steps
of a quarter of a radian, with which a gear resonates as one that is 1 % softer. A gear that rings without end would ask
for hundreds. A fit has all that it asks for."""
SMALLEST_DIFFERENCE = 1e-9
"""[SI] A trial this near to the neutral value is left out."""
SAME_SHAPE = 12
"""[decimal places] In which shapes that are the same agree."""


@dataclass(frozen=True)
class Signature:
    """The change of all outputs at the samples by an effect, the torque first.

    Attributes:
        effect_at: effect and joint; shapes: values of all parameters but the amplitudes.
        columns: (M, m, w), for one unit of each of the amplitudes named in ``amplitudes``.
        neutral: value of each amplitude without the effect.
        inverse: whether the columns are for one unit of the inverse of the amplitude, a compliance for a stiffness.
    """

    effect_at: EffectAtJoint
    shapes: Mapping[str, float]
    amplitudes: tuple[str, ...]
    columns: Array
    neutral: Mapping[str, float]
    inverse: bool = False

    def proposal(self, coefficients: Array) -> Proposal:
        """Start values of a fit, from the coefficients of the columns."""
        own = dict(zip(self.amplitudes, map(float, coefficients), strict=True))
        if self.inverse:
            stiffness = {n: 1 / max(abs(c), STIFFEST) for n, c in own.items()}
            return Proposal(self.effect_at, {**self.shapes, **stiffness})
        found = {n: self.neutral.get(n, 0.0) + c for n, c in own.items()}
        return Proposal(self.effect_at, {**self.shapes, **found}, {n: abs(c) for n, c in own.items()})


class SignatureCatalogue:
    """Signatures at the motion of a fit; made once, because the motion hardly changes when effects are added.

    Attributes:
        builder: of the loops; fit: of the model; left: candidates without a signature because the time was up.
    """

    def __init__(
        self, builder: LoopModelBuilder, fit: Fit, *, candidates: Sequence[EffectAtJoint],
        progress: Progress | None = None,
    ) -> None:  # fmt: skip
        self.builder, self.fit = builder, fit
        self._signatures: list[Signature] = []
        self._motions = [_ExperimentMotion.of(builder, fit, label) for label in fit.model.estimation_labels]
        rows = fit.model.experiments.output_rows
        self._beginnings = {
            label: Beginning.of(fit.simulation(label), fit.outputs[part]) for label, part in rows.items()
        }  # fmt: skip
        smooth = [c for c in candidates if builder.effect(c).is_smooth and builder.at(c).can_be_added]
        derived = self._by_derivatives(smooth) if smooth else {}
        progress, left = progress or Progress(), list[EffectAtJoint]()
        simulated = [c for c in candidates if c not in derived and not isinstance(builder.effect(c), TorqueEffect)]
        builder.prepare(
            [(*fit.model.added_effects, c) for c in simulated if builder.at(c).can_be_added],
            progress=progress, workers=fit.model.workers,
        )  # fmt: skip
        report, workers = progress.counted("signatures of candidate", len(candidates)), fit.model.workers
        for first in range(0, len(candidates), ABREAST):
            together = candidates[first : first + ABREAST]
            if progress.is_time_up:
                left += together
                continue
            in_balance = [
                c for c in together if not (c in derived or c in simulated or isinstance(builder.at(c), InBlackBox))
            ]
            # Neither made nor dropped in threads: constants of CasADi expressions are shared, without a lock. States
            # of an effect along a motion are such an expression for each of its shapes.
            equations = {c: self._equations(c) for c in in_balance}
            threaded = [c for c, own in equations.items() if own is None or not own.has_states]
            made = side_by_side([partial(self._by_regressor, c, equations[c]) for c in threaded], workers)
            found = derived | dict(zip(threaded, made, strict=True))
            found |= {c: self._by_regressor(c, own) for c, own in equations.items() if c not in found}
            for effect_at in together:
                self._signatures += found[effect_at] if effect_at in found else self._make(effect_at)
                report("")
        self.left = tuple(left)

    def __iter__(self) -> Iterator[Signature]:
        return iter(self._signatures)

    def extended(self, fit: Fit, candidates: Sequence[EffectAtJoint], progress: Progress) -> SignatureCatalogue:
        """With the signatures of some candidates at another fit, in place of those that they had; the other ones stay
        as they are, for the motion hardly changes when effects are added."""
        found = SignatureCatalogue(self.builder, fit, candidates=candidates, progress=progress)
        found._signatures += [s for s in self._signatures if s.effect_at not in candidates]
        found.fit, found.left = self.fit, (*self.left, *found.left)
        return found

    def _make(self, effect_at: EffectAtJoint) -> list[Signature]:
        effect, placed = self.builder.effect(effect_at), self.builder.at(effect_at)
        if not placed.can_be_added:
            return []
        if isinstance(placed, InBlackBox):
            return [self._of_the_plant(effect_at)]
        if not isinstance(effect, TorqueEffect):
            return list(self._by_simulation(effect_at, effect))
        return self._by_regressor(effect_at, self._equations(effect_at))

    def _equations(self, effect_at: EffectAtJoint) -> TorqueSignature | None:
        """The equations of an effect in the torque balance; None where it has no signature."""
        effect, joint = self.builder.effect(effect_at), effect_at.joint - 1
        assert isinstance(effect, TorqueEffect)
        kinds = [self.builder.loop.joint_type(j) for j in range(1, self.fit.model.joint_count + 1)]
        absent = self._motions[0].motion is None or joint + effect.reach >= len(kinds)
        if absent or not self.builder.at(effect_at).can_be_added:
            return None
        return TorqueSignature(effect, joint, tuple(kinds), tuple(self._defaults(effect_at, effect)))

    def _by_regressor(self, effect_at: EffectAtJoint, made: TorqueSignature | None) -> list[Signature]:
        return [] if made is None else list(self._along_motions(effect_at, made))

    def _along_motions(self, effect_at: EffectAtJoint, made: TorqueSignature) -> Iterator[Signature]:
        effect = made.effect
        kind, defaults = self.builder.loop.joint_type(effect_at.joint), self._defaults(effect_at, effect)
        names = tuple(v.name for v in effect.parameters(kind))
        tried = [s for s in search_grid(self.builder.at(effect_at).search, defaults) if effect.allows(s)]
        if len(tried) > GRID_LIMIT:
            tried = [tried[i] for i in np.linspace(0, len(tried) - 1, GRID_LIMIT).astype(int)]
        for first in range(0, len(tried), TOGETHER):
            kept, loads = [], []
            for shapes in tried[first : first + TOGETHER]:
                columns = [motion.columns(made, shapes) for motion in self._motions]
                if 0 < max(float(np.abs(c).max()) for c in columns) < LARGEST_COLUMN:
                    kept.append(shapes)
                    loads.append(columns)
            if kept:
                answers = [
                    np.split(motion.response.at_samples(np.concatenate(own, axis=2)), len(kept), axis=2)
                    for motion, own in zip(self._motions, zip(*loads, strict=True), strict=True)
                ]
                for shapes, answer in zip(kept, zip(*answers, strict=True), strict=True):
                    yield Signature(effect_at, shapes, names, np.concatenate(answer), {})

    def _of_the_plant(self, effect_at: EffectAtJoint) -> Signature:
        """Derivatives by the parameters of an effect that a black box has, at its values."""
        joint, fit = effect_at.joint, self.fit
        present = {v.name: v.start for v in fit.model.loop.plant.parameters}
        amplitudes = [v.name for v in self.builder.at(effect_at).amplitudes]
        own = {name: present[joint_parameter(name, joint, is_shape=False)] for name in amplitudes}
        size = TORQUE_TRIALS[0] * float(np.sqrt(np.mean(fit.torque[:, joint - 1] ** 2)))
        model = self.builder.build(fit.model, [Proposal(effect_at, own, dict.fromkeys(amplitudes, size))])
        first = len(fit.model.free_parameters)
        places = [i for i in range(first, len(model.free_parameters)) if not model.free_parameters[i].is_shape]
        columns = sensitivity(model, model.start, fit.outputs, only=places)
        return Signature(effect_at, {}, tuple(amplitudes), columns, own)

    def _defaults(self, effect_at: EffectAtJoint, effect: Effect) -> dict[str, float]:
        """Shapes of an effect: those that the joint already has (such as v0) at their present values."""
        kind = self.builder.at(effect_at).joint_type
        present = {parameter.name: parameter.value for parameter in self.fit.model.free_parameters}
        robot = self.builder.description
        own = robot.joints[effect_at.joint - 1].parameters if robot is not None else {}
        return {
            v.name: present.get(f"{v.name}_{effect_at.joint}", own.get(v.name, v.start)) for v in effect.shapes(kind)
        }

    def _by_simulation(self, effect_at: EffectAtJoint, effect: Effect) -> Iterator[Signature]:
        """Differences of two closed-loop simulations for a few values of each parameter, at a few shapes."""
        candidate = self.builder.at(effect_at)
        amplitudes, shapes, searched = candidate.amplitudes, candidate.shapes, candidate.search
        size = float(np.sqrt(np.mean(self.fit.torque[:, effect_at.joint - 1] ** 2)))
        off = {v.name: effect.neutral.get(v.name, 0.0) for v in amplitudes}
        neutral = {n: v for n, v in effect.neutral.items() if np.isfinite(v)}
        trials = {v.name: _trials(v, searched[v.name], size, off[v.name]) for v in amplitudes}
        single = len(amplitudes) == 1
        trials = {n: _mirrored(values, effect, n) if single else values[:1] for n, values in trials.items()}
        tried = [
            (at, name, value)
            for at in _one_at_a_time({v.name: searched[v.name] for v in shapes})
            for name, values in trials.items()
            for value in values
        ]
        proposals = [Proposal(effect_at, {**neutral, **at, name: value}) for at, name, value in tried]
        models = [self.builder.build(self.fit.model, [proposal]) for proposal in proposals]
        tasks = [partial(self._difference, model) for model in models]
        differences = side_by_side(tasks, self.fit.model.allowed_workers(self.fit.values))
        columns = [
            # A stiffness is nothing when it is infinite: its inverse is the amplitude.
            difference / (value - off[name] if np.isfinite(off[name]) else 1 / value)
            for difference, (_, name, value) in zip(differences, tried, strict=True)
        ]
        if single:
            inverse = not np.isfinite(off[amplitudes[0].name])
            for column, (at, name, _) in zip(columns, tried, strict=True):
                if np.abs(column).max() > 0:
                    yield Signature(effect_at, at, (name,), column[:, :, None], neutral, inverse)
            return
        for first in range(0, len(columns), len(amplitudes)):
            together = columns[first : first + len(amplitudes)]
            sizes = np.array([np.linalg.norm(column) for column in together])
            visible = np.flatnonzero(sizes > SEEN * sizes.max())
            if visible.size:
                names = tuple(amplitudes[i].name for i in visible)
                table = np.stack([together[i] for i in visible], axis=2)
                yield Signature(effect_at, tried[first][0], names, table, neutral)

    def _by_derivatives(self, smooth: Sequence[EffectAtJoint]) -> dict[EffectAtJoint, list[Signature]]:
        """Derivatives by the parameters of effects that are smooth where they are neutral, at a few shapes.

        Those of all joints come from one run of the loop; nothing where its equations are not known.
        """
        found: dict[EffectAtJoint, list[Signature]] = {effect_at: [] for effect_at in smooth}
        placed = {effect_at: self.builder.at(effect_at) for effect_at in smooth}
        shapes = {a: _one_at_a_time({v.name: p.search[v.name] for v in p.shapes}) for a, p in placed.items()}
        for place in range(max(len(tried) for tried in shapes.values())):
            shapes_at = {effect_at: tried[place] for effect_at, tried in shapes.items() if place < len(tried)}
            columns = self._derivatives(shapes_at)
            if columns is None:
                return {}
            for effect_at, (names, table) in columns.items():
                neutral = self.builder.effect(effect_at).neutral
                found[effect_at].append(Signature(effect_at, shapes_at[effect_at], names, table, neutral))
        return found

    def of_shapes(self, effect_at: EffectAtJoint, shapes: Sequence[Mapping[str, float]]) -> list[Signature]:
        """Signatures of an effect that is smooth where it is neutral, at these shapes; none where the equations of the
        loop are not known."""
        neutral, found = self.builder.effect(effect_at).neutral, list[Signature]()
        for at in shapes:
            columns = self._derivatives({effect_at: at})
            if columns is None:
                return []
            found.append(Signature(effect_at, at, *columns[effect_at], neutral))
        return found

    def _derivatives(
        self, shapes_at: Mapping[EffectAtJoint, Mapping[str, float]]
    ) -> dict[EffectAtJoint, tuple[tuple[str, ...], Array]] | None:
        """Names of the parameters of each effect and the derivatives (M, m, w) by them, at these shapes."""
        proposals = [Proposal(a, {**self.builder.effect(a).neutral, **shapes}) for a, shapes in shapes_at.items()]
        model = self.builder.build(self.fit.model, proposals)
        first = len(self.fit.model.free_parameters)
        own: dict[EffectAtJoint, list[int]] = {effect_at: [] for effect_at in shapes_at}
        for i, parameter in enumerate(model.free_parameters[first:], start=first):
            if parameter.effect is not None and not parameter.is_shape:
                own[model.added_effects[parameter.effect]].append(i)
        wanted = [i for places in own.values() for i in places]
        if all(self.builder.effect(effect_at).needs_elastic for effect_at in shapes_at):
            model = at_most_resolving(model, model.start, RESOLVED)
        pinned, parts = model.integrated_as(model.start), []
        for label in model.estimation_labels:
            varied = by_variation(pinned.simulation(model.start, label), wanted, self._beginnings[label], lasting=True)
            if len(varied) < len(wanted):
                return None
            parts.append(np.stack([varied[i] for i in wanted], axis=2))
        table = np.concatenate(parts)
        return {
            effect_at: (
                tuple(_plain(model.free_parameters[i], effect_at) for i in places),
                table[:, :, [wanted.index(i) for i in places]],
            )
            for effect_at, places in own.items()
        }

    def _difference(self, model: LoopModel) -> Array:
        """(M, m) change of the outputs in another model; zero where it cannot be simulated."""
        outputs = self.fit.outputs
        try:
            parts = [
                change_of_outputs(
                    model.simulation(model.start, label), outputs[part], self._beginnings[label], tolerance=REPEATS
                )
                for label, part in self.fit.model.experiments.output_rows.items()
            ]
        except SimulationError:
            return np.zeros_like(outputs)
        return np.concatenate(parts)


@dataclass(frozen=True)
class _ExperimentMotion:
    """An experiment with its simulated motion and the answer of the loop to loads.

    Attributes:
        motion: at all ticks, None if the plant does not give it; thinned: at those of the response.
    """

    response: LoadResponse
    motion: Motion | None
    thinned: Motion | None

    @staticmethod
    def of(builder: LoopModelBuilder, fit: Fit, label: str) -> _ExperimentMotion:
        robot = None if builder.description is None else RobotModel(builder.description)
        response, motion = load_response(fit.simulation(label)), simulated_motion(fit.simulation(label), robot)
        return _ExperimentMotion(response, motion, None if motion is None else motion.at(response.ticks))

    def columns(self, made: TorqueSignature, shapes: Mapping[str, float]) -> Array:
        """(K, n, m) of an effect at the ticks of the response."""
        assert self.motion is not None
        assert self.thinned is not None
        states = made.states(self.motion, shapes)[self.response.ticks] if made.has_states else None
        return made.columns(self.thinned, shapes, states)


def _plain(parameter: FreeParameter, effect_at: EffectAtJoint) -> str:
    """The name of a parameter of an effect in the catalogue."""
    return plain_name(parameter.key, effect_at.joint) if parameter.owner == PLANT else parameter.key


def _one_at_a_time(search: Mapping[str, Search]) -> list[dict[str, float]]:
    """Shapes on their grids, one after the other, with the others in the middle of theirs."""
    middle = {
        name: float(np.sqrt(s.lowest * s.highest) if s.logarithmic else np.mean((s.lowest, s.highest)))
        for name, s in search.items()
    }
    found = [middle]
    for name, s in search.items():
        found += [{**middle, **at} for at in search_grid({name: s}, {})]
    distinct = {tuple(round(v, SAME_SHAPE) for v in at.values()): at for at in found}
    return list(distinct.values())


def _trials(variable: Variable, search: Search, size: float, neutral: float) -> list[float]:
    """Values of a parameter to try: a smaller and a larger one; more of a stiffness."""
    if variable.unit in ("N.m", "N"):
        values = [part * size for part in TORQUE_TRIALS]
    elif search.logarithmic:
        parts = TRIALS if np.isfinite(neutral) else STIFFNESS_TRIALS
        values = [search.lowest * (search.highest / search.lowest) ** part for part in parts]
    else:
        values = [search.lowest + LINEAR_TRIAL * (search.highest - search.lowest)]
    different = [float(v) for v in values if not np.isfinite(neutral) or abs(v - neutral) > SMALLEST_DIFFERENCE]
    return different or [search.highest]


def _mirrored(values: list[float], effect: Effect, name: str) -> list[float]:
    """The values and, of a parameter with two sides, those mirrored at the neutral one."""
    off = effect.neutral.get(name, 0.0)
    low, high = effect.limits.get(name, (off, off))
    return [*values, *(2 * off - v for v in values)] if name in effect.signed and low < off < high else values
