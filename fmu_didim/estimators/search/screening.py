"""Which parameters matter between their bounds: screening by Morris, shares of the variance by Sobol, by SALib.

    morris: mu* = mean |change of the misfit of an output by a step of a parameter|, sigma = spread of these changes
    sobol:  S1 = share of its variance by the parameter alone, ST = with all its interactions

The misfit of an output is the root mean square of measured minus simulated. Sources: M. D. Morris, Technometrics 33(2),
1991; A. Saltelli et al., Comput. Phys. Commun. 181(2), 2010; J. Herman, W. Usher, "SALib", JOSS 2(9), 2017.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fmu_didim.base.errors import InputError, SimulationError, loading
from fmu_didim.data.signals import Array
from fmu_didim.estimators.search.box import Box
from fmu_didim.estimators.search.crew import Crew
from fmu_didim.fit.exploration.local import output_names
from fmu_didim.model.loop_model import LoopModel

Method = Literal["morris", "sobol"]
SAMPLES = {"morris": 20, "sobol": 64}
"""[1] Trajectories of Morris, and base points of Sobol's sequence, where none are asked for: an order of parameters,
and shares to about a tenth."""
LEVELS = 4
"""[levels] Of the grid of Morris: his own."""
NOTHING = 0.01
"""[1] Effect, of the largest (mu*), or total share (ST) below which a parameter does nothing between its bounds."""


@dataclass(frozen=True)
class GlobalSensitivity:
    """The effects of parameters between their bounds.

    Attributes:
        method: of the two; samples: trajectories, or base points; simulations: that it took; failed: of these.
        names: (d,) of the parameters with bounds; held: of the others.
        outputs, units: (m,); main, total, spread: (d, m): ``morris``: mu* twice and sigma, in the unit; ``sobol``: S1,
            ST and the half-width of the 95 % interval of ST.
    """

    method: Method
    samples: int
    simulations: int
    failed: int
    names: tuple[str, ...]
    held: tuple[str, ...]
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    main: Array
    total: Array
    spread: Array

    @property
    def idle(self) -> tuple[str, ...]:
        """Parameters that do nothing to any output between their bounds."""
        most = np.maximum(self.total.max(axis=0), np.finfo(float).tiny) if self.method == "morris" else 1.0
        return tuple(n for n, row in zip(self.names, self.total / most, strict=True) if (row < NOTHING).all())


def screened(
    model: LoopModel,
    begin: Array,
    method: Method,
    crew: Crew,
    *,
    samples: int | None = None,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
) -> GlobalSensitivity:
    """The effects of the parameters that have bounds, the others held at ``begin`` (p,).

    Args:
        samples: by default as SAMPLES; say: told how many simulations it takes.

    Raises:
        InputError: SALib is not installed, or no parameter has bounds; SimulationError: hardly any values can be
            simulated.
    """
    box = Box.of(model.free_parameters, begin)
    if not box.place.size:
        raise InputError(
            "Global sensitivities need bounds.", where="identify", got="no parameter with minimum and maximum",
            next_step="Give minimum: and maximum: of parameters under identify:.",
        )  # fmt: skip
    absent = InputError(
        "Global sensitivities need SALib.", next_step="Install it: pip install 'fmu_didim[sensitivity]'."
    )
    with loading("SALib", absent=absent):
        from SALib.analyze import morris as of_morris
        from SALib.analyze import sobol as of_sobol
        from SALib.sample import morris as by_morris
        from SALib.sample import sobol as by_sobol
    names, count = tuple(model.names[i] for i in box.place), samples or SAMPLES[method]
    problem: dict[str, Any] = {"num_vars": len(names), "names": list(names), "bounds": [[0.0, 1.0]] * len(names)}
    if method == "morris":
        units, block = by_morris.sample(problem, count, num_levels=LEVELS, seed=seed), len(names) + 1
    else:
        count = 1 << max(count - 1, 1).bit_length()  # a power of two, as the sequence needs it
        units, block = by_sobol.sample(problem, count, calc_second_order=False, seed=seed), len(names) + 2
    say(f"{method}: {len(units)} simulations")
    found = crew.squares([box.point(unit) for unit in units])
    errors = np.array([np.full(model.output_counts.size, np.nan) if one is None else one for one in found])
    errors = np.sqrt(errors / model.output_counts)
    kept = np.repeat(np.isfinite(errors).all(axis=1).reshape(-1, block).all(axis=1), block)
    if kept.sum() < 2 * block:
        raise SimulationError(
            "Hardly any values between the bounds can be simulated.", where="identify",
            got=f"{int(np.isfinite(errors).all(axis=1).sum())} of {len(units)}", next_step="Give narrower bounds.",
        )  # fmt: skip
    tables = []
    for error in errors[kept].T:
        if method == "morris":
            one = of_morris.analyze(problem, units[kept], error, num_levels=LEVELS, seed=seed)
            tables.append((one["mu_star"], one["mu_star"], one["sigma"]))
        else:
            one = of_sobol.analyze(problem, error, calc_second_order=False, seed=seed)
            tables.append((one["S1"], one["ST"], one["ST_conf"]))
    main, total, spread = (np.nan_to_num(np.array(part, dtype=float)).T for part in zip(*tables, strict=True))
    held = tuple(name for i, name in enumerate(model.names) if i not in box.place)
    failed = int((~np.isfinite(errors).all(axis=1)).sum())
    return GlobalSensitivity(
        method, count, len(units), failed, names, held, *output_names(model), main, total, spread
    )  # fmt: skip
