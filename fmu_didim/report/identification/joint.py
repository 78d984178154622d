"""What was fitted beside the torque: what each signal leaves, and both answers side by side."""

from __future__ import annotations

from fmu_didim.report import experiments
from fmu_didim.report.numbers import MISSING, pretty_unit, rounding, significant
from fmu_didim.report.sections import Block, Column, Section, Table, Text, note, numbers, words
from fmu_didim.results.result import JointResult, ResultDocument


def joint_sections(document: ResultDocument) -> list[Section]:
    """The signals beside the torque, and what they add; empty where the torque alone was fitted."""
    joint = document.joint
    if joint is None:
        return []
    found = joint.channels
    labels = [label for label in document.experiments if any(label in c.errors for c in found.values())]
    signals = [
        words("signal", list(found)),
        Column("samples", [str(c.samples) for c in found.values()]),
        *(
            numbers(f"RMS, {label}", [significant(c.errors[label], 2) if label in c.errors else MISSING
                                      for c in found.values()])
            for label in labels
        ),
        words("unit", [pretty_unit(c.unit) for c in found.values()]),
        numbers("noise σ", [significant(c.noise_std, 2) for c in found.values()]),
        words("noise", ["stated" if c.noise_is_stated else "by residual" for c in found.values()], shown="page"),
        Column("colour: σ ×", [f"{c.inflation:.1f}" for c in found.values()]),
    ]  # fmt: skip
    names = ", ".join(found)
    blocks: list[Block] = [
        Table(signals),
        note(
            "RMS: root mean square of measured − simulated. Colour: standard deviations that come from a signal over "
            "those of white noise; the signal counts as much less beside the torque."
        ),
        *_answers(document, joint),
    ]
    return [Section(f"Torque with {names}", blocks, anchor="joint", has_title=True)]


def _answers(document: ResultDocument, joint: JointResult) -> list[Block]:
    """Both answers side by side, where the torque alone gives one."""
    alone = joint.alone
    if alone is None:
        return [
            Text("The loop is open: the torque is given, and its error says nothing. The values come from the motion.")
        ]
    listed = [(name, p, alone.value[name], alone.std[name]) for name, p in document.parameters.items()]
    answers = [
        words("parameter", [name for name, *_ in listed]),
        numbers("torque alone", [rounding(value, std).text(value) for _, _, value, std in listed]),
        numbers("σ", [rounding(value, std).deviation(std) for _, _, value, std in listed]),
        numbers("joint", [rounding(p.value, p.std).text(p.value) for _, p, _, _ in listed]),
        numbers("σ joint", [rounding(p.value, p.std).deviation(p.std) for _, p, _, _ in listed]),
        Column("σ ratio", [f"{p.std / std:.2f}" if std else MISSING for _, p, _, std in listed]),
        Column("apart", [f"{joint.apart[name]:+.1f}" for name, *_ in listed]),
        words("unit", [experiments.shown_unit(p) or MISSING for _, p, _, _ in listed]),
    ]
    return [
        Table(answers),
        Text(f"Probability of both answers being as far apart by noise alone: {significant(joint.p_value, 2)}"),
        note(
            "Apart: joint minus torque alone, in standard deviations of that difference. Noise that feedback carries "
            "from one signal into the others is counted in all of them."
        ),
    ]
