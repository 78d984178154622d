"""A measured arm, cold and warm: whether its friction follows the temperatures that its logs have.

    python -m tests.tools.public_arms.warmed FOLDER --figures docs/figures/measured_temperatures.json

FOLDER holds the folder :data:`tests.tools.public_arms.cases.KINOVA`, and in it the URDF and the logs that
:func:`tests.tools.public_arms.cases.kinova` names, from the history of that repository; the case is written into its
folder ``warmed``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from fmu_didim import identify
from fmu_didim.results.result import ParameterResult, ResultDocument
from tests.figures import command_of, table, write_figures
from tests.tools.public_arms import cases

SURELY = 3.0
"""[standard deviations] From zero, from which a change with the temperature is one."""


def texts(found: ResultDocument, warmest: Sequence[tuple[float, float]]) -> dict[str, str | list[str]]:
    """What the page shows.

    Args:
        warmest: least and highest temperature of each joint, degC.
    """
    rows, sure = [], {"FvK": 0, "FcK": 0}
    for j, (low, high) in enumerate(warmest, start=1):
        own = {name: found.parameters[f"{name}{j}"] for name in ("Fv", "FvK", "Fc", "FcK")}
        for name in sure:
            sure[name] += abs(own[name].value) > SURELY * (own[name].std or float("inf"))
        rows.append((f"{j}", f"{low:.0f} to {high:.0f} °C", *map(_with_sigma, own.values())))
    titles = ("joint", "temperature", "viscous, at 20 °C", "a kelvin more", "dry, at 20 °C", "a kelvin more")
    return {
        "table": table(titles, rows), "verdict": found.verdict, "viscous": str(sure["FvK"]), "dry": str(sure["FcK"]),
        "joints": str(len(warmest)), "runs": str(len(found.experiments)),
        "reasons": ", ".join(dict.fromkeys(reason.code for reason in found.reasons)),
    }  # fmt: skip


def _with_sigma(value: ParameterResult) -> str:
    return f"{value.value:.3f} ± {value.std or float('nan'):.3f}"


def temperatures(folder: Path) -> list[tuple[float, float]]:
    """The least and the highest temperature of each joint over the runs, degC."""
    logs = [folder / cases.KINOVA / f"{log}.csv" for log in cases.KINOVA_RUNS.values()]
    tables = [cases.columns_of(log, [f"Temp{j}" for j in range(1, 8)]) for log in logs]
    return [
        (min(float(one[:, j].min()) for one in tables), max(float(one[:, j].max()) for one in tables)) for j in range(7)
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.public_arms.warmed", description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )  # fmt: skip
    parser.add_argument("folder", type=Path, help="with the logs")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    outcome = identify(cases.kinova(options.folder, options.folder / "warmed"))
    print(outcome.summary())
    if options.figures:
        found = texts(outcome.document, temperatures(options.folder))
        data = {"reasons": [reason.code for reason in outcome.document.reasons]}
        write_figures(options.figures, command_of("tests.tools.public_arms.warmed", given), found, data=data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
