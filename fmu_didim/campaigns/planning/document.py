"""The campaign file: a base case, what varies in it, and where the data come from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from fmu_didim.base.documents import AlsoWritten, Count, NotNegative, Positive, Strict

TIME_LIMIT_S = 3600.0
"""[s] Limit of one run where the campaign states none: three times the longest known discovery."""
MEMORY_LIMIT_MB = 4096.0
"""[MB] Limit of one run where the campaign states none: four times the largest known run."""


def _values(value: Any) -> Any:
    """Lists, ranges and arrays as tuples of plain values; raises ValueError for anything else."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ValueError("give a list of values, or label: value")
    return tuple(each.item() if hasattr(each, "item") else each for each in value)


def _drawn(value: Any) -> Any:
    """A range, or choices."""
    if isinstance(value, Span):
        return value
    return Span.model_validate(value) if isinstance(value, Mapping) else _values(value)


Values = Annotated[Any, BeforeValidator(_values)]
"""Values of a field: a tuple, or label -> value."""
Drawn = Annotated[Any, BeforeValidator(_drawn)]
"""A range of values, or a tuple of choices."""
KINDS = ("grid", "zip", "list", "random", "latin_hypercube")


class Span(Strict):
    """A range from which values are drawn.

    Attributes:
        low, high: its ends; scale: whether values are spread evenly, or evenly in their logarithm.
    """

    low: float
    high: float
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _rising(self) -> Span:
        if not self.low < self.high:
            raise ValueError("low must be less than high")
        if self.scale == "log" and self.low <= 0:
            raise ValueError("a logarithmic range starts above 0")
        return self


