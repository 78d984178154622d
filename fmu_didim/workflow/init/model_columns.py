"""Which columns of the given files are inputs and outputs of a model, by their names and units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fmu_didim.base.documents import TO_FILL_IN
from fmu_didim.components.fmu.description import PORT_TYPES, FmuDescription, FmuVariable
from fmu_didim.data.tables.table import split_unit
from fmu_didim.data.units import known_unit
from fmu_didim.workflow.init.data_file import DataFile

SAME_NAME = 2
"""[1] Likeness of names from which they mean the same; below, words of one are in the other."""
MOST_SHOWN = 8
"""Names that a question lists."""


@dataclass(frozen=True)
class Match:
    """The columns of a file that may be a variable of the model.

    Attributes:
        name, unit: of the variable; the name is to be filled in where several variables may be meant.
        columns: that may be it; one where it is clear.
        reason: why this one, or what the user is asked.
        is_clear: whether neither the variable nor the column is asked for.
    """

    name: str
    unit: str
    columns: tuple[str, ...]
    reason: str
    is_clear: bool = True

    @property
    def column(self) -> str:
        """The column, or the mark that it is to be filled in."""
        is_the_one = self.is_clear or (len(self.columns) == 1 and self.name == TO_FILL_IN)
        return self.columns[0] if is_the_one else TO_FILL_IN


@dataclass(frozen=True)
class ModelFile:
    """A file, and what of the model it shows: its inputs and its outputs."""

    data: DataFile
    inputs: tuple[Match, ...] = ()
    outputs: tuple[Match, ...] = ()

    @property
    def matches(self) -> tuple[Match, ...]:
        """Both."""
        return (*self.inputs, *self.outputs)

    @property
    def left(self) -> list[str]:
        """The columns that are nothing yet."""
        taken = {column for match in self.matches for column in match.columns}
        return [column for column in _columns(self.data) if column not in taken]


def variables(fmu: FmuDescription, causality: str) -> list[FmuVariable]:
    """The scalar variables of a kind that are numbers."""
    return [v for v in fmu.of_causality(causality) if not v.shape and v.type in PORT_TYPES]


def matched(fmu: FmuDescription, files: Sequence[DataFile]) -> list[ModelFile]:
    """Each file with the variables that it shows.

    A column is taken by its name, however capitals and signs between words are written, else by words that its name
    shares with the variable or its description. What is left is taken by its unit, or as the only one that is left, and
    asked for where there are several.
    """
    inputs, outputs = variables(fmu, "input"), [*variables(fmu, "output"), *_shown_locals(fmu, files)]
    best = _best(files, [*inputs, *outputs])
    found = [_by_name(data, inputs, outputs, best) for data in files]
    driving = [file for file in found if file.inputs] or [file for file in found if not file.outputs][:1] or found[:1]
    open_ = [v for v in inputs if not best[v.name]]
    found = [replace(f, inputs=(*f.inputs, *_left_over(f, open_, asks=True))) if f in driving else f for f in found]
    named = [file for file in found if file.outputs]
    shown = named or [file for file in found if not file.inputs] or found
    open_ = [v for v in outputs if not best[v.name]]  # no local variable is among them
    return [replace(f, outputs=(*f.outputs, *_left_over(f, open_, asks=not named))) if f in shown else f for f in found]


def _shown_locals(fmu: FmuDescription, files: Sequence[DataFile]) -> list[FmuVariable]:
    """Variables that the model computes and does not give as outputs, if a column has the name of one and of nothing
    else."""
    taken = {_plain(v.name) for causality in ("input", "output") for v in variables(fmu, causality)}
    columns = {_plain(_bare(data, column)) for data in files for column in _columns(data)} - taken - {""}
    return [v for v in variables(fmu, "local") if _plain(v.name) in columns]


def named_alike(fmu: FmuDescription, files: Sequence[DataFile]) -> bool:
    """Whether columns have the names of all inputs and of an output."""
    best = _best(files, [*variables(fmu, "input"), *variables(fmu, "output")])
    inputs = all(best[v.name] >= SAME_NAME for v in variables(fmu, "input"))
    return inputs and any(best[v.name] >= SAME_NAME for v in variables(fmu, "output"))


def _best(files: Sequence[DataFile], among: Sequence[FmuVariable]) -> dict[str, int]:
    """Name of each variable -> the likeness of the column that is most like it, in any file."""
    return {v.name: max((_likeness(v, d, c) for d in files for c in _columns(d)), default=0) for v in among}


def _by_name(
    data: DataFile, inputs: Sequence[FmuVariable], outputs: Sequence[FmuVariable], best: dict[str, int]
) -> ModelFile:
    columns, found = _columns(data), dict[str, Match]()
    for v in sorted((*inputs, *outputs), key=lambda v: -best[v.name]):  # the surest first
        taken = {c for match in found.values() for c in match.columns if match.is_clear}
        alike = [c for c in columns if c not in taken and 0 < best[v.name] == _likeness(v, data, c)]
        if alike:
            reason = "by its name" if best[v.name] >= SAME_NAME else "by words of its name"
            found[v.name] = _match(v, alike, reason)
    own, shown = (tuple(found[v.name] for v in side if v.name in found) for side in (inputs, outputs))
    return ModelFile(data, own, shown)


def _left_over(file: ModelFile, open_: Sequence[FmuVariable], *, asks: bool) -> list[Match]:
    """Variables and columns that no name brings together.

    Args:
        asks: whether the user is asked where it is not clear; else only what is clear is given.
    """
    data, made = file.data, list[Match]()
    same = {v.name: [c for c in file.left if _same_unit(v, data, c)] for v in open_}
    may = {v.name: same[v.name] or [c for c in file.left if _may_be(v, data, c)] for v in open_}
    for v in open_:
        rivals = [w for w in open_ if set(may[w.name]) & set(may[v.name])]
        if len(may[v.name]) == 1 and len(rivals) == 1 and (same[v.name] or asks):
            made.append(_match(v, may[v.name], "by its unit" if same[v.name] else "as what is left: check it"))
    clear = {match.name for match in made}
    if not asks:
        return made
    asked = [v for v in open_ if v.name not in clear and may[v.name]]
    if len(asked) > 1 and file.left and not any(v.causality == "input" for v in asked):  # one of many outputs
        columns = tuple(dict.fromkeys(c for v in asked for c in may[v.name]))
        names = ", ".join(v.name for v in asked[:MOST_SHOWN]) + (", ..." if len(asked) > MOST_SHOWN else "")
        question = f"which of the outputs {names}" + (f"; which of {', '.join(columns)}" if len(columns) > 1 else "")
        return [*made, Match(TO_FILL_IN, "", columns, question, is_clear=False)] if not clear else made
    return [*made, *(Match(v.name, v.unit, tuple(may[v.name]), "", is_clear=False) for v in asked)]


def _match(v: FmuVariable, columns: Sequence[str], reason: str) -> Match:
    return Match(v.name, v.unit, tuple(columns), reason, is_clear=len(columns) == 1)


def _columns(data: DataFile) -> list[str]:
    return [g.name for g in data.guesses]


def _bare(data: DataFile, column: str) -> str:
    return split_unit(column)[0] if data.table.has_header else ""


def _may_be(v: FmuVariable, data: DataFile, column: str) -> bool:
    """Whether the unit of a column, if both are known, is one of the kind of the variable's."""
    units = [known_unit(unit) if unit else None for unit in (v.unit, data.table.unit(column))]
    return None in units or units[0].powers == units[1].powers  # type: ignore[union-attr]


def _same_unit(v: FmuVariable, data: DataFile, column: str) -> bool:
    return bool(v.unit and data.table.unit(column)) and _may_be(v, data, column)


def _likeness(v: FmuVariable, data: DataFile, column: str) -> int:
    """How much the name of a column is that of a variable: 4 the same, 0 not at all, or another unit."""
    own, name = _bare(data, column), v.name
    if not own or not _may_be(v, data, column):
        return 0
    if own == name:
        return 4
    plain, last = (_plain(text) for text in (own, own.rpartition(".")[2]))
    if plain == _plain(name):
        return 3
    if last == _plain(name.rpartition(".")[2]):
        return SAME_NAME
    words, theirs = _words(own), _words(name)
    described = theirs | _words(v.description)
    is_part = bool(words) and (words <= described or (bool(theirs) and theirs <= words))
    return 1 if is_part and any(len(word) > 1 for word in words & described) else 0


def _plain(text: str) -> str:
    return re.sub(r"[\W_]+", "", text).casefold()


def _words(text: str) -> set[str]:
    """The words of a name: ``T_outAir1`` has t, out, air and 1."""
    return {word.casefold() for word in re.findall(r"[A-Z]?[^\W\dA-Z_]+|[A-Z]+|\d+", text)}
