"""Which parameters matter: their effects at the answer or the start, and between their bounds."""

from __future__ import annotations

from fmu_didim.estimators.search.screening import GlobalSensitivity
from fmu_didim.fit.exploration.local import LocalSensitivity
from fmu_didim.report.drawing.sensitivity_charts import ordered
from fmu_didim.report.numbers import pretty_unit, significant
from fmu_didim.report.sections import Block, Items, Section, Table, note, numbers, words
from fmu_didim.report.terminal import table_lines, wrapped
from fmu_didim.results.result import ResultDocument
from fmu_didim.results.searches import global_result


def sensitivity_sections(document: ResultDocument) -> list[Section]:
    """What each parameter does to each output, and the ridges; empty where that is not known."""
    found = document.sensitivity
    if found is None:
        return []
    columns = [words("parameter", list(found.change))]
    for k, (output, unit) in enumerate(found.outputs.items()):
        texts = [significant(row[k], 2) for row in found.change.values()]
        columns.append(numbers(_head(output, unit), texts))
    blocks: list[Block] = [
        note("Root mean square of the change of each output by one per cent of a parameter, at the answer."),
        Table(columns, shown="page"),
        Items(
            [f"{one.text}." for one in found.ridges], shown="page",
            empty="No combination of parameters is much less known than each of them.",
        ),
    ]  # fmt: skip
    return [Section("What each parameter does", blocks, anchor="sensitivity")]


def _head(output: str, unit: str) -> str:
    shown = pretty_unit(unit)
    return f"{output} ({shown})" if shown else output


def local_lines(found: LocalSensitivity) -> list[str]:
    """The effects at the start and the ridges, for the terminal."""
    columns = [words("1 % of", found.names)]
    for k, (output, unit) in enumerate(zip(found.outputs, found.units, strict=True)):
        head = f"moves {output}" + (f" by ({pretty_unit(unit)})" if pretty_unit(unit) else "")
        columns.append(numbers(head, [significant(value, 2) for value in found.change[:, k]]))
    told = [line for one in found.ridges for line in wrapped(f"Ridge: {one.text}.", "", "  ")]
    return [*table_lines(Table(columns)), *told]


def global_lines(found: GlobalSensitivity) -> list[str]:
    """The sensitivities between the bounds, for the terminal."""
    saved = global_result(found)
    names, of_morris = ordered(saved), found.method == "morris"
    columns = [words("parameter", names)]
    for k, (output, unit) in enumerate(saved.outputs.items()):
        head = _head(output, unit) if of_morris else output
        main = [significant(saved.main[name][k], 2) for name in names]
        spread = [significant(saved.spread[name][k], 2) for name in names]
        total = [significant(saved.total[name][k], 2) for name in names]
        columns.append(numbers(f"{'mu*' if of_morris else 'S1'} {head}", main))
        if of_morris:
            columns.append(numbers("sigma", spread))
        else:
            columns += [numbers("ST", total), numbers("±", spread)]
    way = "trajectories of Morris" if of_morris else "base points of Sobol's sequence"
    text = f"Between the bounds, effect on the misfit ({found.samples} {way}, {found.simulations} simulations"
    text += f", {found.failed} failed" if found.failed else ""
    text += f"; held: {', '.join(found.held)}" if found.held else ""
    meaning = (
        "mu*: mean change of the RMS of measured minus simulated, per range of the parameter; sigma: its "
        "spread, by curvature and interactions"
        if of_morris
        else "S1: share of the variance of the RMS of measured minus simulated by the parameter alone; ST: with its "
        "interactions; ±: 95 %"
    )
    return [*wrapped(f"{text}):"), *table_lines(Table(columns)), *wrapped(f"{meaning}.")]