class Block(Strict):
    """One way to vary fields: one of grid, zip, list, random and latin_hypercube.

    Attributes:
        grid: path of a field -> values; every combination.
        zip: path -> values, as many for each; the first ones together, the second ones, ...
        list: mappings from path to value, one a combination.
        random, latin_hypercube: path -> range or list of choices; ``count`` combinations are drawn with ``seed``.
        count: how many combinations are drawn; seed: of the random numbers.
    """

    grid: Mapping[str, Values] | None = None
    zip: Mapping[str, Values] | None = None
    list_: tuple[Mapping[str, Any], ...] | None = Field(default=None, alias="list")
    random: Mapping[str, Drawn] | None = None
    latin_hypercube: Mapping[str, Drawn] | None = None
    count: Count | None = None
    seed: NotNegative = 0

    @model_validator(mode="after")
    def _one_kind(self) -> Block:
        given = [kind for kind in KINDS if self.of(kind) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of {', '.join(KINDS)}, not {' and '.join(given) or 'none'}")
        if not self.of(given[0]):
            raise ValueError(f"{given[0]} is empty")
        if (self.count is not None) != (given[0] in ("random", "latin_hypercube")):
            raise ValueError("random and latin_hypercube need count; the others have none")
        if given[0] == "list":
            return self
        if empty := [path for path, values in self.of(given[0]).items() if not isinstance(values, Span) and not values]:
            raise ValueError(f"{', '.join(empty)} has no values")
        lengths = {path: len(values) for path, values in (self.zip or {}).items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"zip needs as many values for each field, got {lengths}")
        return self

    def of(self, kind: str) -> Any:
        """The entry of a kind."""
        return getattr(self, "list_" if kind == "list" else kind)

    @property
    def kind(self) -> str:
        """Which of the KINDS it is."""
        return next(kind for kind in KINDS if self.of(kind) is not None)

    @property
    def paths(self) -> tuple[str, ...]:
        """The fields that it varies."""
        entries = self.list_ if self.list_ is not None else [self.of(self.kind)]
        return tuple(dict.fromkeys(path for entry in entries for path in entry))


class Noise(Strict):
    """Noise that is added to simulated data.

    Attributes:
        relative: standard deviation of the torque as a part of each joint's RMS torque, of a model of each output as a
            part of how far that deviates from its mean; std: in N.m or N, one a joint, or in its unit, one an output.
        coloured: part of its power that is a first-order autoregression with the memory ``memory_s``.
        memory_s: time in s after which the coloured part is correlated by 1/e.
        position_std: of simulated positions, in rad or m, for all joints; not where the case states ``std`` of them.
    """

    relative: Annotated[float, Field(ge=0)] | None = None
    std: tuple[Annotated[float, Field(ge=0)], ...] | None = None
    coloured: Annotated[float, Field(ge=0, le=1)] = 0.0
    memory_s: Positive = 0.05
    position_std: Annotated[float, Field(ge=0)] = 0.0

    @model_validator(mode="after")
    def _one_size(self) -> Noise:
        if self.relative is not None and self.std is not None:
            raise ValueError("give relative or std, not both")
        return self


class Limits(Strict):
    """Limits of one run.

    Attributes:
        time_s: wall-clock time; memory_mb: of its process, where the system can limit it.
        instances: FMU file, as the case names it -> most runs of one machine that use it at the same time, for licence
            servers.
    """

    time_s: Positive = TIME_LIMIT_S
    memory_mb: Positive = MEMORY_LIMIT_MB
    instances: Mapping[str, Annotated[int, Field(ge=1)]] = Field(default_factory=dict)


class Options(Strict):
    """Options of ``discover``.

    Attributes:
        forbid: effects that are never proposed; prefer: effects that are taken first where they fit.
        effects: further candidates, ``package.module:Name``; rounds: largest number of effects that are named.
    """

    forbid: tuple[str, ...] = ()
    prefer: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()
    rounds: Count = 5


class CampaignDocument(Strict):
    """A campaign file.

    Attributes:
        name: of the campaign, shown above its results; description: its purpose.
        case: the base case: its file, relative to the campaign, or its content.
        verb: what is done with every case.
        vary: path of a field of the case (``train.torque.rate_hz``, ``controller.source``, ``estimator.start``) -> its
            values, every combination; or several blocks, each with the others. A path that goes on below the name of a
            YAML file (``robot.joints.0.parameters.Fv``) changes a copy of it. Other paths begin with ``case``,
            ``truth.``, ``noise.``, ``options.`` or ``label.`` (a remark, which changes nothing).
        seeds: how many noise seeds, or which.
        truth: entries in which the simulated machine differs from the case, or the model, ``{model: {parameters: {R1:
            0.02}}}``; ``{}`` for none. Without ``truth`` and ``noise`` the data are those that the case names. Outputs
            of a model are simulated at the instants of its files.
        noise: of the simulated data.
        options: of ``discover``; limits: of a run.
        keep: whether all result files of every run are kept, its page and the tables of its torque among them.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    name: str
    description: str = ""
    case: str | dict[str, Any] | None = None
    verb: Literal["identify", "discover"] = "identify"
    vary: Annotated[tuple[Block, ...], AlsoWritten(("object",))] = ()
    seeds: Annotated[tuple[int, ...], AlsoWritten(("integer",))] = (0,)
    truth: dict[str, Any] | None = None
    noise: Noise | None = None
    options: Options = Options()
    limits: Limits = Limits()
    keep: bool = False

    @field_validator("vary", mode="before")
    @classmethod
    def _short_form(cls, value: Any) -> Any:
        """A mapping from path to values is one grid."""
        return (({"grid": value},) if value else ()) if isinstance(value, Mapping) else value

    @field_validator("seeds", mode="before")
    @classmethod
    def _counted(cls, value: Any) -> Any:
        """A number of seeds stands for 0, 1, ..."""
        return range(value) if isinstance(value, int) and not isinstance(value, bool) else value

    @field_validator("seeds")
    @classmethod
    def _distinct(cls, value: tuple[int, ...]) -> tuple[int, ...]:
        if twice := sorted({seed for seed in value if value.count(seed) > 1}):
            raise ValueError(f"{', '.join(map(str, twice))} is there twice: the same noise would count twice")
        if not value or min(value) < 0:
            raise ValueError("seeds are whole numbers from 0, at least one")
        return value

    @model_validator(mode="after")
    def _what_varies(self) -> CampaignDocument:
        paths = [path for block in self.vary for path in block.paths]
        if twice := sorted({path for path in paths if paths.count(path) > 1}):
            raise ValueError(f"vary: {', '.join(twice)} varies in two blocks")
        for i, block in enumerate(self.vary):
            beside = [path for k, other in enumerate(self.vary) if k != i for path in other.paths]
            for entry in block.list_ or [block.paths]:
                together = [*entry, *beside]
                if within := [(a, b) for a in together for b in together if b.startswith(f"{a}.")]:
                    whole, part = within[0]
                    raise ValueError(f"vary: {part} is part of {whole}, which varies as a whole")
        if self.case is None and "case" not in paths:
            raise ValueError("give case: (the base case), or vary it")
        if not self.is_simulated and len(self.seeds) > 1:
            raise ValueError("seeds: measured data have no noise seed, each run would be the same; give noise: {...}")
        return self

    @property
    def is_simulated(self) -> bool:
        """Whether the data are simulated."""
        roots = {path.partition(".")[0] for block in self.vary for path in block.paths}
        return self.truth is not None or self.noise is not None or bool({"truth", "noise"} & roots)
