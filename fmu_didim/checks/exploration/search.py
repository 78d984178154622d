"""What a search for other minima says of an answer."""

from __future__ import annotations

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.estimators.search.box import is_bounded
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.exploration.minima import FoundMinimum, SearchOutcome
from fmu_didim.model.loop_model import LoopModel

RARE = 0.1
"""[1] Share of the starts that end in the best minimum, below which as many starts again may well find a better one
that is as rare."""

MINIMA_ALIKE = CATALOGUE(
    "minima-alike", DOUBT, rank=12,
    meaning="Another minimum, with other values, explains the data as well as the answer does: they do not decide "
    "between them, and the intervals hold for one of them only.",
    next_step="Exclude it by bounds (minimum, maximum) if its values cannot be, or record data that tell them apart.",
)  # fmt: skip
BEST_IS_RARE = CATALOGUE(
    "best-minimum-rare", REMARK, rank=63,
    meaning="Few of the starts ended in the best minimum: a better one may have been missed.",
    next_step="Repeat with more starts (search: {starts: ...}), another seed or narrower bounds.",
)  # fmt: skip
NOT_SEARCHED = CATALOGUE(
    "nothing-searched", REMARK, rank=62,
    meaning="A search for other minima was asked for, but no parameter has bounds to search between: there was one "
    "start.",
    next_step="Give minimum: and maximum: of parameters under identify:.",
)  # fmt: skip


def unsearchable(model: LoopModel) -> list[Diagnostic]:
    """That a search would find no parameter with bounds."""
    if any(is_bounded(one) for one in model.free_parameters):
        return []
    text = "Nothing can be searched: no parameter has both a minimum and a maximum."
    return [Diagnostic(NOT_SEARCHED, text, "search")]


def search_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """What a search has found beside the answer; nothing where there was none."""
    search = estimate.search
    if search is None:
        return []
    if not search.searched:
        text = "Nothing was searched: no parameter has both a minimum and a maximum, so that there was one start."
        return [Diagnostic(NOT_SEARCHED, text, "search")]
    found = []
    if search.alike:
        close = search.minima[1 : 1 + search.alike]
        texts = "; ".join(f"{_values(one, search)} (chi-square higher by {one.worse:.2g})" for one in close)
        text = f"Other minima explain the data nearly as well: {texts}."
        found.append(Diagnostic(MINIMA_ALIKE, text, "search", close[0].worse, unit="chi-square"))
    best = search.minima[0]
    if search.method == "starts" and len(search.minima) > 1 and best.starts < max(2.0, RARE * search.starts):
        text = f"{best.starts} of {search.starts} starts ended in the best minimum, in {len(search.minima)} in all."
        share = best.starts / search.starts
        found.append(Diagnostic(BEST_IS_RARE, text, "search", share, RARE, "1"))
    return found


def _values(one: FoundMinimum, search: SearchOutcome) -> str:
    return ", ".join(f"{name} = {one.values[name]:.4g}" for name in search.searched)
