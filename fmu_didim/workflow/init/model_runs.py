"""Which files belong to one run of a model: one with its inputs, and those with what was measured."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fmu_didim.base.errors import InputError
from fmu_didim.workflow.init.model_columns import ModelFile
from fmu_didim.workflow.init.runs import HELD_OUT, words_of


@dataclass(frozen=True)
class ModelRun:
    """The files of a run.

    Attributes:
        label: of the run; inputs: the file that has them; measured: the files that have outputs.
        held_out: whether it is to judge only; is_guess: whether only the order of the files says what belongs together.
    """

    label: str
    inputs: ModelFile | None
    measured: tuple[ModelFile, ...]
    held_out: bool = False
    is_guess: bool = False


def model_runs(files: Sequence[ModelFile]) -> list[ModelRun]:
    """The runs, those that are fitted first; of several the last one is held out where none says so by its name.

    Raises:
        InputError: no file shows an output, the inputs of a run are in several files, or which files belong together is
            not clear.
    """
    shown = [file for file in files if file.outputs]
    if not shown:
        raise InputError(
            "No column can be an output of the model.", where=", ".join(file.data.path.name for file in files),
            got=", ".join(g.name for file in files for g in file.data.guesses),
            next_step="Add the file with what was measured; fmu-didim fmu info lists the outputs with their units.",
        )  # fmt: skip
    driving = _driving(files)
    grouped = _grouped(shown, driving)
    if len(driving) > 1 and len(driving) != len(grouped):
        raise InputError(
            "Which inputs belong to which measurements is not clear.",
            where=", ".join(file.data.path.name for file in shown),
            got=", ".join(file.data.path.name for file in driving), valid="one file of inputs, or one for each run",
            next_step="Give the files of one run alone, or name those of a run alike: day2_weather.csv, day2_room.csv.",
        )  # fmt: skip
    made, named = list[ModelRun](), list[list[str]]()
    for i, (group, is_guess) in enumerate(grouped):
        own = driving[i] if len(driving) > 1 else next(iter(driving), None)
        parts = [file for file in (own, *group) if file is not None and (len(driving) > 1 or file is not own)]
        named.append(_common_words(parts or group))
        stems = " ".join(file.data.path.stem.lower() for file in parts or group)
        made.append(ModelRun("", own, tuple(group), bool(re.search(HELD_OUT, stems)), is_guess))
    made = [replace(run, label=label) for run, label in zip(made, _labels(made, named), strict=True)]
    made.sort(key=lambda run: run.held_out)
    if len(made) > 1 and not any(run.held_out for run in made):
        made[-1] = replace(made[-1], held_out=True)
    if all(run.held_out for run in made):
        made[0] = replace(made[0], held_out=False)
    labels = [run.label for run in made]
    return [
        replace(run, label=f"run{i}" if labels.count(run.label) > 1 else run.label) for i, run in enumerate(made, 1)
    ]


def _common_words(files: Sequence[ModelFile]) -> list[str]:
    """The words that the names of all these files have, in their order: ``1st`` is one."""
    each = [re.findall(r"[^\W_]+", file.data.path.stem.lower()) for file in files]
    return [word for word in each[0] if all(word in words for words in each)]


def _labels(runs: Sequence[ModelRun], words: Sequence[Sequence[str]]) -> list[str]:
    """The label of each run: what tells its files from those of the other runs, else all that they share, else the name
    of its file."""
    shared = set.intersection(*map(set, words)) if len(runs) > 1 else set[str]()
    own = ["_".join(word for word in found if word not in shared) or "_".join(found) for found in words]
    return [label or run.measured[0].data.path.stem for run, label in zip(runs, own, strict=True)]


def _driving(files: Sequence[ModelFile]) -> list[ModelFile]:
    """The files that have all inputs that any file has."""
    every = {match.name for file in files for match in file.inputs}
    if not every:
        return []
    found = [file for file in files if {match.name for match in file.inputs} == every]
    if not found:
        raise InputError(
            "The inputs of the model are in several files.", where="inputs",
            got="; ".join(
                f"{file.data.path.name}: {', '.join(m.name for m in file.inputs)}"
                for file in files if file.inputs
            ),
            valid="one file a run with all of them", next_step="Write them into one table over one time column.",
        )  # fmt: skip
    return found


def _grouped(shown: Sequence[ModelFile], driving: Sequence[ModelFile]) -> list[tuple[list[ModelFile], bool]]:
    """The files of outputs, those of one run together, and whether only their order says so."""
    count = max(len(driving), *(sum(_outputs(f) == _outputs(g) for f in shown) for g in shown))
    if count == 1:
        return [(list(shown), False)]
    groups: list[list[ModelFile]] = [[] for _ in range(count)]
    guessed = [False] * count
    alone = [words_of(f.data) for f in driving] if len(driving) == count else []
    common = set.intersection(*alone) if alone else set()
    for file in shown:
        if len(driving) == count and file in driving:
            groups[driving.index(file)].append(file)
            continue
        own = words_of(file.data)
        said = [i for i, words in enumerate(alone) if own & (words - common)]
        if not said and alone:  # weather, weather_2: the one without a word of its own
            said = [i for i, words in enumerate(alone) if not words - common]
            said = said if not own & set.union(*alone) - common else []
        place = said[0] if len(said) == 1 else next((i for i, g in enumerate(groups) if not _clash(g, file)), 0)
        guessed[place] |= len(said) != 1 and bool(alone)
        groups[place].append(file)
    return [(group, is_guess) for group, is_guess in zip(groups, guessed, strict=True) if group]


def _outputs(file: ModelFile) -> set[str]:
    return {match.name for match in file.outputs}


def _clash(group: Sequence[ModelFile], file: ModelFile) -> bool:
    return any(_outputs(other) & _outputs(file) for other in group)
