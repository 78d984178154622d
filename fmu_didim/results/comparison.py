"""The saved comparison of two answers: ``compare.json``."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from fmu_didim.base.documents import Number, Saved
from fmu_didim.checks.judgement import RESTS_ON, DiagnosticResult, Verdict
from fmu_didim.results.saved import read_saved, write_saved

COMPARISON_FILE = "compare.json"
Change = Literal["unchanged", "named", "ambiguous", "unknown"]


class ComparedResult(Saved):
    """One of the two answers.

    Attributes:
        name: of its case; source: where it was read, empty where it was given as an object.
        verdict: on it; made: when, by ISO 8601; empty where its file does not say.
        files: name -> SHA-256 of what it was made of.
    """

    name: str
    source: str
    verdict: Verdict
    made: str
    samples: int = Field(description="of all torques that were fitted")
    files: dict[str, str]


class ChangedParameter(Saved):
    """A parameter before and after.

    Attributes:
        before, after: values; before_std, after_std: their standard deviations; all in the unit.
        unit: FMI unit string.
        change: after minus before; std: its standard deviation.
        interval: of the change, with those of all others at once 95 %.
        p_value: of as large a change by noise alone, adjusted for the number of parameters.
        moved: whether it changed beyond its joint interval, once all together have.
        least_seen: change of this parameter alone that would have been seen with a probability of 95 %.
    """

    unit: str
    before: float
    before_std: float
    after: float
    after_std: float
    change: float
    std: float
    interval: tuple[float, float]
    p_value: float
    moved: bool
    least_seen: float


class AmountResult(Saved):
    """A value of a cause.

    Attributes:
        name: such as mass, or of a parameter; unit: FMI unit string, 1 for a fraction.
        value, std: it and its standard deviation.
    """

    name: str
    value: float
    std: Number
    unit: str


class CausePart(Saved):
    """A cause.

    Attributes:
        kind: stable name: friction (of one joint), friction_everywhere (of all by one factor), friction_of_each,
            payload, joint_torque_scale, torque_scale or parameter; the name of an effect that is new or gone; grown:
            what both logs have and the model lacks.
        joint: whose, from 1; 0: of none.
        title: in words; amounts: how much.
        same_as: name of a parameter whose change alone is the same; empty without.
    """

    kind: str
    joint: int
    title: str
    amounts: list[AmountResult]
    same_as: str


class CauseResult(Saved):
    """One cause, or two together, and what they leave of the change.

    Attributes:
        parts: these; left: chi-square that they leave; freedom: values that are left.
        p_value: of as large a rest by noise alone; share: of the chi-square of the change that they explain.
        bic: criterion, above that of the best one.
        explains: whether what they leave is noise, or a small part of the change.
    """

    parts: list[CausePart]
    left: float
    freedom: int
    p_value: float
    share: float
    bic: float
    explains: bool


class ParameterSet(Saved):
    """Parameters whose change alone explains that of all.

    Attributes:
        names: of these; p_value: of what their change leaves.
    """

    names: list[str]
    p_value: float


class ResidualChange(Saved):
    """The residual of a joint before and after.

    Attributes:
        label: of the joint or output; unit: of its torque.
        before, after: standard deviations; p_value: of as large a ratio by noise alone.
        changed: whether that is too small, with the number of joints in mind.
    """

    label: str
    unit: str
    before: float
    after: float
    p_value: float
    changed: bool


class ComparisonDocument(Saved):
    """The content of ``compare.json``.

    Attributes:
        name: of the comparison.
        text: the answer in words.
        before, after: the two answers.
        parameters: name of each that is compared -> how it changed.
        left_out: name of each that is not -> why.
        chi_square: of all changes together; freedom: their number; samples: independent ones by which noise is known.
        p_value: of as large a difference by noise alone.
        causes: that explain the change, the best first; of several the data cannot tell which.
        others: causes that do not explain it, or not as well.
        sets: the smallest sets of parameters whose change alone explains it.
        residual: of each joint.
        remarks: that do not affect the verdict.
        files: written beside this file.
        provenance: versions and thresholds.
    """

    schema_version: Literal[1] = 1
    name: str
    answer: Change = Field(
        description="unchanged; named: by one cause; ambiguous: by several that the data cannot tell apart; unknown: "
        "changed, and no cause explains it"
    )
    text: str
    verdict: Verdict = Field(description="whether the answer may be used")
    reasons: list[DiagnosticResult] = Field(description="why the verdict is not valid, the most important first")
    conditions: list[str] = Field(default=[], description=RESTS_ON)
    before: ComparedResult
    after: ComparedResult
    parameters: dict[str, ChangedParameter]
    left_out: dict[str, str]
    chi_square: float
    freedom: int
    samples: Number = Field(description="null: known without limit")
    p_value: float
    causes: list[CauseResult]
    others: list[CauseResult]
    sets: list[ParameterSet]
    residual: list[ResidualChange]
    remarks: list[str]
    files: dict[str, str] = Field(default={})
    provenance: dict[str, Any]


def comparison_schema() -> dict[str, Any]:
    """JSON Schema of ``compare.json``."""
    return ComparisonDocument.model_json_schema()


def save_comparison(document: ComparisonDocument, folder: Path) -> Path:
    """Write ``compare.json``, in the place of an earlier one when all is written."""
    return write_saved(document, folder / COMPARISON_FILE)


def load_comparison(path: Path | str) -> ComparisonDocument:
    """Read ``compare.json`` or that of a folder; raises InputError if it is missing or damaged."""
    return read_saved(
        path, COMPARISON_FILE, ComparisonDocument, what="This is no saved comparison.",
        next_step="Give the folder that fmu-didim compare wrote; if its file is damaged, compare again.",
    )  # fmt: skip
