"""What a case says of its search for other minima."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from fmu_didim.base.documents import NotNegative, Positive, Strict


class Search(Strict):
    """Where one start is not enough: local fits from many starts, or a global search inside the bounds.

    Only parameters that have ``minimum`` and ``maximum`` are searched; the others begin where one start has them.

    Attributes:
        method: ``starts``: the estimator runs from the start of the case and from others, by a Latin hypercube between
            the bounds (of the logarithms where both are positive and a decade or more apart).
            ``differential_evolution``: that search of SciPy, whose best is refined by the estimator. ``cmaes``: CMA-ES
            with restarts in its place, by the package of this name (extra ``cmaes``).
        starts: local fits in all, that from the start of the case among them.
        evaluations: simulations of all experiments at most, of a global search.
        seed: of the draws.
        time_s: after this time no further start begins, and no further generation, s.
        processes: child processes at the same time; by default one a core where there is enough to do.
    """

    method: Literal["starts", "differential_evolution", "cmaes"] = "starts"
    starts: Annotated[int, Field(ge=2)] = 20
    evaluations: Annotated[int, Field(ge=10)] = 2000
    seed: NotNegative = 0
    time_s: Positive | None = None
    processes: Annotated[int, Field(ge=1)] | None = None
