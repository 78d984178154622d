"""Essential parameters: which the data do not need, and the model without them."""

from __future__ import annotations

from fmu_didim.report import experiments
from fmu_didim.report.numbers import MISSING, rounding, significant
from fmu_didim.report.sections import Block, Section, Table, Text, note, numbers, words
from fmu_didim.results.result import ResultDocument
from fmu_didim.results.searches import EssentialResult, EssentialValueResult, RatioResult

ON_THESE_MOTIONS = (
    "They are not needed on these motions: on others they may be. σ of the reduced model is that of a machine that has "
    "none of them."
)


def essential_sections(document: ResultDocument) -> list[Section]:
    """What is left out, why, and the values of the others; empty where it was not asked for."""
    found = document.essential
    if found is None:
        return []
    blocks: list[Block] = [Text(line) for line in _lines(document, found)]
    listed = [(name, one) for name, one in found.parameters.items() if name in document.parameters]
    if listed:
        full = [document.parameters[name] for name, _ in listed]
        digits = [rounding(one.value, one.std) for _, one in listed]
        blocks.append(Table(
            [
                words("parameter", [name for name, _ in listed]),
                numbers("value", [d.text(one.value) for d, (_, one) in zip(digits, listed, strict=True)]),
                numbers("σ", [d.deviation(one.std) for d, (_, one) in zip(digits, listed, strict=True)]),
                numbers("full model", [rounding(p.value, p.std).text(p.value) for p in full]),
                numbers("σ there", [rounding(p.value, p.std).deviation(p.std) for p in full]),
                numbers("moved by, σ there", [_moved(one) for _, one in listed]),
                words("unit", [experiments.shown_unit(p) or MISSING for p in full]),
            ],
            shown="page",
        ))  # fmt: skip
    blocks.append(note(
        "F-test: zero is a value that the data do not exclude for all of them together, at 95 %, with the colour of "
        "the residual. The one with the largest σ / |value| goes first; the others are then fitted anew, and both "
        "models compared on what was held out."
    ))  # fmt: skip
    return [Section("Essential parameters", blocks, anchor="essential", has_title=True)]


def _lines(document: ResultDocument, found: EssentialResult) -> list[str]:
    told = []
    if found.left_out:
        told.append(
            f"Not needed by these data: {', '.join(found.left_out)} ({len(found.left_out)} of "
            f"{len(document.parameters)}). F of all together is {significant(found.f)}, below "
            f"{significant(found.limit)} (p = {significant(found.p_value, 2)})."
        )
        told.append(_held_out(found))
    elif not found.because:
        told.append("All are needed: the data exclude zero for each that could be left out.")
    if found.put_back:
        told.append(f"Needed after all: {', '.join(found.put_back)}; {found.because}.")
    elif found.because:
        told.append(f"Nothing was left out: {found.because}.")
    told += [f"{name} stays, though the data do not need it: {why}." for name, why in found.needed.items()]
    if unseen := _unseen(document, found):
        told.append(
            f"The description has values that these data exclude as little as zero: {'; '.join(unseen)}. A motion that "
            f"tells: fmu-didim excite CASE.yaml --only {','.join(text.partition(' ')[0] for text in unseen)}."
        )
    if found.left_out:
        if document.verdict != "valid":
            told.append(f"The full model is {document.verdict.replace('_', ' ')}, and so is this.")
        told.append(ON_THESE_MOTIONS)
    return told


def _moved(one: EssentialValueResult) -> str:
    return MISSING if one.moved is None else f"{one.moved:+.1f}"


def _held_out(found: EssentialResult) -> str:
    """What held-out data say of the reduced model."""
    ratio = found.held_out
    if ratio is None:
        return "No experiment is held out (validation:), so that the fitted data alone say so."
    text = f"Without them the held-out residual is {_ratio(ratio)} times that of the full model"
    joints = [(one.value or 0.0, j, one) for j, one in enumerate(found.held_out_joints, start=1)]
    if len(joints) > 1:
        _, j, most = max(joints, key=lambda one: one[0])
        text += f", of joint {j}, where it is most, {_ratio(most)}"
    return f"{text}." if found.confirmed else f"{text}: too few held-out data to say that it serves as well."


def _ratio(one: RatioResult) -> str:
    return f"{significant(one.value, 4)} ({significant(one.low, 4)} to {significant(one.high, 4)})"


def _unseen(document: ResultDocument, found: EssentialResult) -> list[str]:
    """Those that are left out, and that the description has at another value, within their interval and as far from
    zero as a standard deviation."""
    told = []
    for name in found.left_out:
        p = document.parameters[name]
        low, high = p.interval
        if p.described is not None and low <= p.described <= high and abs(p.described) >= p.std:
            told.append(f"{name} = {rounding(p.value, p.std).text(p.described)} {experiments.shown_unit(p)}")
    return told
