"""Design of the experiment that splits an ambiguous set: the reference that separates its members best.

Seeded candidates of many kinds (Fourier series, rests, slow ramps, small reversals, the same path at two speeds) are
compared by the smallest separation of any two members (:mod:`fmu_didim.discovery.next_experiment.separation`), and the
best one is improved. Members that no motion can split, such as lag and delay, are reported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from fmu_didim.base.errors import InputError
from fmu_didim.base.imports import without_folder
from fmu_didim.data.excitation import Fourier
from fmu_didim.data.signals import Array, Trajectory, write_csv
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.next_experiment.members import AmbiguousEffect, DesignContext
from fmu_didim.discovery.next_experiment.programs import Candidate
from fmu_didim.discovery.next_experiment.search import MotionEvaluator, Search, improved, same_pairs
from fmu_didim.discovery.next_experiment.separation import Pair, Table
from fmu_didim.discovery.selection.decide import BIC
from fmu_didim.dynamics.effects import EFFECTS, Effect
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.model.loop_model import EffectAtJoint

ROUNDING = 1e-6
"""[standard deviations] Of the noise, below which a separation is none: one of two effects has the other among its
values."""


@dataclass(frozen=True)
class PairSeparation:
    """How well one member can be distinguished from another if it is the truth.

    Attributes:
        now, then: separation d(truth|rival) on the present and on the proposed motion, in units of the noise.
        bic_now, bic_then: BIC difference to expect in favour of the truth.
        same: whether their first-order signatures agree on every motion, so that torque alone cannot split them.
    """

    truth: EffectAtJoint
    rival: EffectAtJoint
    now: float
    then: float
    bic_now: float
    bic_then: float
    same: bool


@dataclass(frozen=True)
class SplittingExperiment:
    """A proposed experiment.

    Attributes:
        description: the proposal in words, with what it can and cannot split.
        reference: the motion, one row a control period, from rest to rest; None if none beats the present one.
        excitation: its document for a case, where it is a Fourier series.
        separation_now, separation_then: smallest d over the pairs that a motion can split; NaN without such a pair.
        bic_now, bic_then: smallest BIC difference to expect over these pairs.
        pairs: all, in both orders.
        advice: from the catalogue, for pairs that this motion does not split.
        is_sufficient: whether every pair is expected to be split, by a BIC difference of at least 10.
    """

    description: str
    reference: Trajectory | None
    excitation: Fourier | None
    separation_now: float
    separation_then: float
    bic_now: float
    bic_then: float
    pairs: tuple[PairSeparation, ...]
    advice: tuple[str, ...]
    is_sufficient: bool

    def save(self, path: Path | str) -> Path:
        """Write the reference: ``.csv`` as a table; ``.yaml`` as the key ``reference`` of a case, beside its CSV.

        Raises:
            InputError: there is no motion to write, or the file name ends otherwise.
        """
        path = Path(path)
        if self.reference is None:
            raise InputError("No motion splits this set.", where=str(path), next_step=" ".join(self.advice))
        if path.suffix not in (".csv", ".yaml"):
            raise InputError(
                "This is no file name for a reference.", where=str(path), valid=".csv, .yaml",
                next_step="End the name with one of these.",
            )  # fmt: skip
        table = path.with_suffix(".csv")
        if path.suffix == ".csv" or self.excitation is None:
            write_csv(self.reference, table)
        if path.suffix == ".yaml":
            source = {"file": table.name} if self.excitation is None else self.excitation.model_dump(mode="json")
            path.write_text(yaml.safe_dump({"reference": source}, sort_keys=False), encoding="utf-8")
        return path


def design_experiment(
    description: RobotDescription,
    chi: Array,
    members: Sequence[Proposal],
    *,
    reference: Trajectory,
    rate_hz: float,
    noise: Noise,
    effects: Mapping[str, Effect] = EFFECTS,
    search: Search | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> SplittingExperiment:
    """Propose the motion that separates the members of an ambiguous set best.

    Args:
        description: the base robot, with the effects found earlier; chi: (ns,) its standard parameters.
        members: the set, with fitted amplitudes and shapes; a member without amplitudes gets those with which it
            looks most like the first that has some. At least one must have them.
        reference: of the present data, one row a control period.
        rate_hz: of the torque log; noise: of the torque log.

    Raises:
        InputError: fewer than two members, or the limits leave no room.
    """
    if len({m.effect_at for m in members}) < 2:
        raise InputError(
            "There is nothing to split.", where="splitting experiment", valid="at least two members",
            next_step="Ask for a next experiment only where several effects explain the residual alike.",
        )  # fmt: skip
    search, model = search or Search(), RobotModel(description)
    context = DesignContext(description, chi, noise, rate_hz, effects, search.follow)
    shown, hidden = _sorted_out(members, context, model)
    if len(shown) < 2:
        return _textual(members, effects, (), hidden)
    evaluator = MotionEvaluator(context, model, shown, reference, search)
    tried = [(one, evaluator.table(one.build(one.design))) for one in evaluator.candidates]
    same = same_pairs([evaluator.now, *(table for _, table in tried)])
    evaluator.open = {pair for pair in evaluator.now if pair not in same}
    if not evaluator.open:
        return _textual(members, effects, _pairs(shown, evaluator.now, evaluator.now, same), hidden)
    tried.sort(key=lambda item: -evaluator.score(item[1]))
    progress(f"best of {len(tried)} motions: {tried[0][0].description}, score {evaluator.score(tried[0][1]):.3g}")
    candidate, design = improved(evaluator, tried[:2], search.evaluations, progress)
    motion = candidate.build(design)
    table = evaluator.table(motion, quickly=False)
    if evaluator.smallest(table) <= evaluator.smallest(evaluator.now):
        return _textual(members, effects, _pairs(shown, evaluator.now, evaluator.now, same), hidden, NO_BETTER)
    return _proposal(evaluator, candidate, motion, table, same, hidden)


def _sorted_out(
    members: Sequence[Proposal], context: DesignContext, model: RobotModel
) -> tuple[list[AmbiguousEffect], list[Effect]]:
    """Members with a signature on a motion, and the effects of the others."""
    shown, hidden = [], []
    for proposal in members:
        try:
            shown.append(AmbiguousEffect(proposal, context, model))
        except InputError:
            hidden.append(context.effects[proposal.effect_at.effect])
    return shown, hidden


def _pairs(members: Sequence[AmbiguousEffect], now: Table, then: Table, same: set[Pair]) -> tuple[PairSeparation, ...]:
    return tuple(
        PairSeparation(
            members[a].effect_at, members[b].effect_at, now[a, b].distance, then[a, b].distance,
            float(now[a, b].margin), float(then[a, b].margin), (a, b) in same,
        )
        for a, b in sorted(now.keys() & then.keys())
    )  # fmt: skip


def _split_line(pair: PairSeparation) -> str:
    """What the motion tells of a pair."""
    begin = f"If {_named(pair.truth)} is the truth and not {_named(pair.rival)}: "
    if pair.then < ROUNDING:
        return (
            f"{begin}the other one is the same with some of its values; only that it has more parameters speaks "
            f"against it, by a BIC difference of {pair.bic_then:.0f}."
        )
    return (
        f"{begin}separation from {pair.now:.2g} to {pair.then:.2g} times the noise, BIC difference to expect from "
        f"{pair.bic_now:.0f} to {pair.bic_then:.0f}."
    )


def _proposal(
    evaluator: MotionEvaluator, candidate: Candidate, motion: Fourier | Trajectory, table: Table, same: set[Pair],
    hidden: Sequence[Effect],
) -> SplittingExperiment:  # fmt: skip
    pairs = _pairs(evaluator.members, evaluator.now, table, same)
    split = [p for p in pairs if not p.same]
    weak = [p for p in pairs if p.same or p.bic_then < BIC]
    advice = _advice([evaluator.context.effects[a.effect] for p in weak for a in (p.truth, p.rival)] + list(hidden))
    lines = [f"Run {candidate.description} for {evaluator.space.duration_s:g} s, from rest to rest."]
    lines += [_split_line(p) for p in split]
    lines += _same_lines(pairs)
    if any(not p.same for p in weak):
        lines.append("That is too little to be sure: move for longer, faster or further, if the robot can.")
    lines += _hidden_lines(hidden)
    lines.append(
        "It is assumed that the robot follows the reference." if evaluator.context.follow is None
        else "The figures hold for the simulated motion of the base model."
    )  # fmt: skip
    return SplittingExperiment(
        description=" ".join([*lines, *advice]),
        reference=evaluator.reference(motion),
        excitation=motion if isinstance(motion, Fourier) else None,
        separation_now=min(p.now for p in split),
        separation_then=min(p.then for p in split),
        bic_now=min(p.bic_now for p in split),
        bic_then=min(p.bic_then for p in split),
        pairs=pairs,
        advice=advice,
        is_sufficient=not weak and not hidden,
    )


NO_BETTER = (
    "No motion that was tried within these limits separates better than the present one: repeat that for longer, or "
    "allow more range, speed, acceleration or time."
)
SAME_TEXT = "the same torque to first order on every motion; torque alone cannot split them."


def _same_lines(pairs: Sequence[PairSeparation]) -> list[str]:
    both = dict.fromkeys(tuple(sorted(map(_named, (p.truth, p.rival)))) for p in pairs if p.same)
    return [f"{first} and {second}: {SAME_TEXT}" for first, second in both]


def _hidden_lines(hidden: Sequence[Effect]) -> list[str]:
    return [f"{e.title} shows in closed-loop simulations only; no figure is given for it." for e in hidden]


def _named(effect_at: EffectAtJoint) -> str:
    return f"{without_folder(effect_at.effect)} on joint {effect_at.joint}"


def _advice(effects: Sequence[Effect]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(f"{e.title}: {e.experiment}" for e in effects))


def _textual(
    members: Sequence[Proposal], effects: Mapping[str, Effect], pairs: tuple[PairSeparation, ...],
    hidden: Sequence[Effect], why: str = "",
) -> SplittingExperiment:  # fmt: skip
    """The advice of the catalogue, without a motion."""
    advice = _advice([effects[m.effect_at.effect] for m in members])
    lines = [*([why] if why else []), *_same_lines(pairs), *_hidden_lines(hidden)]
    nothing = float("nan")
    return SplittingExperiment(
        " ".join([*lines, *advice]), None, None, nothing, nothing, nothing, nothing, pairs, advice, False
    )
