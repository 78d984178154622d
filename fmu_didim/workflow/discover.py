"""The verb ``discover``: a case in; what its model lacks and the augmented model out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from fmu_didim.base.diagnostics import by_weight, refuse_problems
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case import Case, CaseObjects, with_objects
from fmu_didim.checks.data.checks import without_outliers
from fmu_didim.discovery.constants import DECIDING
from fmu_didim.discovery.progress import Progress, never_silent
from fmu_didim.discovery.request import Request
from fmu_didim.discovery.run import discover as discover_in
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.discovery.signals.kinds import SIGNAL_KINDS
from fmu_didim.discovery.signals.run import discover_on_signals
from fmu_didim.dynamics.effects import Effect, effect_catalogue, effect_name
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.estimators import no_progress
from fmu_didim.model.workers import one_blas_thread
from fmu_didim.results.findings import FindingsDocument, save_findings
from fmu_didim.results.provenance import provenance
from fmu_didim.workflow.acknowledged import acknowledged
from fmu_didim.workflow.case_files import case_files, repeating
from fmu_didim.workflow.data import case_diagnostics, check_plant, stated_motors
from fmu_didim.workflow.output.discovered import Discovered
from fmu_didim.workflow.output.discovered_files import result_folder
from fmu_didim.workflow.output.loop import described_estimator
from fmu_didim.workflow.output.result_folder import ResultFolder, checked_case
from fmu_didim.workflow.search import estimated

MOTORS_UNUSED = (
    "motor: of joint {0} was not used: the plant is not built from the robot description, and ripples are looked for "
    "as without a motor."
)


@with_objects
@one_blas_thread
def discover(
    case: Case | Path | str | Mapping[str, Any] | None = None,
    out: Path | str | None = None,
    *,
    forbid: Sequence[str | type[Effect]] = (),
    prefer: Sequence[str | type[Effect]] = (),
    effects: Sequence[str | type[Effect]] = (),
    rounds: int = 5,
    seed: int = 0,
    time_limit: float | None = None,
    figures: bool = False,
    progress: Callable[[str], None] | None = None,
    show: Callable[[Discovered], None] | None = None,
    **objects: Unpack[CaseObjects],
) -> Discovered:
    """Find the physical effects that the model of a case lacks, name them, add them, and show the gap shrink.

    Args:
        case: a loaded case, the path of its file, or its content; its validation experiments are the held-out data.
        robot, plant, controller, log, reference, validation, loop, model, inputs, measured, parameters: objects in the
            place of what the case has, as of
            :func:`identify`.
        out: folder for ``findings.json``, the signals, the augmented robot, FMUs and case, and ``discovery.html``;
            ``findings.json`` holds the best answer so far while the search goes on. Each time all that an earlier run
            left there is replaced, or nothing of it.
        forbid: effects that are not proposed; prefer: taken first out of an ambiguous set.
        effects: further effects, the class itself or its name: ``module:Name`` or ``path/to/file.py:Name``, of the
            working folder or the folder of the case, or ``package.module:Name`` of an installed package.
        rounds: largest number of effects; seed: of the bootstrap.
        time_limit: s from now on after which the search ends with the best answer so far: the answer is ``unfinished``
            and the verdict not settled. The fit of the base model is always made, and what was found is written.
        figures: whether each chart of the page is written there as PNG and SVG, too (``figure_*``), for a paper.
        progress: called with a line about each piece of work.
        show: called with what was found before it takes its place in ``out``.

    Raises:
        InputError, UnknownNameError: the case or a name is wrong, or the results could not be written to ``out``;
            SimulationError: the base model cannot be simulated.
    """
    if rounds < 0:
        raise InputError(
            "The number of rounds must not be negative.", where="rounds", got=rounds, valid="0, 1, 2, ...",
            next_step="Give one of these.",
        )  # fmt: skip
    search = Progress.limited(progress or (lambda text: None), time_limit)
    folder = None if out is None else result_folder(out, figures=figures)
    case = checked_case(case, folder, objects)
    _check_can_discover(case)
    if case.document.model is not None:
        kinds = _kinds(forbid, prefer, effects)
        chosen = dict(forbid=forbid, rounds=rounds, seed=seed, time_limit=time_limit)
        options = Options(forbid=kinds, rounds=rounds, seed=seed)
        with never_silent(search) as told:
            answer = _on_signals(case, options, told, chosen, None if out is None else Path(out))
            return _shown(answer, folder, told, show)
    model = case.model
    places = (Path(), case.folder)
    forbidden, preferred, further = ([effect_name(e, *places) for e in given] for given in (forbid, prefer, effects))
    catalogue = effect_catalogue(further)
    for name in (*forbidden, *preferred):
        if name not in catalogue:
            raise UnknownNameError("effect", name, catalogue, where="forbid, prefer")
    record = provenance(model, {"name": "discover"}, files=case_files(case, effects=further), deciding=DECIDING)
    if all(isinstance(effect, str) for effect in (*forbid, *prefer, *effects)):
        chosen = dict(forbid=forbid, prefer=prefer, effect=effects, rounds=rounds, seed=seed, time_limit=time_limit)
        record |= repeating("discover", case, None if out is None else Path(out), chosen)
    model, of_data = without_outliers(model, refuse_problems(case_diagnostics(case, causes=False)))
    request = Request(
        name=case.name,
        description=described_plant(case),
        effects=catalogue,
        options=Options(forbid=frozenset(forbidden), prefer=tuple(preferred), rounds=rounds, seed=seed),
        progress=search,
        keep=None if folder is None else partial(_keep, folder, search),
        case=case.path.name,
        acknowledged=acknowledged(case),
        provenance={**record, "loop": model.loop.systems[model.first].describe()},
    )
    request = _noting_unused_motors(case, request.about_data(of_data))
    with never_silent(search) as told:
        request = replace(request.beside_virtual() if model.loop.is_virtual else request, progress=told)
        found = discover_in(model, request)
        return _shown(Discovered(found.document, found, case=case), folder, told, show)


def _shown(
    answer: Discovered, folder: ResultFolder | None, search: Progress, show: Callable[[Discovered], None] | None
) -> Discovered:
    """An answer after it was written, where there is a folder, and shown, where that is asked for."""
    if folder is not None:
        return answer.write(folder, progress=search, show=show)
    if show is not None:
        show(answer)
    return answer


def _kinds(forbid: Sequence[str | type[Effect]], prefer: Sequence[object], effects: Sequence[object]) -> frozenset[str]:
    """What is not looked for on the signals of a model; raises where something is asked for that robots have."""
    for name, given in (("prefer", prefer), ("effects", effects)):
        if given:
            raise InputError(
                "This is for robots: on the signals of a model nothing is preferred, and only what ships is looked "
                "for.", where=name, got=", ".join(map(str, given)), valid=", ".join(SIGNAL_KINDS),
                next_step=f"Leave {name} out; forbid takes out what cannot be.",
            )  # fmt: skip
    for kind in forbid:
        if kind not in SIGNAL_KINDS:
            raise UnknownNameError("effect on a signal", str(kind), SIGNAL_KINDS, where="forbid")
    return frozenset(map(str, forbid))


def _on_signals(
    case: Case, options: Options, progress: Progress, chosen: Mapping[str, Any], out: Path | None
) -> Discovered:
    """What the signals of a model lack."""
    model = case.model
    record = provenance(model, described_estimator(case), files=case_files(case), deciding=DECIDING)
    record |= repeating("discover", case, out, dict(chosen))
    model, of_data = without_outliers(model, refuse_problems(case_diagnostics(case)))
    _, of_model = check_plant(case, model)
    before = by_weight([*of_data, *refuse_problems(of_model)])
    request = Request(
        name=case.name, description=None, effects={}, options=options, progress=progress, case=case.path.name,
        acknowledged=acknowledged(case), provenance={**record, "loop": model.loop.systems[model.first].describe()},
    )  # fmt: skip
    found = discover_on_signals(
        model, lambda one: estimated(case, one, None, no_progress), request, before=before
    )  # fmt: skip
    return Discovered(found.document, found, case=case)


def _check_can_discover(case: Case) -> None:
    """Raise InputError where nothing can be found, as in an open loop."""
    if case.document.model is not None:
        return
    model = case.model
    if any(experiment.is_unsigned for experiment in model.experiments.values()):
        raise InputError(
            "A log without signs shows too little of what the model lacks.", where="torque: unsigned",
            next_step="Identify it first (fmu-didim identify): torque_estimation.csv of the result has the signs that "
            "were found; or log the torque with its sign.",
        )  # fmt: skip
    if model.loop.torque_is_given:
        raise InputError(
            "The loop is open: the torque is given, so that it shows nothing of what the model lacks.",
            where="connections", got=", ".join(model.experiments.channels) or "no measured:",
            next_step="Look at identify, whose motion-unexplained says whether the model lacks something; to name it, "
            "use a log of the closed loop.",
        )  # fmt: skip


def described_plant(case: Case) -> RobotDescription | None:
    """The robot, if the plant is built from it; effects can only be added around any other plant."""
    source = case.document.plant_source
    if source is not None and not source.endswith((".yaml", ".yml")):
        return None
    robot = getattr(case.parameters, "model", None)
    return robot.description if isinstance(robot, RobotModel) else None


def _noting_unused_motors(case: Case, request: Request) -> Request:
    """The request, with a note where motors are stated that the search does not see."""
    stated = stated_motors(case) if request.description is None else {}
    return request.noting(MOTORS_UNUSED.format(", ".join(map(str, stated)))) if stated else request


def _keep(folder: ResultFolder, progress: Progress, document: FindingsDocument) -> None:
    """Save the best answer so far, without the files of an earlier run; where that fails, the search goes on."""
    try:
        with folder.written() as new:
            save_findings(document, new)
    except InputError as error:
        progress.say(f"the answer so far could not be written: {error.got}")
