"""A prior beside the data: what of each value comes from where."""

from __future__ import annotations

from fmu_didim.report import experiments
from fmu_didim.report.numbers import MISSING, rounding, significant
from fmu_didim.report.sections import Block, Column, Section, Table, Text, note, numbers, words
from fmu_didim.results.result import PriorParameterResult, ResultDocument


def share_text(found: PriorParameterResult) -> str:
    """The part of a value that comes from the data, in percent."""
    return f"{100 * found.data_share:.0f}"


def prior_sections(document: ResultDocument) -> list[Section]:
    """Prior, data and both side by side; empty where there is no prior."""
    prior = document.prior
    if prior is None:
        return []
    listed = [(name, document.parameters[name], found) for name, found in prior.parameters.items()]
    columns = [
        words("parameter", [name for name, *_ in listed]),
        numbers("prior", [_value(f.prior, f.prior_std) for *_, f in listed]),
        numbers("σ prior", [_deviation(f.prior, f.prior_std) for *_, f in listed]),
        numbers("data alone", [_value(f.alone, f.alone_std) for *_, f in listed]),
        numbers("σ data", [_deviation(f.alone, f.alone_std) for *_, f in listed]),
        numbers("both", [rounding(p.value, p.std).text(p.value) for _, p, _ in listed]),
        numbers("σ", [rounding(p.value, p.std).deviation(p.std) for _, p, _ in listed]),
        Column("data %", [share_text(f) for *_, f in listed], page_head="from the data (%)"),
        numbers("apart", [MISSING if f.apart is None else f"{f.apart:+.1f}" for *_, f in listed]),
        words("unit", [experiments.shown_unit(p) or MISSING for _, p, _ in listed]),
    ]
    blocks: list[Block] = [
        Table(columns),
        Text(f"Probability of data and prior being as far apart by chance: {significant(prior.p_value, 2)}"),
        note(
            "Data %: part of the variance of a value that comes from the noise of the log; the rest comes from the "
            "prior. For a single parameter it is the weight of the data in the value. Data alone: one step from the "
            "values of both, without limits; none where the data do not tell a parameter from others. Together both "
            "know more than each. Apart: value minus prior, in standard deviations of that difference."
        ),
    ]
    return [Section(f"Data beside {prior.source}", blocks, anchor="prior", has_title=True)]


def _value(value: float | None, std: float | None) -> str:
    return MISSING if value is None or std is None else rounding(value, std).text(value)


def _deviation(value: float | None, std: float | None) -> str:
    return MISSING if value is None or std is None else rounding(value, std).deviation(std)
