"""The form of what is missing and has no name, in a report: a curve with its band, and what it explains."""

from __future__ import annotations

import numpy as np

from fmu_didim.report.discovery import texts
from fmu_didim.report.drawing.charts import Chart, Panel, Series
from fmu_didim.report.numbers import joint_unit, pretty_unit, significant
from fmu_didim.report.sections import Block, Charts, Fact, Facts, Section, Table, note, numbers
from fmu_didim.results.findings import CurveResult, FindingsDocument

HEIGHT = 240
"""[px] Of a chart."""
LISTED = 9
"""[points] Of a curve that the terminal shows."""
WHAT_IT_IS = (
    "A sum of cubic splines of one variable, fitted in the closed loop beside the parameters of the model; what these "
    "can make themselves, such as gravity in a curve of the position, is not in it. The band is its 95 % interval by "
    "the noise, what remains beside it and what is smoothed; what is narrower than a seventeenth of the range is lost."
)


def curve_sections(document: FindingsDocument) -> list[Section]:
    """Each curve of a discovery."""
    return [_section(document, curve) for curve in document.curves]


def curve_words(curve: CurveResult) -> str:
    """Joint and variable of a curve."""
    return f"joint {curve.joint}: a curve of {curve.variable}"


def _section(document: FindingsDocument, curve: CurveResult) -> Section:
    facts = [Fact("share of the gap", texts.share_text(curve.share_of_gap))]
    for label, pair in curve.gap.items():
        facts.append(Fact(f"gap, {texts.experiment_name(document, label)}", texts.step_text(pair)))
    if curve.ratio_interval is not None:
        interval = texts.interval_text(curve.ratio_interval)
        facts.append(Fact("held-out RMS", f"{interval} of what it was, 95 % interval"))
    facts.append(Fact("gain in BIC", significant(curve.delta_bic)))
    others = [f"{variable} ({significant(behind)} behind)" for variable, behind in curve.rivals]
    facts.append(Fact("curves of something else", "; ".join(others) or "none was tried"))
    if curve.instead_of:
        names = ", ".join(f"{effect.replace('_', ' ')}, joint {joint}" for effect, joint in curve.instead_of)
        facts.append(Fact("names taken back", f"{names}: they explain far less"))
    facts.append(Fact("as an effect", f"{curve.effect}, in the robot description of the curve (Files)"))
    unit, at = joint_unit(document.torque_unit, curve.joint - 1), np.array(curve.at)
    series = [Series("missing torque, 95 %", at, np.array(curve.torque), "final", band=np.array(curve.half_width))]
    title = f"What is missing on joint {curve.joint} over {curve.variable}"
    panel = Panel(f"torque ({unit})", series, f"Joint {curve.joint}", HEIGHT)
    chart = Chart(f"curve-{curve.joint}", title, [panel], f"{curve.variable} ({pretty_unit(curve.unit)})")
    shown = np.linspace(0, at.size - 1, LISTED).round().astype(int)
    table = Table([
        numbers(f"{curve.variable} ({pretty_unit(curve.unit)})", [significant(curve.at[k]) for k in shown]),
        numbers(f"torque ({unit})", [significant(curve.torque[k]) for k in shown]),
        numbers("± 95 %", [significant(curve.half_width[k], 2) for k in shown]),
    ], shown="terminal")  # fmt: skip
    heading = f"The form of what has no name, {curve_words(curve)}"
    blocks: list[Block] = [Facts(facts), table, Charts([chart]), note(WHAT_IT_IS)]
    return Section(heading, blocks, anchor=f"curve-{curve.joint}", has_title=True)
