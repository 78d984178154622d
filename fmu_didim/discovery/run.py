"""Discovery from end to end: prepare, localise, compete, document."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.channels import CHANNELS_DISAGREE
from fmu_didim.checks.sampling_kind import other_sampling
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.gains import gain_notes
from fmu_didim.discovery.base_model import Prepared, prepare
from fmu_didim.discovery.beginning import (
    FIRST_S,
    AfterStart,
    after_start,
    always_at_start,
    at_start,
    is_settled_by_start,
    is_told_later,
    unconfirmed_gears,
    untold_gears,
)
from fmu_didim.discovery.document import findings_document
from fmu_didim.discovery.external_torques.findings import external_torque_finding, external_torque_windows
from fmu_didim.discovery.external_torques.fit import FittedExternalTorques, find_external_torques
from fmu_didim.discovery.external_torques.rivals import rivalled
from fmu_didim.discovery.form.curve import FoundCurve
from fmu_didim.discovery.form.names import Forms, instead_of_torques, with_curves
from fmu_didim.discovery.harmonics import motor_notes, not_of_motors
from fmu_didim.discovery.judge import explains_little, has_external_torques
from fmu_didim.discovery.ladder.ladders import contradictions, ladders_of, of_event, of_other_size
from fmu_didim.discovery.localise import regions_of_fit
from fmu_didim.discovery.request import Request
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Step
from fmu_didim.discovery.selection.held_out import unconfirmed
from fmu_didim.discovery.selection.plausible import unusual_values
from fmu_didim.discovery.selection.refitted import Refitted, refitted_notes, refitted_shapes, with_stated
from fmu_didim.discovery.selection.rivals import ambiguities, of_one_period
from fmu_didim.discovery.selection.rounds import Discovery, Ending, not_widely_searched, run_rounds
from fmu_didim.discovery.unfinished import ended_before
from fmu_didim.discovery.untried import motion_notes, untried_effects
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import Ratio, held_out_ratio, joint_gaps
from fmu_didim.fit.solver.accuracy import integrated
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.results.findings import FindingResult, FindingsDocument, RegionResult, WindowResult

TORN = 1.25
"""[1] RMS of the torque residual of a joint with all outputs over that of the base model by the torque alone, from
which torque and the other signals do not agree: as for held-out data."""
DISAGREE = f"The first {FIRST_S:g} s of the data, where the state of the machine is not known, disagree most"
WITH_START = f"The first {FIRST_S:g} s of the data, where gears show most, tell what the data after them do not"
GEARS_FROM_START = f"gears with the first {FIRST_S:g} s"
NO_HELD_OUT = (
    "There is no validation experiment: the test on held-out data was left out, and the information criterion alone "
    "decided."
)
LOOKED_AT = (
    "Beside the torque, {0} count in the base model, the screening, all fits and the test on held-out data; torques "
    "from outside, the regions of disagreement and the way of sampling are looked for in the torque alone."
)
LEFT_OUT = "{0} were left out: torques from outside were found, which are fitted to the torque alone."
SUPERFLUOUS = (
    "Torques from outside on joint {0} were found first, and taken out again: the effects that were found beside them "
    "explain the data as well without."
)
NOT_HELD_OUT = "No held-out experiment measures {0}: there the test rests on the other signals."
UNFILTERED = (
    "The low_pass of the case was not applied: effects show above its cut-off as well, and they are compared with "
    "the noise of the unfiltered log."
)
BAND_LIMITED = (
    "Torques were compared up to {0:.3g} Hz, above which the noise of the positions shows that the virtual controller "
    "follows, and brought to as few samples as that needs."
)
WITHOUT_PRIOR = (
    "The prior of the case was not applied: what pulls the values from where the data have them would look like an "
    "effect that the model lacks, and the other way round."
)


@dataclass(frozen=True)
class Found:
    """The answer of :func:`discover`.

    Attributes:
        document: the content of ``findings.json``.
        discovery: base and final fit with the steps between; builder: of the final model.
        curves: of what is missing and has no name.
    """

    document: FindingsDocument
    discovery: Discovery
    builder: LoopModelBuilder
    curves: tuple[FoundCurve, ...] = ()


def discover(model: LoopModel, request: Request) -> Found:
    """Find the effects that a model lacks.

    Args:
        model: the loop with its experiments, taken without a low pass and without a prior; those for the
            validation are the held-out data.

    Raises:
        InputError: the data are too few; SimulationError: the base model cannot be simulated.
    """
    start = clock.perf_counter()

    def timed(document: FindingsDocument) -> FindingsDocument:
        return document.model_copy(update={"seconds": clock.perf_counter() - start})

    if (keep := request.keep) is not None:
        request = replace(request, keep=lambda document: keep(timed(document)))
    if (low_pass := model.experiments.low_pass) is not None:
        model, told = model.with_low_pass(None), UNFILTERED
        if model.loop.is_virtual:
            told = BAND_LIMITED.format(low_pass.cutoff_hz)
            for label, experiment in model.experiments.items():
                model = model.with_experiment(label, experiment.band_limited(low_pass.cutoff_hz))
        request = replace(request, notes=[*request.notes, told])
    if model.prior is not None:
        model, request = replace(model, prior=None), replace(request, notes=[*request.notes, WITHOUT_PRIOR])
    request = replace(request, whole=dict(model.experiments))
    request.progress.say("base model")
    found = _Search.of(request, prepare(after_start(model))).found()
    if found.discovery.final is found.discovery.base:  # nothing was found
        found = _with_beginning(request, model, found)
    elif untold := untold_gears(found.discovery.steps, request.effects):
        found = _gears_by_beginning(request, model, found, untold)
    return replace(found, document=timed(found.document))


@dataclass(frozen=True)
class _Search:
    """The search for effects from a base model on.

    Attributes:
        prepared: the base model; base: its fit, with the noise of the data without torques from outside.
        torques: from outside, where they explain most of its residual; builder: of the models that follow.
        asked: the request as it was, without what was found of it.
        is_late: whether the time was up before the search for them; disagreement: where the base model disagrees.
        later: what the data after their start say, where these count as well.
    """

    asked: Request
    request: Request
    prepared: Prepared
    base: Fit
    torques: FittedExternalTorques | None
    builder: LoopModelBuilder
    is_late: bool
    disagreement: list[RegionResult]
    later: AfterStart | None = None

    @staticmethod
    def of(request: Request, prepared: Prepared, later: AfterStart | None = None, *, outside: bool = True) -> _Search:
        """Fit the torques from outside, if there are any and they are looked for: ``outside``."""
        asked, request = request, replace(request, doubts=(*request.doubts, *prepared.doubts))
        base, progress = prepared.fit, request.progress
        alone = base.torque_alone
        gaps = ", ".join(f"{gap:.2f}" for gap in joint_gaps(alone.residual, alone.noise))
        progress.say(f"gap of the base model: {gaps} of the noise")
        build = partial(
            LoopModelBuilder, description=request.description, effects=request.effects, start=prepared.start
        )
        builder = build(alone.model)
        torques, is_late = None, progress.is_time_up
        if outside and request.external is not None and not is_late:
            torques = find_external_torques(alone, say=progress.say)
        forbid, seed = request.options.forbid, request.options.seed
        if torques is not None and rivalled(torques, alone, builder, forbid=forbid, progress=progress, seed=seed):
            torques = None
        if torques is not None:
            of_noise = replace(alone, noise=torques.fit.noise)
            only_imitate, doubt = instead_of_torques(
                builder, of_noise, torques.joint, torques.delta_bic, seed=request.options.seed
            )
            torques = None if only_imitate else torques
            request = request if doubt is None else replace(request, doubts=(*request.doubts, doubt))
        if torques is not None:
            base = replace(alone, noise=torques.fit.noise)
            builder = build(torques.fit.model)
        elif base is not alone:
            builder = build(base.model)
        regions = regions_of_fit(base.torque_alone, builder.description)
        return _Search(asked, request, prepared, base, torques, builder, is_late, regions, later)

    def found(self, begun: tuple[Fit, list[Step]] | None = None) -> Found:
        """Run the rounds, from effects that were begun with or none, and document their result."""
        base, builder, options = self.base, self.builder, self.request.options
        start, free = base if self.torques is None else self.torques.fit, None
        discovery = run_rounds(builder, start, options, self.request.progress, self.keep, begun=begun)
        if (again := self.without_torques(discovery)) is not None:
            return again
        if self.torques is not None:
            final, free = self.torques.refitted(discovery.final)
            discovery = replace(discovery, final=final)
        discovery = replace(discovery, base=base, final=_fully_integrated(base, discovery))
        ratio = held_out_ratio(base, discovery.final, seed=options.seed) if discovery.steps else None
        if why := self.objection(discovery):
            discovery, ratio = _withdrawn(discovery, why), None
        forms = Forms(discovery)
        if self.torques is None and discovery.ending is Ending.COMPLETE:
            named, forms = discovery.steps, with_curves(discovery, builder, options, self.request.progress)
            discovery = forms.discovery
            if discovery.steps != named:
                ratio = held_out_ratio(base, discovery.final, seed=options.seed) if discovery.steps else None
        if discovery.steps or self.torques is not None or self.request.progress.is_time_up:
            notes = refitted_notes(discovery.final, builder)
        elif refitted := refitted_shapes(discovery.final, builder, options):
            discovery, ratio, notes = self.with_stated(discovery, refitted)
        else:
            notes = []
        of_torque = discovery.final.torque_alone
        unshifted, saved = _without_shift(of_torque.model, builder)
        is_virtual = base.model.loop.is_virtual  # there another way of sampling and a torque held longer look alike
        way = None if is_virtual else other_sampling(of_torque, unshifted, saved=saved, threshold=options.threshold)
        note = [way.text(1 / base.model.experiments[base.model.first].rate_hz)] if way is not None else []
        unsearched = not_widely_searched(builder, discovery, options)
        notes = [*note, *notes, *forms.notes, *gain_notes(discovery.final, builder), *unsearched]
        document = self.written(discovery, ratio, free, *notes, curves=forms.curves, doubts=forms.doubts)
        return Found(document, discovery, builder, forms.curves)

    def objection(self, discovery: Discovery) -> str:
        """Why all that was named together is no answer, or an empty string."""
        if not discovery.steps or self.torques is not None:
            return ""
        base, final, options = discovery.base, discovery.final, self.request.options
        lenience = options.lenience(hits=any(self.builder.effect(s.effect_at).has_minima for s in discovery.steps))
        untested = any(step.untested for step in discovery.steps)
        why = "" if untested else unconfirmed(base, final, seed=options.seed, lenience=lenience)
        if why or discovery.ending is not Ending.COMPLETE:
            return why
        return explains_little(discovery, lambda effect_at: self.builder.effect(effect_at).class_name)

    def without_torques(self, discovery: Discovery) -> Found | None:
        """What is found without the torques from outside, where the effects that were found beside them have made them
        superfluous: from these effects on, or from none where more than the torque counts. None where they are not."""
        if self.torques is None or not discovery.steps or discovery.ending is not Ending.COMPLETE:
            return None
        without = self.torques.superfluous_beside(discovery.final)
        if without is None:
            return None
        self.request.progress.say("taken out again: torques from outside")
        asked = self.asked.noting(SUPERFLUOUS.format(self.torques.joint))
        search = _Search.of(asked, self.prepared, self.later, outside=False)
        if search.base.model.experiments.channels:
            return search.found()
        begun = replace(without, noise=search.base.noise)
        return search.found((begun, [replace(step, without=None) for step in discovery.steps]))

    def with_stated(
        self, discovery: Discovery, refitted: tuple[Refitted, ...]
    ) -> tuple[Discovery, Ratio | None, list[str]]:
        """The discovery from the shapes that the description states to those that were fitted, where they also explain
        what was held out better; and notes on the others."""
        texts = [one.text for one in refitted]
        stated = with_stated(discovery.final, refitted)
        if stated is None or unconfirmed(stated, discovery.final, seed=self.request.options.seed):
            return discovery, None, texts
        ratio = held_out_ratio(stated, discovery.final, seed=self.request.options.seed)
        return replace(discovery, base=stated, refitted=refitted), ratio, []

    def keep(self, discovery: Discovery) -> None:
        """Hand on the best answer so far."""
        if self.request.keep is None:
            return
        ratio = held_out_ratio(self.base, discovery.final, seed=self.request.options.seed) if discovery.steps else None
        free = self.torques.free if self.torques is not None else None
        self.request.keep(self.written(replace(discovery, base=self.base), ratio, free))

    def torn(self, final: Fit) -> list[Diagnostic]:
        """Joints whose torque a model explains worse than the base model does by the torque alone: the other signals
        ask for something else."""
        alone = self.prepared.of_torque
        if alone is None or not final.model.experiments.channels:
            return []
        torque = final.torque_alone
        before, after = (joint_gaps(fit.residual, torque.noise) for fit in (alone, torque))
        names = ", ".join(final.model.experiments.channels)
        return [
            Diagnostic(
                CHANNELS_DISAGREE, f"With {names} the torque error is {after[j]:.2g} times the noise, against "
                f"{before[j]:.2g} by the torque alone.", f"joint {j + 1}", float(after[j]), float(before[j]), "1",
            )
            for j in range(before.size) if np.hypot(after[j], 1) > TORN * np.hypot(before[j], 1)
        ]  # fmt: skip

    def written(
        self,
        discovery: Discovery,
        ratio: Ratio | None,
        free: Fit | None,
        *notes: str,
        curves: Sequence[FoundCurve] = (),
        doubts: Sequence[Diagnostic] = (),
    ) -> FindingsDocument:
        """The document of a discovery.

        Args:
            free: the final model with the torques from outside as parameters; curves: of what has no name; doubts: that
                they raise.
        """
        request, outside, windows = self.request, list[FindingResult](), list[WindowResult]()
        if request.external is not None and self.torques is not None and free is not None:
            found = external_torque_finding(self.torques, self.base, free, request.external)
            outside = [found.model_copy(update={"ladder": of_event(found)})]
            windows = external_torque_windows(free, self.torques.label)
        held_out = () if self.base.model.experiments.validation_labels else (NO_HELD_OUT,)
        looked_at = _looked_at(self.prepared.fit.model, self.base.model)
        of_search = (*looked_at, *motion_notes(self.builder), *motor_notes(self.builder), *held_out)
        all_notes = [*request.notes, *self.prepared.notes, *of_search, *notes]
        ladders = ladders_of(discovery, self.builder, request)
        doubts = [
            *doubts, *self.torn(discovery.final), *untried_effects(self.builder, discovery.final),
            *contradictions(discovery, ladders), *of_other_size(discovery, ladders),
            *unusual_values(discovery.final, self.builder), *ambiguities(self.builder, discovery.steps),
            *of_one_period(self.builder, discovery.final), *not_of_motors(self.builder, discovery.final),
            *([] if self.later is None else self.later.diagnostics(discovery, self.builder)),
        ]  # fmt: skip
        document = findings_document(
            replace(request, doubts=(*request.doubts, *doubts)), discovery, self.builder, ratio=ratio,
            notes=all_notes, outside=outside, windows=windows,
            regions=self.disagreement, ladders=ladders, curves=curves,
        )  # fmt: skip
        if self.is_late and request.external is not None:
            return ended_before(document, request.progress.limit_s, "torques from outside")
        return document


def _looked_at(prepared: LoopModel, searched: LoopModel) -> tuple[str, ...]:
    """Notes on what else was measured than the torque."""
    names = prepared.experiments.channels
    if not names:
        return ()
    if not searched.experiments.channels:
        return (LEFT_OUT.format(", ".join(names)),)
    held = {c.name for label in searched.experiments.validation_labels for c in searched.experiments[label].channels}
    absent = [name for name in names if name not in held] if searched.experiments.validation_labels else []
    told = (LOOKED_AT.format(", ".join(names)),)
    return (*told, NOT_HELD_OUT.format(", ".join(absent))) if absent else told


def _without_shift(model: LoopModel, builder: LoopModelBuilder) -> tuple[LoopModel, float]:
    """The model without effects that change the log as a whole, and the number of parameters that this saves."""
    saved = 0.0
    for index in reversed(range(len(model.added_effects))):
        if builder.effect(model.added_effects[index]).is_of_log:
            saved += builder.at(model.added_effects[index]).cost
            model = builder.without(model, index)
    return model, saved


def _withdrawn(discovery: Discovery, why: str) -> Discovery:
    """The base model alone, with all effects refused: together they do not help on the held-out data."""
    refused = (*((step.effect_at, f"final model: {why}") for step in discovery.steps), *discovery.refused)
    return replace(discovery, final=discovery.base, steps=(), refused=refused)


def _with_beginning(request: Request, model: LoopModel, found: Found) -> Found:
    """Search for gears and limits with the start of the data, where nothing was found without it, and for what the data
    after it tell, but too little, if it shows most there.

    Gears start in the middle of their play and without load; any other difference at the start may be due to the
    unknown initial state. So what else is found there must be in the data after it, too, with the same values.
    """
    always = always_at_start(request.effects)
    looked_for = always | at_start(found.discovery, request.effects)
    what = "gears and limits" if looked_for == always else "effects"
    unseen = ended_before(found.document, request.progress.limit_s, f"{what} in the first {FIRST_S:g} s of the data")
    if request.progress.is_time_up:
        return replace(found, document=unseen)
    request.progress.say("base model")
    prepared = prepare(model)
    without, whole = found.discovery.base, prepared.fit
    without, whole = without.torque_alone, whole.torque_alone
    more = joint_gaps(whole.residual, whole.noise) ** 2 - joint_gaps(without.residual, without.noise) ** 2
    disagrees = bool((more > request.options.smallest_size**2).any())
    if not disagrees and not unconfirmed_gears(found.discovery, request.effects):
        return found
    request.progress.say(f"the first {FIRST_S:g} s disagree: {what} in them" if disagrees else GEARS_FROM_START)
    after, note = AfterStart(Competition(found.builder, found.discovery.base)), DISAGREE if disagrees else WITH_START
    second = _search_with_start(request, prepared, looked_for, after, note)
    of_start = second.discovery
    untold = [
        step for step in of_start.steps if not second.builder.effect(step.effect_at).known_at_start
        and not is_told_later(step, of_start, after.competition)
    ]  # fmt: skip
    if of_start.steps and not untold:
        return _recorded(second, found)
    if second.document.unfinished is not None:
        return replace(found, document=unseen)
    named = ", ".join(step.effect_at.text for step in untold)
    why = f"{named} would explain them, but the data after them ask for other values" if untold else (
        "no gear and no limit explains them" if looked_for == always else "nothing that was looked for explains them"
    )  # fmt: skip
    notes = [*found.document.notes, f"{DISAGREE}; they were left out, and {why}."] if disagrees else (
        found.document.notes
    )  # fmt: skip
    return replace(found, document=found.document.model_copy(update={"notes": notes}))


def _gears_by_beginning(
    request: Request, model: LoopModel, found: Found, untold: Mapping[EffectAtJoint, EffectAtJoint]
) -> Found:
    """The answer with the start of the data where that tells another kind of gear than the data after it, which do not
    tell the two apart; else the answer without it, with its doubt."""
    if request.progress.is_time_up:
        return found
    request.progress.say(GEARS_FROM_START)
    gears = {name for name, effect in request.effects.items() if effect.known_at_start}
    looked_for = gears | {step.effect_at.effect for step in found.discovery.steps}
    after = AfterStart(Competition(found.builder, found.discovery.base), untold)
    second = _search_with_start(request, prepare(model), looked_for, after, WITH_START)
    finished = second.document.unfinished is None
    if finished and is_settled_by_start(untold, found.discovery.steps, second.discovery.steps):
        return _recorded(second, found)
    return found


def _search_with_start(
    request: Request, prepared: Prepared, looked_for: Set[str], later: AfterStart, note: str
) -> Found:
    """A search among some effects with the start of the data."""
    options = request.options
    options = replace(options, forbid=options.forbid | (set(request.effects) - looked_for), at_start=True)
    again = replace(
        request, options=options, keep=None, notes=(*request.notes, f"{note}: the final model includes them.")
    )
    return _Search.of(again, prepared, later).found()


def _recorded(second: Found, first: Found) -> Found:
    """A search with the start of the data with the options that were asked for: not that everything else was
    forbidden."""
    recorded = {**second.document.provenance, "options": first.document.provenance["options"]}
    return replace(second, document=second.document.model_copy(update={"provenance": recorded}))


def _fully_integrated(base: Fit, discovery: Discovery) -> Fit:
    """The final model with the integration steps that its effects and the noise need; the base if nothing was added."""
    final = discovery.final
    if not discovery.steps and not has_external_torques(final.model):
        return base
    try:
        return integrated(final)
    except SimulationError:
        return final
