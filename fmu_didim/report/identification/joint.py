"""What was fitted beside the torque: what each signal leaves, and both answers side by side."""

from __future__ import annotations

from collections.abc import Sequence

from fmu_didim.report import experiments
from fmu_didim.report.numbers import MISSING, pretty_unit, rounding, significant
from fmu_didim.report.sections import Block, Column, Section, Table, Text, note, numbers, words
from fmu_didim.results.result import ChannelResult, JointResult, ResultDocument


def joint_sections(document: ResultDocument) -> list[Section]:
    """The signals beside the torque, their errors in each experiment, and what they add; empty where there are none."""
    joint, measured = document.joint, _measured(document)
    if not measured:
        return []
    fitted = joint.channels if joint is not None else {}
    labels = [label for label, e in document.experiments.items() if e.channels]
    found = [fitted.get(name) for name in measured]
    signals = [
        words("signal", list(measured)),
        Column("samples", [str(c.samples) if c is not None else MISSING for c in found]),
        *(column for label in labels for column in _errors(document, label, list(measured))),
        words("unit", [pretty_unit(unit) for unit in measured.values()]),
        numbers("noise σ", [significant(c.noise_std, 2) if c is not None else MISSING for c in found]),
        words("noise", [_origin(c) for c in found], shown="page"),
        Column("colour: σ ×", [f"{c.inflation:.1f}" if c is not None else MISSING for c in found]),
    ]
    blocks: list[Block] = [
        Table(signals),
        note(
            "RMS: root mean square of measured − simulated; %: of what the signal moves about its mean. Colour: "
            "standard deviations that come from a signal over those of white noise; the signal counts as much less "
            f"beside the {'others' if document.outputs else 'torque'}."
        ),
    ]
    if joint is None:
        blocks.append(Text("They were not fitted, but held out."))
    elif not document.outputs:
        blocks += _answers(document, joint)
    names = ", ".join(fitted or measured)
    title = f"Torque with {names}" if joint is not None else f"Held out: {names}"
    if document.outputs and joint is not None:
        title = f"At instants of their own: {names}"
    return [Section(title, blocks, anchor="further" if document.outputs else "joint", has_title=True)]


def _measured(document: ResultDocument) -> dict[str, str]:
    """Name of each signal beside the torque, the fitted ones first -> its unit."""
    fitted = document.joint.channels if document.joint is not None else {}
    found = {name: c.unit for name, c in fitted.items()}
    for experiment in document.experiments.values():
        found |= {name: c.unit for name, c in experiment.channels.items()}
    return found


def _errors(document: ResultDocument, label: str, names: Sequence[str]) -> list[Column]:
    """RMS of the signals in an experiment, and in per cent of what they move."""
    channels = document.experiments[label].channels
    own = [channels.get(name) for name in names]
    return [
        numbers(f"RMS, {label}", [significant(c.rms, 2) if c is not None else MISSING for c in own]),
        numbers(
            "%", [significant(c.relative_error_percent, 2) if c is not None else MISSING for c in own]
        ),
    ]  # fmt: skip


def _origin(channel: ChannelResult | None) -> str:
    """Where the noise of a signal comes from."""
    if channel is None:
        return "held out only"
    return "stated" if channel.noise_is_stated else "by residual"


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
