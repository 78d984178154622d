"""From a campaign to its runs: combinations of values, and the identity of each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc

from fmu_didim.base.documents import load_yaml
from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.planning.document import Block, CampaignDocument, Span
from fmu_didim.campaigns.planning.fields import Label, labels, with_value
from fmu_didim.campaigns.planning.identity import References
from fmu_didim.campaigns.planning.recorded import written_out
from fmu_didim.case.changes import merged
from fmu_didim.data.signals import Array
from fmu_didim.results.provenance import code_digest, digest

SECTIONS = ("case", "truth", "noise", "options", "label")
"""First words of paths that are not fields of the case."""
DATA_ROOTS = (
    "robot", "plant", "controller", "system", "loop", "experiments", "train", "validation", "model", "inputs",
    "measured",
)  # fmt: skip
"""Entries of a case that simulated data depend on."""


@dataclass(frozen=True, eq=False)
class Setting:
    """One value of a field; equal only to itself, so that thousands of runs share it.

    Attributes:
        path: of the field; value: None removes the entry; label: as tables show it.
        drawn: whether the value was drawn from a range, so that hardly another run has it.
    """

    path: str
    value: Any
    label: Any
    drawn: bool = False

    @property
    def root(self) -> str:
        """The entry of the case, or the section with its entry, that it belongs to."""
        head, _, rest = self.path.partition(".")
        return f"{head}.{rest.partition('.')[0]}" if head == "truth" else head


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """One run of a campaign.

    Attributes:
        id: digest of case, files, truth, noise, seed and code; design: the same without the seed.
        data: digest of what the data depend on; runs with the same digest have the same data, and it seeds the noise of
            simulated data.
        seed: number of the noise seed; settings: what varies.
    """

    id: str
    design: str
    data: str
    seed: int
    settings: tuple[Setting, ...]

    @property
    def labels(self) -> dict[str, Any]:
        """Path -> value as tables show it."""
        return {s.path: s.label for s in self.settings}


@dataclass(frozen=True)
class Content:
    """The content of a run as plain values, ready to be sent.

    Attributes:
        case: content of the case; truth: that of the simulated machine, None where data are measured.
        noise, options: as the documents say; folder: to which names of files are relative.
    """

    case: dict[str, Any]
    truth: dict[str, Any] | None
    noise: dict[str, Any]
    options: dict[str, Any]
    folder: str


@dataclass(frozen=True)
class Plan:
    """The runs of a campaign.

    Attributes:
        document: the campaign; folder: to which its paths are relative; file: its name there, empty without one.
    """

    document: CampaignDocument
    folder: Path
    references: References = field(default_factory=References)
    file: str = ""

    @property
    def code(self) -> str:
        """The digest of the code that the runs belong to."""
        return code_digest()

    @cached_property
    def runs(self) -> tuple[PlannedRun, ...]:
        """All runs, those of one case next to each other; equal ones occur once."""
        found: dict[str, PlannedRun] = {}
        for settings in self.combinations():
            for run in self.identities.runs(settings):
                found.setdefault(run.id, run)
        return tuple(found.values())

    @cached_property
    def identities(self) -> Identities:
        """Computes the identity of each run."""
        return Identities(self)

    @cached_property
    def by_id(self) -> dict[str, PlannedRun]:
        """The runs by their id."""
        return {run.id: run for run in self.runs}

    @property
    def quantity(self) -> str:
        """What the cases fit, in a word: torque, or the outputs of a model."""
        first = next(self.combinations(), ())
        return "output" if "model" in self.base(first)[0] else "torque"

    @property
    def combination_count(self) -> int:
        """Runs that the campaign asks for, equal ones counted as often as they occur."""
        return math.prod(map(len, self.blocks)) * len(self.document.seeds)

    @property
    def paths(self) -> tuple[str, ...]:
        """The fields that vary, without the seed; of a block with labels only these, which name the combinations."""
        found: list[str] = []
        for block in self.document.vary:
            labels = [path for path in block.paths if path.startswith("label.")]
            found += labels or block.paths
        return tuple(dict.fromkeys(found))

    def combinations(self) -> Iterator[tuple[Setting, ...]]:
        """The settings of every case."""
        for parts in product(*self.blocks):
            yield tuple(setting for part in parts for setting in part)

    @cached_property
    def blocks(self) -> list[list[tuple[Setting, ...]]]:
        """The combinations of each block."""
        shown = _labels_of(self.document.vary)
        return [list(_combinations(block, shown)) for block in self.document.vary]

    def variants(self) -> Iterator[tuple[Setting, ...]]:
        """Cases in which each value of each block occurs, the other blocks at their first combination."""
        first = [block[0] for block in self.blocks]
        yield tuple(setting for part in first for setting in part)
        for i, block in enumerate(self.blocks):
            seen = {id(setting) for setting in first[i]}
            for part in block:
                if not {id(setting) for setting in part} <= seen:
                    seen |= {id(setting) for setting in part}
                    yield tuple(setting for p in (*first[:i], part, *first[i + 1 :]) for setting in p)

    def content(self, settings: Sequence[Setting], *, skipped: list[str] | None = None) -> Content:
        """The content of a case of the plan.

        Args:
            skipped: receives the messages about paths that do not exist, which are then left out.

        Raises:
            InputError: a file cannot be read, or a path does not exist.
        """

        def set_value(content: dict[str, Any], path: str, setting: Setting) -> dict[str, Any]:
            try:
                return dict(with_value(content, path, setting.value, folder))
            except InputError as error:
                if skipped is None:
                    raise
                valid = f"; valid: {error.valid}" if error.valid else ""
                skipped.append(f"vary.{setting.path}: {error.what} (got {error.got}{valid})")
                return content

        case, folder = self.base(settings)
        truth: dict[str, Any] = {}
        noise, options = self.document.noise, self.document.options
        own: dict[str, Any] = {
            "noise": noise.model_dump(exclude_unset=True) if noise is not None else {},
            "options": options.model_dump(exclude_unset=True),
        }
        for setting in settings:
            head, _, rest = setting.path.partition(".")
            if head in ("noise", "options"):
                own[head] = set_value(own[head], rest, setting)
            elif head not in SECTIONS:
                case = set_value(case, setting.path, setting)
        if self.document.is_simulated:
            truth = merged(case, self.document.truth or {})
            for setting in settings:
                if setting.path.startswith("truth."):
                    truth = set_value(truth, setting.path.removeprefix("truth."), setting)
        return Content(case, truth or None, own["noise"], own["options"], str(folder))

    def base(self, settings: Sequence[Setting]) -> tuple[dict[str, Any], Path]:
        """The content of the base case, and the folder of its files."""
        source = next((s.value for s in settings if s.path == "case"), self.document.case)
        if isinstance(source, Mapping):
            return written_out(source), self.folder
        path = self.folder / str(source)
        if path not in self._bases:
            self._bases[path] = written_out(load_yaml(path))
        return self._bases[path], path.parent.resolve()

    @cached_property
    def _bases(self) -> dict[Path, dict[str, Any]]:
        return {}


class Identities:
    """The identities of many runs; what they share is digested once.

    Each entry of a case has a digest, which is cached by the settings that change the entry. Values that are drawn from
    a range are digested apart from the rest of the entry: thousands of them would fill the cache.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        # Key -> digest, and the settings, whose ids in the key stay unique as long as they live.
        self._digests: dict[tuple[Any, ...], tuple[str, Sequence[Setting]]] = {}
        self._code, self._verb = plan.code, plan.document.verb
        self._seeds = plan.document.seeds
        self._truth_roots = set(plan.document.truth or {})
        varied = (path for block in plan.document.vary for path in block.paths)
        self._truth_roots |= {path.split(".")[1] for path in varied if path.startswith("truth.")}

    def runs(self, settings: tuple[Setting, ...]) -> Iterator[PlannedRun]:
        """The runs of one case, one a seed."""
        plan, simulated = self._plan, self._plan.document.is_simulated
        touching: dict[str, list[Setting]] = {}
        for setting in settings:
            touching.setdefault(setting.root, []).append(setting)
        base, _ = plan.base(settings)
        fields = {root for root in touching if root.partition(".")[0] not in SECTIONS}
        roots = {*base, *fields} - {"name", "description"}
        chosen = touching.get("case", [])
        case = {root: self._of(("case", root), root, [*chosen, *touching.get(root, ())]) for root in roots}
        extra = {s: self._of((s,), s, [*chosen, *touching.get(s, ())]) for s in ("noise", "options")}
        truth = {}
        if simulated:
            for root in {*DATA_ROOTS} & {*roots, *self._truth_roots}:
                parts = [*chosen, *touching.get(root, ()), *touching.get(f"truth.{root}", ())]
                truth[root] = self._of(("truth", root), root, parts)
        source = truth if simulated else {root: case[root] for root in DATA_ROOTS if root in case and root in _LOGS}
        design = digest([self._verb, case, truth, extra["noise"] if simulated else "", extra["options"], self._code])
        for seed in self._seeds:
            data = digest([source, extra["noise"], seed] if simulated else source)
            yield PlannedRun(digest([design, seed]), design, data, seed, settings)

    def _of(self, kind: tuple[str, ...], root: str, parts: Sequence[Setting]) -> str:
        drawn = [part for part in parts if part.drawn]
        if drawn:
            fixed = self._of(kind, root, [part for part in parts if not part.drawn])
            return digest([fixed, [(part.path, part.value) for part in drawn]])
        key = (*kind, *map(id, parts))
        if key not in self._digests:
            content = self._plan.content(parts)
            entries: dict[str, Any] = {"case": content.case, "truth": content.truth or {}}
            value = entries[kind[0]].get(root) if kind[0] in entries else getattr(content, kind[0])
            if self._plan.document.is_simulated:
                value = _without_logs(value, root)
            self._digests[key] = digest(self._plan.references.canonical(value, Path(content.folder), root)), parts
        return self._digests[key][0]


