"""Discovery from end to end: prepare, localise, compete, and write down what was found."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from fmu_didim.base.diagnostics import DOUBT, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.sampling_kind import other_sampling
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.base_model import Prepared, prepare
from fmu_didim.discovery.document import Circumstances, findings_document
from fmu_didim.discovery.external_torques.findings import external_torque_finding, external_torque_windows
from fmu_didim.discovery.external_torques.fit import FittedExternalTorques, find_external_torques
from fmu_didim.discovery.external_torques.rivals import external_effect, rivalled
from fmu_didim.discovery.judge import has_external_torques
from fmu_didim.discovery.localise import Region, regions_of_fit
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection.decide import FAILS_HELD_OUT, HELD_OUT, Options
from fmu_didim.discovery.selection.rounds import Discovery, run_rounds
from fmu_didim.discovery.unfinished import ended_before
from fmu_didim.dynamics.effects import EFFECTS, Effect
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import Ratio, held_out_ratio, joint_gaps
from fmu_didim.fit.solver.accuracy import integrated
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.results.findings import FindingResult, FindingsDocument, WindowResult

FIRST_S = 0.25
"""[s] Left out at the beginning of each experiment: the state in which the machine starts is not known (gears in
their play, friction's deflection, the loop before the first sample). If nothing is found, gears are looked for
with it."""
OF_THE_DATA = 16
"""[rank] Diagnostics of the data before this rank hold whatever the model is; a torque that is limited, pushes, a
clock or a delay, which come after, are what discovery itself names."""

NO_HELD_OUT = (
    "There is no validation experiment: the test on held-out data was left out, and the information criterion alone "
    "decided."
)
NO_MOTION = (
    "The plant has no output {0}: effects in its torque balance were left out, except those whose parameters it has. "
    "Map its velocity (plant: {{outputs: {{dq1: name in the plant}}}}) to have them tried."
)
INTEGRATED = (
    "The plant has no output {0}: the position is the integral of the velocity, from the start of the reference or "
    "from zero. What depends on the position is therefore known up to its zero."
)
UNFILTERED = (
    "The low_pass of the case was not applied: effects show above its cut-off as well, and they are compared with "
    "the noise of the unfiltered log."
)

Keep = Callable[[FindingsDocument], None]
"""Takes the best answer so far."""


@dataclass(frozen=True)
class Found:
    """The answer of :func:`discover`.

    Attributes:
        document: the content of ``findings.json``.
        discovery: base and final fit with the steps between; builder: builds what was found.
    """

    document: FindingsDocument
    discovery: Discovery
    builder: LoopModelBuilder


@dataclass(frozen=True)
class Request:
    """What a search is asked for, beside the model.

    Attributes:
        name: of the case; description: the robot, None for a black-box plant.
        effects: the catalogue by name; options: how to discover.
        progress: takes lines about the search and knows when its time is up; the answer so far is returned then.
        keep: called with the answer so far, when the base model is fitted and after each round.
        case: file of the case, for the commands in the reasons of a verdict.
        provenance: recorded in the document.
        doubts: what is wrong with the data themselves, whatever the model is; notes: all else that is known of them.
    """

    name: str
    description: RobotDescription | None
    effects: Mapping[str, Effect] = field(default_factory=lambda: EFFECTS)
    options: Options = field(default_factory=Options)
    progress: Progress = field(default_factory=Progress)
    keep: Keep | None = None
    case: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    doubts: Sequence[Diagnostic] = ()
    notes: Sequence[str] = ()

    @property
    def external(self) -> Effect | None:
        """The effect that stands for torques from outside, if it is not forbidden."""
        return external_effect(self.effects, self.options.forbid)

    def about_data(self, diagnostics: Sequence[Diagnostic]) -> Request:
        """The same request with what was found in the data before."""
        doubts = [d for d in diagnostics if d.code.severity is DOUBT and d.code.rank < OF_THE_DATA]
        return replace(self, doubts=doubts, notes=[str(d) for d in diagnostics if d not in doubts])


def discover(model: LoopModel, request: Request) -> Found:
    """Find the effects that a model lacks.

    Args:
        model: the loop with its experiments, taken without a low pass; those for the validation are the held-out data.

    Raises:
        InputError: the data are too few; SimulationError: the base model cannot be simulated.
    """
    start = clock.perf_counter()

    def timed(document: FindingsDocument) -> FindingsDocument:
        return document.model_copy(update={"seconds": clock.perf_counter() - start})

    if (keep := request.keep) is not None:
        request = replace(request, keep=lambda document: keep(timed(document)))
    if model.low_pass is not None:
        model, request = replace(model, low_pass=None), replace(request, notes=[*request.notes, UNFILTERED])
    later = replace(model, experiments={label: e.after(FIRST_S) for label, e in model.experiments.items()})
    found = _Search.of(request, _prepared(later, request.progress)).found()
    if found.discovery.final is found.discovery.base:  # nothing was found
        found = _with_beginning(request, model, found)
    return replace(found, document=timed(found.document))


def _prepared(model: LoopModel, progress: Progress) -> Prepared:
    progress.say("base model")
    return prepare(model)


@dataclass(frozen=True)
class _Search:
    """The search for effects from a base model on.

    Attributes:
        prepared: the base model; base: its fit, with the noise of the data without torques from outside.
        torques: from outside, where they explain most of what it leaves; builder: of the models that follow.
        is_late: whether the time was up before they were looked for.
        disagreement: where the base model disagrees.
    """

    request: Request
    prepared: Prepared
    base: Fit
    torques: FittedExternalTorques | None
    builder: LoopModelBuilder
    is_late: bool
    disagreement: list[Region]

    @staticmethod
    def of(request: Request, prepared: Prepared) -> _Search:
        """With the torques from outside looked for."""
        base, progress = prepared.fit, request.progress
        progress.say(f"gap of the base model: {_list(joint_gaps(base.residual, base.noise))} of the noise")
        builder, torques, is_late = (
            LoopModelBuilder(base.model, request.description, request.effects),
            None,
            progress.is_time_up,
        )
        if request.external is not None and not is_late:
            torques = find_external_torques(base, say=progress.say)
        if torques is not None and rivalled(torques, base, builder, forbid=request.options.forbid, progress=progress):
            torques = None
        if torques is not None:
            base = replace(base, noise=torques.fit.noise)
            builder = LoopModelBuilder(torques.fit.model, request.description, request.effects)
        return _Search(request, prepared, base, torques, builder, is_late, regions_of_fit(base, builder.description))

    def found(self) -> Found:
        """What the rounds find, and what is written down of them."""
        base, builder, options = self.base, self.builder, self.request.options
        start, free = base if self.torques is None else self.torques.fit, None
        discovery = run_rounds(builder, start, options, self.request.progress, self.keep)
        if self.torques is not None:
            final, free = self.torques.refitted(discovery.final)
            discovery = replace(discovery, final=final)
        discovery = replace(discovery, base=base, final=_fully_integrated(base, discovery))
        ratio = held_out_ratio(base, discovery.final, seed=options.seed) if discovery.steps else None
        remarked = any(step.remark for step in discovery.steps)  # the held-out data tell nothing of it
        if ratio is not None and ratio.high >= HELD_OUT and self.torques is None and not remarked:
            discovery, ratio = _withdrawn(discovery, ratio), None
        unshifted, saved = _without_shift(discovery.final.model, builder)
        way = other_sampling(discovery.final, unshifted, saved=saved, threshold=options.threshold)
        note = [way.text(1 / base.model.experiments[base.model.first].rate_hz)] if way is not None else []
        return Found(self.written(discovery, ratio, free, *note), discovery, builder)

    def keep(self, discovery: Discovery) -> None:
        """The best answer so far, for those who want it."""
        if self.request.keep is None:
            return
        ratio = held_out_ratio(self.base, discovery.final, seed=self.request.options.seed) if discovery.steps else None
        free = self.torques.free if self.torques is not None else None
        self.request.keep(self.written(replace(discovery, base=self.base), ratio, free))

    def written(self, discovery: Discovery, ratio: Ratio | None, free: Fit | None, *notes: str) -> FindingsDocument:
        """The document of a discovery.

        Args:
            free: the final model with the torques from outside as parameters.
        """
        request, outside, windows = self.request, list[FindingResult](), list[WindowResult]()
        if request.external is not None and self.torques is not None and free is not None:
            outside = [external_torque_finding(self.torques, self.base, free, request.external)]
            windows = external_torque_windows(free, self.torques.label)
        held_out = () if self.base.model.validation_labels else (NO_HELD_OUT,)
        all_notes = [*request.notes, *self.prepared.notes, *_of_motion(self.builder), *held_out, *notes]
        about = Circumstances(
            request.name, request.case, request.progress.limit_s, all_notes, request.doubts,
            {**request.provenance, "options": request.options.record()},
        )  # fmt: skip
        document = findings_document(
            about, discovery, self.builder, ratio=ratio, outside=outside, windows=windows,
            found_regions=self.disagreement,
        )  # fmt: skip
        if self.is_late and request.external is not None:
            return ended_before(document, request.progress.limit_s, "torques from outside")
        return document


def _without_shift(model: LoopModel, builder: LoopModelBuilder) -> tuple[LoopModel, float]:
    """A model without the effects that change the log as a whole, and the parameters that they count as."""
    saved = 0.0
    for index in reversed(range(len(model.added_effects))):
        if builder.effect(model.added_effects[index]).is_of_log:
            saved += builder.at(model.added_effects[index]).cost
            model = builder.without(model, index)
    return model, saved


def _withdrawn(discovery: Discovery, ratio: Ratio) -> Discovery:
    """The base model alone, and what was found as refused: together it is no better on the held-out data."""
    why = f"{FAILS_HELD_OUT} {ratio.value:.3f} of the final model, its interval reaches {ratio.high:.3f}"
    refused = (*((step.effect_at, why) for step in discovery.steps), *discovery.refused)
    return replace(discovery, final=discovery.base, steps=(), refused=refused)


def _with_beginning(request: Request, model: LoopModel, found: Found) -> Found:
    """A second search with the start of the data, if nothing was found without it.

    Only gears can be recognised there: they start in the middle of their play and without load. Anything else that
    differs at the start may be due to the unknown initial state.
    """
    unseen = ended_before(found.document, request.progress.limit_s, f"gears in the first {FIRST_S:g} s of the data")
    if request.progress.is_time_up:
        return replace(found, document=unseen)
    prepared = _prepared(model, request.progress)
    without, whole = found.discovery.base, prepared.fit
    more = joint_gaps(whole.residual, whole.noise) ** 2 - joint_gaps(without.residual, without.noise) ** 2
    if not (more > request.options.smallest_size**2).any():
        return found
    request.progress.say(f"the first {FIRST_S:g} s disagree: gears in them")
    gears = {name for name, effect in request.effects.items() if effect.known_at_start}
    options = replace(request.options, forbid=request.options.forbid | (set(request.effects) - gears))
    note = f"The first {FIRST_S:g} s of the data, where the state of the machine is not known, disagree most"
    again = replace(
        request, options=options, keep=None, notes=(*request.notes, f"{note}: what was found takes them in.")
    )
    second = _Search.of(again, prepared).found()
    if second.discovery.steps:
        asked = found.document.provenance["options"]  # not that everything but gears was forbidden
        recorded = {**second.document.provenance, "options": asked}
        return replace(second, document=second.document.model_copy(update={"provenance": recorded}))
    if second.document.unfinished is not None:
        return replace(found, document=unseen)
    notes = [*found.document.notes, f"{note}; they were left out, and no gear explains them."]
    return replace(found, document=found.document.model_copy(update={"notes": notes}))


def _fully_integrated(base: Fit, discovery: Discovery) -> Fit:
    """The final model, as finely integrated as its effects and the noise ask for; the base where nothing was added."""
    final = discovery.final
    if not discovery.steps and not has_external_torques(final.model):
        return base
    try:
        return integrated(final)
    except SimulationError:
        return final


def _of_motion(builder: LoopModelBuilder) -> tuple[str, ...]:
    """How discovery treats a black box without outputs for its whole motion."""
    if builder.description is not None:
        return ()
    given = {v.name for v in builder.base.plant.outputs}
    joints = range(1, builder.base.joint_count + 1)
    if dumb := [f"dq{j}" for j in joints if f"dq{j}" not in given]:
        return (NO_MOTION.format(", ".join(dumb)),)
    integrated = [f"q{j}" for j in joints if f"q{j}" not in given]
    return (INTEGRATED.format(", ".join(integrated)),) if integrated else ()


def _list(values: Sequence[float] | Array) -> str:
    return ", ".join(f"{v:.2f}" for v in values)
