"""Other minima: where the starts of a search ended."""

from __future__ import annotations

from fmu_didim.report.numbers import MISSING, pretty_unit, rounding, significant
from fmu_didim.report.sections import Block, Column, Section, Table, Text, note, numbers, words
from fmu_didim.results.result import ResultDocument
from fmu_didim.results.searches import MinimumResult, SearchResult

MOST_SHOWN = 8
"""[minima] On the terminal; the page has all."""


def search_sections(document: ResultDocument) -> list[Section]:
    """The minima that a search has found; empty where there was none."""
    search = document.search
    if search is None:
        return []
    if not search.searched:
        text = "Nothing was searched: no parameter has both a minimum and a maximum. There was one start."
        return [Section("Search for other minima", [Text(text)], anchor="search", has_title=True)]
    blocks: list[Block] = [
        Text(_how(search)),
        _table(search.minima[:MOST_SHOWN], document, "terminal"),
        Text(f"{len(search.minima) - MOST_SHOWN} more in the report" if len(search.minima) > MOST_SHOWN else "",
             shown="terminal"),
        _table(search.minima, document, "page"),
        Text("; ".join(f"{count} failed: {why}" for why, count in search.failures.items())),
        note(
            "Chi-square: misfit above that of the best minimum, in squares of the noise. Below about 10 the data do "
            "not exclude the other values. Starts: how many local fits ended there."
        ),
    ]  # fmt: skip
    return [Section("Search for other minima", blocks, anchor="search", has_title=True)]


def _how(search: SearchResult) -> str:
    """The search in words."""
    names = ", ".join(search.searched)
    if search.method == "starts":
        text = f"{search.starts} starts between the bounds of {names} (seed {search.seed})"
    else:
        method = {"cmaes": "CMA-ES"}.get(search.method, search.method.replace("_", " "))
        text = f"{method} between the bounds of {names} (seed {search.seed}): {search.evaluations} simulations"
    text += f"; it ended early: {search.stopped}" if search.stopped else ""
    text += f"; without bounds, and so not searched: {', '.join(search.held)}" if search.held else ""
    return f"{text}."


def _table(minima: list[MinimumResult], document: ResultDocument, place: str) -> Table:
    names = list(minima[0].value) if minima else []
    columns = [
        words("minimum", [str(k + 1) + ("" if one.settled else ", not settled") for k, one in enumerate(minima)])
    ]
    for name in names:
        unit = pretty_unit(document.parameters[name].unit) if name in document.parameters else ""
        texts = []
        for one in minima:
            value, std = one.value.get(name), one.std.get(name)
            texts.append(MISSING if value is None else rounding(value, std or 0.0).text(value))
        columns.append(numbers(f"{name} ({unit})" if unit else name, texts))
    columns += [
        numbers("error %", [significant(one.error_percent) for one in minima]),
        numbers("chi-square", [f"+{significant(one.worse, 2)}" if k else "best" for k, one in enumerate(minima)]),
        Column("starts", [str(one.starts) for one in minima]),
    ]
    return Table(columns, shown=place, chosen=[0] if minima else [])  # type: ignore[arg-type]
