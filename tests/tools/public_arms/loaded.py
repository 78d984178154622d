"""A measured arm without and with a load that was weighed: what ``compare`` says of the two logs, and the load.

    python -m tests.tools.public_arms.loaded FOLDER --figures docs/figures/measured_load.json

FOLDER holds the repository :data:`tests.tools.public_arms.cases.AIRBOT`; cases are written into its folder ``loaded``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fmu_didim import compare, identify
from fmu_didim.results.comparison import ComparisonDocument
from fmu_didim.results.result import ResultDocument
from tests.figures import command_of, table, write_figures
from tests.tools.public_arms import cases
from tests.tools.public_arms.__main__ import commit

SHOWN = 4
"""[causes] Of those tried alone, the best by the criterion."""


def texts(changed: ComparisonDocument, carried: ResultDocument) -> dict[str, str | list[str]]:
    """What the page shows."""
    alone = [cause for cause in (*changed.causes, *changed.others) if len(cause.parts) == 1]
    rows = [(cause.parts[0].title, f"{100 * cause.share:.1f} %") for cause in alone[:SHOWN]]
    assert carried.loads is not None
    mass = carried.loads["loaded"].body["mass"]
    assert mass.value is not None and mass.std is not None
    return {
        "causes": table(("cause, alone", "explains of the change"), rows), "answer": changed.answer,
        "verdict": changed.verdict, "mass": f"{mass.value:.2f} ± {mass.std:.2f} kg", "verdict_load": carried.verdict,
        "weighed": f"{cases.AIRBOT_LOAD:g} kg", "away": f"{abs(mass.value - cases.AIRBOT_LOAD) / mass.std:.1f}",
    }  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.public_arms.loaded", description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )  # fmt: skip
    parser.add_argument("folder", type=Path, help="with the repository")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    empty, loaded, both = cases.airbot(options.folder, options.folder / "loaded")
    changed = compare(empty, loaded)
    print(changed.summary())
    carried = identify(both)
    print(carried.summary())
    if options.figures:
        data: dict[str, Any] = {"commit": commit(options.folder / cases.AIRBOT), "text": changed.document.text}
        found = texts(changed.document, carried.document)
        write_figures(options.figures, command_of("tests.tools.public_arms.loaded", given), found, data=data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
