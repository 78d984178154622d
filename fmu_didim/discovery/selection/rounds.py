"""The rounds of discovery: compete, decide, add, refit, test backwards; until nothing more is worth a name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from fmu_didim.diagnosis.gap import delta_bic, explained
from fmu_didim.discovery.augmentation.builder import Workshop
from fmu_didim.discovery.screening.catalogue import Library
from fmu_didim.discovery.selection.contenders import Contender, Screened, contend, screen, shortlist, with_shapes_held
from fmu_didim.discovery.selection.decide import Options, Step, decide, step_of
from fmu_didim.discovery.selection.saturation import NAME as SATURATION
from fmu_didim.discovery.selection.saturation import saturation
from fmu_didim.errors import SimulationError
from fmu_didim.prediction.least_squares import Fit, minimise
from fmu_didim.prediction.loop_model import LOG, Addition
from fmu_didim.prediction.noise import Noise

Say = Callable[[str], None]
BASIC = frozenset({"motor_inertia", "viscous", "coulomb"})
"""Effects of the base model, never proposed."""
COMPOSED = frozenset({"lugre"})
"""Effects made of others, which are proposed one by one; they are still told as members of their class."""


@dataclass(frozen=True)
class Discovery:
    """What the rounds came to.

    Attributes:
        base, final: fits without and with the effects; steps: one an effect that stayed.
        refused: contenders that were best in the last round but not accepted, and why.
    """

    base: Fit
    final: Fit
    steps: tuple[Step, ...]
    refused: tuple[tuple[Addition, str], ...] = ()


def run_rounds(workshop: Workshop, base: Fit, noise: Noise, options: Options, say: Say) -> Discovery:
    """Add effects to the base model as long as the data ask for them."""
    fit, steps = base, []
    saturated = saturation(workshop, base, noise, options, say)
    if saturated is not None:
        step, fit = saturated
        steps.append(step)
    candidates = _candidates(workshop, options)
    say(f"signatures of {len(candidates)} candidates")
    library = Library(workshop, fit, candidates=candidates)
    refused: tuple[tuple[Addition, str], ...] = ()
    while len(steps) < options.rounds:
        screened = screen(library, workshop, fit, noise)
        contenders = contend(shortlist(screened, workshop), workshop, fit, noise, progress=say)
        held = partial(_with_shapes_held, screened, workshop, fit, noise)
        accepted = decide(contenders, workshop, fit, noise, options, base=base, held=held)
        if isinstance(accepted, Contender):
            # The competition's fits are short; what is missing next is looked for from the minimum.
            accepted = replace(accepted, fit=minimise(accepted.fit.model, noise, renew=1, exact=True))
            step = step_of(accepted, contenders, workshop, fit, noise, options)
            say(f"added: {accepted.addition.effect} on joint {accepted.addition.joint}")
            steps.append(step)
            fit, steps = _backward(workshop, accepted.fit, noise, steps, options, say)
            if _shifts_log(fit) != _shifts_log(library.fit):  # signatures at other samples
                left = [c for c in candidates if c not in fit.model.additions]
                library = Library(workshop, fit, candidates=left)
        else:
            refused = accepted
            break
    return Discovery(base, fit, tuple(steps), refused)


def _with_shapes_held(
    screened: Sequence[Screened], workshop: Workshop, fit: Fit, noise: Noise, addition: Addition
) -> Iterator[Contender]:
    candidate = next(s for s in screened if s.addition == addition)
    if candidate.others is not None and workshop.free_parameters(addition)[1]:
        yield from with_shapes_held(candidate, workshop, fit, noise)


def _shifts_log(fit: Fit) -> bool:
    return any(knob.owner == LOG for knob in fit.model.knobs)


def _candidates(workshop: Workshop, options: Options) -> list[Addition]:
    names = [
        name
        for name in workshop.effects
        if name not in BASIC | COMPOSED and name not in options.forbid and name != SATURATION  # the pre-check's
    ]
    present = _present(workshop)
    return [Addition(name, j) for name in names for j in workshop.joints(name) if (name, j) not in present]


def _present(workshop: Workshop) -> set[tuple[str, int]]:
    """Effects that the base model has already."""
    if workshop.description is None:
        return set()
    return {(e, j) for j, joint in enumerate(workshop.description.joints, start=1) for e in joint.effects}


def _backward(
    workshop: Workshop, fit: Fit, noise: Noise, steps: list[Step], options: Options, say: Say
) -> tuple[Fit, list[Step]]:
    """Take out effects that the newest one has made superfluous."""
    for step in steps[:-1]:
        index = fit.model.additions.index(step.addition)
        kept = [i for i, knob in enumerate(fit.model.knobs) if knob.effect != index]
        smaller = workshop.without(fit.model, index)
        try:
            without = minimise(smaller, noise, jacobian=fit.jacobian[:, :, kept], renew=1)
        except SimulationError:
            continue
        worth = delta_bic(without.residual, fit.residual, workshop.cost(step.addition), noise)
        size, _ = explained(without.residual, fit.residual, noise)
        if worth < options.threshold or size < 0.5 * options.smallest_gain:
            say(f"taken out again: {step.addition.effect} on joint {step.addition.joint}")
            fit = minimise(without.model, noise)
            steps = [s for s in steps if s is not step]
    return fit, steps
