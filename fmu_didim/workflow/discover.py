"""The verb ``discover``: a case in; what its model lacks and the augmented model out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from fmu_didim.base.diagnostics import refuse_problems
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case import Case, CaseObjects, with_objects
from fmu_didim.discovery.next_experiment.design import design_experiment
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.run import Found, Request
from fmu_didim.discovery.run import discover as discover_in
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.dynamics.effects import Effect, effect_catalogue, effect_name
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.model.workers import one_blas_thread
from fmu_didim.results.findings import FINDINGS_FILE, FindingsDocument, save_findings
from fmu_didim.results.provenance import provenance
from fmu_didim.workflow.case_files import case_files, repeating
from fmu_didim.workflow.data import case_diagnostics
from fmu_didim.workflow.output.augmented_files import (
    CASE_FILE,
    ROBOT_FILE,
    SYSTEM_FILE,
    augmented_robot,
    write_augmented,
    write_signals,
)
from fmu_didim.workflow.output.discovered import Discovered
from fmu_didim.workflow.output.result_folder import ResultFolder, checked_case

NEXT_FILE = "reference_next.yaml"
NO_MOTION = "No motion within the limits of the present reference splits them better than the present one."


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
        robot, plant, controller, log, reference, validation, loop: objects in the place of what the case has, as of
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
    search = Progress.limited(progress or (lambda text: None), time_limit)
    folder = None if out is None else result_folder(out, figures=figures)
    case = checked_case(case, folder, objects)
    model = case.model
    places = (Path(), case.folder)
    forbidden, preferred, further = ([effect_name(e, *places) for e in given] for given in (forbid, prefer, effects))
    catalogue = effect_catalogue(further)
    for name in (*forbidden, *preferred):
        if name not in catalogue:
            raise UnknownNameError("effect", name, catalogue, where="forbid, prefer")
    record = provenance(model, {"name": "discover"}, files=case_files(case))
    if all(isinstance(effect, str) for effect in (*forbid, *prefer, *effects)):
        chosen = dict(forbid=forbid, prefer=prefer, effect=effects, rounds=rounds, seed=seed, time_limit=time_limit)
        record |= repeating("discover", case, None if out is None else Path(out), chosen)
    of_data = refuse_problems(case_diagnostics(case, causes=False))
    run = _Run(case, _description(case), search, folder, show or (lambda found: None))
    request = Request(
        name=case.name,
        description=run.description,
        effects=catalogue,
        options=Options(forbid=frozenset(forbidden), prefer=tuple(preferred), rounds=rounds, seed=seed),
        progress=search,
        keep=None if folder is None else run.keep,
        case=case.path.name,
        provenance={**record, "loop": model.systems[model.first].describe()},
    )
    found = discover_in(model, request.about_data(of_data))
    return run.answer(found)


def result_folder(out: Path | str, *, figures: bool = False) -> ResultFolder:
    """The folder of the results of ``discover``."""
    from fmu_didim.report.discovery.sections import DISCOVERY_FILE

    fixed = (DISCOVERY_FILE, ROBOT_FILE, CASE_FILE, SYSTEM_FILE, NEXT_FILE)
    patterns = ("signals_*.csv", "simulated_*.csv", "figure_*", "data_*.csv", "*.fmu", "reference_next.csv")
    return ResultFolder(Path(out), "discover", FINDINGS_FILE, fixed, patterns, "files", figures)


def _description(case: Case) -> RobotDescription | None:
    """The robot, if the plant is built from it: to any other plant effects can only be added from outside."""
    source = case.document.plant_source
    if source is not None and not source.endswith((".yaml", ".yml")):
        return None
    robot = getattr(case.parameters, "model", None)
    return robot.description if isinstance(robot, RobotModel) else None


@dataclass(frozen=True)
class _Run:
    """One discovery, with where it is shown and written.

    Attributes:
        description: the robot, None for a plant that is a black box.
        folder: of the results, None where nothing is written.
    """

    case: Case
    description: RobotDescription | None
    progress: Progress
    folder: ResultFolder | None
    show: Callable[[Discovered], None]

    def keep(self, document: FindingsDocument) -> None:
        """Save the answer so far in place of an earlier run; the search goes on where that fails."""
        assert self.folder is not None
        try:
            with self.folder.written() as new:
                save_findings(document, new)
        except InputError as error:
            self.progress.say(f"the answer so far could not be written: {error.got}")

    def answer(self, found: Found) -> Discovered:
        """The answer, shown and then moved to its folder; shown as well where writing fails."""
        answer = Discovered(found.document, found)
        if self.folder is None:
            self.show(answer)
            return answer
        with self.folder.written() as new:
            try:
                answer = Discovered(self._written(found, new, self.folder.folder), found)
                if self.folder.figures:
                    from fmu_didim.report.paper import write_figures

                    write_figures(new)
            finally:
                self.show(answer)
        return answer

    def _written(self, found: Found, new: Path, home: Path) -> FindingsDocument:
        """Everything written to a folder whose files will lie in ``home``, and the document that names it."""
        from fmu_didim.report.discovery.sections import write_discovery_report

        files = write_signals(found, new)
        notes = list(found.document.notes)
        if found.discovery.final.model.added_effects:
            self.progress.say("writing the augmented model")
            augmented, note = write_augmented(self.case, found, self.description, new, home)
            files |= augmented
            notes.append(note)
        document = found.document
        proposed: dict[str, str] = {}
        if self.description is not None and not self.progress.is_time_up:
            document, proposed = _with_experiment(found, new, self.progress.say)
        document = document.model_copy(update={"files": files | proposed, "notes": notes})
        save_findings(document, new)
        write_discovery_report(new)
        return document


def _with_experiment(found: Found, out: Path, say: Callable[[str], None]) -> tuple[FindingsDocument, dict[str, str]]:
    """The document with a motion that splits the first ambiguous set of fitted effects, and the file of that motion."""
    document, final = found.document, found.discovery.final
    first = len(document.findings) - len(found.discovery.steps)  # torques from outside come before
    for i, step in enumerate(found.discovery.steps, start=first):
        if len(step.members) < 2:
            continue
        say("designing the experiment that splits the ambiguous effects")
        without = found.builder.without(final.model, final.model.added_effects.index(step.effect_at))
        robot = augmented_robot(found.builder, replace(final, model=without, values=without.start))
        model = RobotModel(robot)
        experiment = final.model.experiments[final.model.first]
        try:
            plan = design_experiment(
                robot,
                model.parameter_values,
                step.members[:2],  # the nearest rival: with more of them the worst pair decides
                reference=experiment.reference,
                rate_hz=experiment.rate_hz,
                noise=final.noise,
                effects=found.builder.effects,
            )
        except InputError:
            continue  # two structures, say, have no columns to be compared by: the general advice stays
        advice = document.findings[i].experiment
        text = plan.description if plan.reference is not None else f"{advice} {NO_MOTION}"
        findings = list(document.findings)
        findings[i] = findings[i].model_copy(update={"experiment": text})
        document = document.model_copy(update={"findings": findings})
        if plan.reference is None:
            return document, {}
        return document, {"reference_next": plan.save(out / NEXT_FILE).name}
    return document, {}