_LOGS = ("experiments", "train", "validation", "inputs", "measured")


def _without_logs(value: Any, root: str) -> Any:
    """An entry of a case without the names of logs, which are simulated."""
    if root not in _LOGS or not isinstance(value, Mapping):
        return value
    if root == "experiments":
        return {label: _without_logs(run, "train") for label, run in value.items()}
    result = dict(value)
    for part in ("torque", "positions"):
        if isinstance(result.get(part), Mapping):
            result[part] = {k: v for k, v in result[part].items() if k not in ("file", "columns", "time", "obtain")}
    return result


Labels = Mapping[tuple[str, str], Label]
"""(Path, value as Python writes it) -> its label."""


def _labels_of(blocks: Sequence[Block]) -> Labels:
    """Labels of all values that the document does not name itself: those of a field are distinct over all blocks."""
    values: dict[str, list[Any]] = {}
    for block in blocks:
        for entry in block.list_ or ():
            for path, value in entry.items():
                values.setdefault(path, []).append(value)
        for path, some in (block.of(block.kind) if block.list_ is None else {}).items():
            if not isinstance(some, Mapping | Span):
                values.setdefault(path, []).extend(some)
    return {
        (path, repr(value)): shown
        for path, some in values.items()
        for value, shown in zip(some, labels(some), strict=True)
    }


