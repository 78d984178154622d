"""The saved result of a discovery: ``findings.json``; its models are the schema of the file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field, ValidationError

from fmu_didim.base.documents import Number, Saved, why_unread
from fmu_didim.base.errors import InputError
from fmu_didim.base.files import whole_file
from fmu_didim.checks.judgement import RESTS_ON, AcknowledgedResult, DiagnosticResult, Verdict
from fmu_didim.checks.power.statement import EXCLUDES, PowerResult

FINDINGS_FILE = "findings.json"
Answer = Literal["nothing", "named", "undecided", "named_with_remainder", "unknown", "disagreement", "unfinished"]
Side = Literal["", "input", "output", "parameter"]
"""Where something acts on a model alone: on an input, on what is shown of an output, or in the model; else empty."""
ANSWER_TEXT: dict[str, str] = {
    "nothing": "nothing that matters is missing in the model",
    "named": "the missing effects are named",
    "undecided": "something is missing, and several things explain these data equally well, so that none is named",
    "named_with_remainder": "effects are named, part of the gap remains",
    "unknown": "something is missing that no effect of the catalogue explains",
    "disagreement": "the experiments do not agree: what was held out is predicted far worse than what was fitted",
    "unfinished": "the search is not at its end: more or other effects may be missing",
}
UNTRIED_TEXT = "something is missing that no effect which could be tried explains"
"""Of an unknown answer where not all effects could be tried."""


class _Document(Saved):
    model_config = ConfigDict(populate_by_name=True)


class ValueFound(_Document):
    """A parameter with its 95 % interval.

    Attributes:
        name: with the number of the joint; unit: FMI unit string; value: estimate, in the unit.
        std: standard deviation; null where the data do not bound the value; interval: of 95 %, by Student's t.
    """

    name: str
    unit: str
    value: float
    std: Number
    interval: tuple[Number, Number]


class Rival(_Document):
    """Another effect that may stand for the same gap.

    Attributes:
        effect: its name in the catalogue; title: in words; joint: from 1, 0 on a model alone.
        side, signal: where it acts on a model alone.
        parameters: its values, of a model alone.
    """

    effect: str
    title: str
    joint: int
    bic_behind: Number = Field(description="BIC difference to the best; null: same class, not fitted on its own")
    side: Side = ""
    signal: str = ""
    parameters: list[ValueFound] = Field([], description="each fitted in the place of the others")


class GapPair(_Document):
    """Gap before and after, in units of the noise, over all joints and of each joint.

    Attributes:
        before, after: over all joints; null where the model cannot be simulated.
        before_per_joint, after_per_joint: of each joint.
    """

    before: Number
    after: Number
    before_per_joint: list[Number]
    after_per_joint: list[Number]


Rung = Literal["fit", "held_out", "load", "gain", "speed", "unit", "day"]
RungState = Literal["climbed", "contradicted", "open"]
LEVELS: dict[Rung, int] = {"fit": 1, "held_out": 2, "load": 3, "gain": 3, "speed": 3, "unit": 4, "day": 4}
"""Height of each rung of the evidence ladder."""


class RungEvidence(_Document):
    """What one experiment says of an effect.

    Attributes:
        experiment: its label.
        says: whether it is there; ``hardly excited`` and ``undecided`` say neither.
        excited: RMS of what only the effect can make there, in units of the noise; null where it is not known.
        size, interval: of the effect there as a multiple of the fitted one, and its 95 % interval.
        ratio, ratio_interval: RMS of the residual with the effect over that without it.
        differs: whether the size is another one than in the fit, beyond the standard deviations of both.
    """

    experiment: str
    says: Literal["yes", "no", "hardly excited", "undecided", "not run"]
    excited: Number = None
    size: Number = None
    interval: tuple[Number, Number] | None = None
    ratio: Number = None
    ratio_interval: tuple[Number, Number] | None = None
    differs: bool = False


class RungResult(_Document):
    """A rung of the evidence ladder of an effect.

    Attributes:
        level: from 1, the height; rung: what must differ from the fit: nothing (``fit``), the motion, of a held-out
            experiment (``held_out``), the load, the gains of the controller, the speed, the unit or the day.
        state: ``climbed``: the effect is there; ``contradicted``: these data show that it is not; ``open``: they do
            not tell.
        text: why, with the figures; next_step: what would climb it; empty where it is climbed.
        evidence: of the experiments that count for this rung.
    """

    level: int
    rung: Rung
    state: RungState
    text: str
    next_step: str = ""
    evidence: list[RungEvidence] = Field([])


EASIEST: tuple[Rung, ...] = ("held_out", "speed", "load", "gain", "day", "unit")
"""Rungs in the order in which they are climbed: of one height that which asks for least comes first."""


def next_rung(ladder: Sequence[RungResult]) -> RungResult | None:
    """The rung to be climbed next: one that is contradicted, else the easiest of the lowest height at which none is
    climbed; None where there is none."""
    against = [rung for rung in ladder if rung.state == "contradicted"]
    reached = {rung.level for rung in ladder if rung.state == "climbed"}
    left = sorted(
        (rung for rung in ladder if rung.level not in reached), key=lambda one: (one.level, EASIEST.index(one.rung))
    )
    return next(iter([*against, *left]), None)


class FindingResult(_Document):
    """One named effect.

    Attributes:
        effect: its name in the catalogue; title: in words; equation: in one line.
        class_: of effects that ordinary data cannot distinguish.
        place: where it acts: torque balance, controller, drive, sensor, structure or measurement.
        parameters: its amplitudes and shapes.
        share_of_gap: part of the squared gap of its joint that it closes.
        delta_bic: gain in BIC over the model without it.
        origin: which harmonic it is of the motor that the description states; empty where it is none, or where no motor
            is stated.
        part_of: of which other finding it may be a part, as a constant is of a spring that rests elsewhere than at
            zero, and where that rests then; empty if of none.
        ambiguous: effects that these data cannot distinguish from it; of a model alone, where there are any, all of
            them stand here, none is named and ``effect`` is ``undecided``.
        side, signal: where it acts on a model alone.
    """

    effect: str
    title: str
    class_: str = Field(alias="class")
    joint: int = Field(description="from 1; 1 also for what concerns the whole log; 0 on a model alone")
    place: str
    equation: str
    parameters: list[ValueFound]
    share_of_gap: float
    delta_bic: float
    ambiguous: list[Rival]
    experiment: str = Field(description="what would split it from the ambiguous ones")
    gap: dict[str, GapPair] = Field(description="by label of the experiment")
    ratio_interval: tuple[Number, Number] | None = Field(description="95 % interval of the held-out RMS ratio")
    channels: dict[str, dict[str, GapPair]] = Field(
        {}, description="label of the experiment -> signal beside the torque -> its gap"
    )
    side: Side = ""
    signal: str = ""
    origin: str = ""
    part_of: str = ""
    ladder: list[RungResult] = Field([], description="where it was seen, and where not yet; empty on a model alone")


class RegionResult(_Document):
    """A range in which the residual of the base model has a mean of its own.

    Attributes:
        joint: from 1; quantity: on which the residual depends, such as ``velocity``; unit: of low and high.
        low, high: range of the quantity; mean: of the residual there, in the unit of the torque of the joint.
        share_of_gap: part of the squared model error of the joint that the means of all bins of the quantity explain.
        p_value: probability of such a mean by noise alone.
    """

    joint: int
    quantity: str
    unit: str
    low: float
    high: float
    mean: float
    share_of_gap: float
    p_value: float


class WindowResult(_Document):
    """An interval of time with a torque from outside, or in which an output of a model alone is off.

    Attributes:
        joint: from 1, 0 of an output; signal: the output, empty of a joint.
        begin_s, end_s: on the clock of the reference; of an output, where half of the largest value is passed.
        begin_interval, end_interval: 95 % intervals of these, s, by what the model leaves elsewhere; None of a joint.
        score: mean of the residual there, in its standard deviations.
        experiment: label of the experiment.
    """

    joint: int
    signal: str = ""
    begin_s: float
    end_s: float
    begin_interval: tuple[float, float] | None = None
    end_interval: tuple[float, float] | None = None
    torque: float = Field(
        description="on the joint, positive along it; the drive must make up for it. Of an output: the most that is "
        "measured beyond the model, in its unit"
    )
    score: float
    experiment: str


class NoiseResult(_Document):
    """Noise of the torque log.

    Attributes:
        source: how it was found: ``periods`` that repeat, or the ``residual`` above the frequencies of the motion.
        std: standard deviation of each joint; correlation: of neighbouring samples, of each joint.
        period_s: length of the periods that were compared, null without; periods: their number.
    """

    source: str
    std: list[float]
    correlation: list[float]
    period_s: Number
    periods: int


class ChannelResult(_Document):
    """A signal that was measured beside the torque.

    Attributes:
        unit: SI; std: standard deviation of its noise; correlation: of neighbouring samples.
        gap: label of the experiment -> its gap with the base and with the final model.
    """

    unit: str
    std: float
    correlation: float
    gap: dict[str, GapPair]


class UnfinishedResult(_Document):
    """The state of an unfinished search.

    Attributes:
        text: why it ended; next_step: what to do about it.
    """

    code: str = Field(description="of the diagnostic")
    text: str
    next_step: str
    rounds: int = Field(description="that are complete")
    untried: list[tuple[str, int]] = Field(description="effect and joint of the candidates that were not tried")


class CandidateResult(_Document):
    """A shortlisted candidate and its outcome.

    Attributes:
        effect: its name in the catalogue; joint: from 1, 0 on a model alone; outcome: of its fit in the closed loop.
        side, signal: where it acts on a model alone.
    """

    round: int = Field(description="from 1")
    effect: str
    joint: int
    outcome: Literal["fitted", "left early", "cannot be simulated", "not tried"]
    delta_bic: Number = Field(description="over the model without it, where its fit ended")
    share_of_gap: Number = Field(None, description="part of the squared gap that it closes; null without a fit")
    parameters: Number = Field(None, description="that it counts as; null without a fit")
    implausible: str = Field("", description="why its values are not significant or not possible")
    accepted: bool = Field(False, description="whether it was added in this round")
    side: Side = ""
    signal: str = ""


class FrictionResult(_Document):
    """The friction of a joint as a function of its velocity alone.

    Attributes:
        joint: from 1; velocity: over the range of the motion; unit: of it.
        base, final: torque by the base and by the final model, in the unit of the torque of the joint.
    """

    joint: int
    unit: str
    velocity: list[float]
    base: list[float]
    final: list[float]
    half_width: list[float] = Field(description="of the 95 % interval of the final model's")


class CurveResult(_Document):
    """The form of what is missing on a joint and has no name: a torque that is a curve of one variable.

    Attributes:
        joint: from 1; effect: under which it can be listed in a robot description; title, variable: in words.
        unit: of the variable.
        at: (K,) values of the variable; torque: (K,) in the unit of the torque of the joint, less what the parameters
            of the model can make themselves.
        share_of_gap: part of the squared gap that it closes; delta_bic: gain in BIC over the model without it.
        rivals: other variables, each with the BIC by which it is behind, to first order.
        instead_of: effects and joints that were named and explain far less, so that the names were taken back.
    """

    joint: int
    effect: str
    title: str
    variable: str
    unit: str
    at: list[float]
    torque: list[float]
    half_width: list[float] = Field(description="of its 95 % interval")
    share_of_gap: float
    delta_bic: float
    rivals: list[tuple[str, float]]
    instead_of: list[tuple[str, int]]
    gap: dict[str, GapPair] = Field(description="by label of the experiment, without and with it")
    ratio_interval: tuple[Number, Number] | None = Field(description="95 % interval of the held-out RMS ratio")


class FindingsDocument(_Document):
    """The content of ``findings.json``; while the search goes on, the best answer so far.

    Attributes:
        name: of the case.
        findings: the effects that were named, in the order in which they were added.
        ratio_interval: 95 % interval of the RMS of final over base model on held-out data; null without.
        noise: of the torque logs; channels: name of each signal that counts beside the torque -> its noise and gap.
        regions: where the residual of the base model has a mean of its own.
        windows: intervals of time with a torque from outside, or in which an output of a model alone is off.
        base_parameters: the parameters of the base model in the final fit; base_fit: in the fit without the effects.
        curves: of what is missing and has no name.
        friction: of the joints where an effect was found that depends on their velocity alone.
        torque_unit: FMI unit string of the torque of each joint, or of each output that is measured at the same
            instants; outputs: their names, where a model alone stands in the place of a robot.
        seconds: that the search took.
        notes: on data and search.
        provenance: versions, digests of all files and code that were read, options, thresholds, catalogue and loop.
    """

    schema_version: Literal[4] = 4
    name: str
    answer: Answer = Field(description="what the model lacks")
    text: str = Field(description="the answer in words")
    verdict: Verdict = Field(description="whether the answer and the values of the final model may be used")
    reasons: list[DiagnosticResult] = Field(description="why the verdict is not valid, the most important first")
    acknowledged: list[AcknowledgedResult] = Field(
        default=[], description="doubts that the case acknowledges: they are no reasons"
    )
    conditions: list[str] = Field(default=[], description=RESTS_ON)
    unfinished: UnfinishedResult | None = Field(None, description="null where the search came to its end")
    findings: list[FindingResult]
    roles: dict[str, Literal["estimation", "validation"]] = Field(description="of the experiments, by label")
    gap: dict[str, GapPair] = Field(description="base model and final model, by label of the experiment")
    error_percent: dict[str, tuple[Number, Number]] = Field(description="relative torque error before and after")
    ratio_interval: tuple[Number, Number] | None
    noise: NoiseResult
    channels: dict[str, ChannelResult] = Field({})
    regions: list[RegionResult]
    windows: list[WindowResult]
    refused: list[tuple[str, int, str]] = Field(description="effect, joint, why it was not accepted")
    candidates: list[CandidateResult] = Field([], description="of each round")
    base_parameters: list[ValueFound]
    base_fit: list[ValueFound] = Field([])
    regrouping: list[str] = Field([], description="of the base parameters: relations such as ZZ1R = ZZ1 + Ia1")
    friction: list[FrictionResult] = Field([])
    curves: list[CurveResult] = Field([])
    torque_unit: list[str]
    outputs: list[str] = Field([])
    seconds: float
    notes: list[str]
    power: PowerResult | None = Field(default=None, description=EXCLUDES)
    files: dict[str, str] = Field(description="written beside this file")
    provenance: dict[str, Any]


def findings_schema() -> dict[str, Any]:
    """JSON Schema of ``findings.json``."""
    return FindingsDocument.model_json_schema(by_alias=True)


def save_findings(document: FindingsDocument, folder: Path) -> Path:
    """Write ``findings.json``, in the place of an earlier one when all is written."""
    path = folder / FINDINGS_FILE
    with whole_file(path) as temporary:
        temporary.write_text(document.model_dump_json(indent=1, by_alias=True), encoding="utf-8")
    return path


def load_findings(path: Path | str) -> FindingsDocument:
    """Read ``findings.json`` or that of a folder; raises InputError if it is missing or damaged."""
    path = Path(path)
    path = path / FINDINGS_FILE if path.is_dir() else path
    try:
        return FindingsDocument.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, ValidationError) as error:
        raise InputError(
            "This is no saved discovery.", where=str(path), got=why_unread(error, FindingsDocument),
            next_step="Give the folder that fmu-didim discover wrote; if its file is damaged, run the discovery again.",
        ) from error  # fmt: skip