def _combinations(block: Block, shown: Labels) -> Iterator[tuple[Setting, ...]]:
    """The settings of a block, one tuple a combination."""
    if block.list_ is not None:
        for entry in block.list_:
            yield tuple(Setting(path, value, shown[path, repr(value)]) for path, value in entry.items())
    elif block.kind == "grid":
        yield from product(*(_axis(path, values, shown) for path, values in (block.grid or {}).items()))
    elif block.kind == "zip":
        yield from zip(*(_axis(path, values, shown) for path, values in (block.zip or {}).items()), strict=True)
    else:
        yield from _drawn(block, shown)


def _axis(path: str, values: Any, shown: Labels) -> list[Setting]:
    """The values of one field, by the names that the document gives them or by their labels."""
    if isinstance(values, Mapping):
        return [Setting(path, value, name) for name, value in values.items()]
    return [Setting(path, value, shown[path, repr(value)]) for value in values]


def _drawn(block: Block, shown: Labels) -> Iterator[tuple[Setting, ...]]:
    """Samples of ranges and choices; a Latin hypercube fills the range of each field evenly."""
    fields = block.of(block.kind)
    assert block.count is not None
    if block.kind == "random":
        unit: Array = np.random.default_rng(block.seed).random((block.count, len(fields)))
    else:
        unit = qmc.LatinHypercube(d=len(fields), rng=block.seed).random(block.count)
    choices = {path: _axis(path, values, shown) for path, values in fields.items() if not isinstance(values, Span)}
    for row in unit.tolist():
        settings = []
        for (path, values), u in zip(fields.items(), row, strict=True):
            if isinstance(values, Span):
                low, high = values.low, values.high
                is_log = values.scale == "log"
                value = math.exp(math.log(low) + u * math.log(high / low)) if is_log else low + u * (high - low)
                settings.append(Setting(path, value, value, drawn=True))
            else:
                settings.append(choices[path][min(int(u * len(values)), len(values) - 1)])
        yield tuple(settings)
