"""The measured log of a TX40, with a model that lacks the coupling of the wrist, looked through as its user would.

    python -m tests.tools.public_arms.discovered FOLDER --figures docs/figures/measured_tx40.json

FOLDER holds the repository :data:`tests.tools.public_arms.cases.TX40`; the case is written into its folder
``discovered``. The model that was found is identified once more, its shapes held, as its user would. Seconds are of
the whole ``discover``, without anything cached where ``--anew`` is given.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fmu_didim import identify
from fmu_didim.results.findings import FindingsDocument
from tests.figures import command_of, table, write_figures
from tests.tools.benchmarks.command_start import command
from tests.tools.public_arms import cases
from tests.tools.public_arms.__main__ import commit

ONE = "1"
"""The unit of what has none."""
HEADS = ("named", "found", "share of the gap")


def texts(
    document: FindingsDocument, seconds: float, cpu_s: float, identified: Sequence[float | None]
) -> dict[str, Any]:
    """What the page shows."""
    rows = [
        (
            f"{finding.title}, joint {finding.joint}",
            ", ".join(
                f"{p.name} = {p.value:.3g} ± {p.std:.2g} {p.unit.removeprefix(ONE)}".strip() for p in finding.parameters
            ),
            f"{100 * finding.share_of_gap:.0f} %",
        )
        for finding in document.findings
    ]
    errors = {key: f"{first:.1f} % to {last:.2f} %" for key, (first, last) in document.error_percent.items()}
    return {
        "table": table(HEADS, rows), "verdict": document.verdict, **errors, "first": rows[0][0] if rows else "nothing",
        "identified": " and ".join(f"{error or 0.0:.2f} %" for error in identified), "seconds": f"{seconds:.0f} s",
        "cpu": f"{cpu_s:.0f} s",
    }  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.public_arms.discovered", description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )  # fmt: skip
    parser.add_argument("folder", type=Path, help="with the repository")
    parser.add_argument("--anew", action="store_true", help="build what is kept from runs before once more")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    out = options.folder / "discovered"
    case = cases.tx40_without_wrist(options.folder, out)
    with tempfile.TemporaryDirectory() as cache:
        kept = {"FMU_DIDIM_CACHE": cache} if options.anew else {}
        shutil.rmtree(out / "result", ignore_errors=True)
        began, before = time.perf_counter(), os.times()
        subprocess.run(
            [*command(), "discover", str(case), "--out", str(out / "result")], env={**os.environ, **kept}, check=False
        )
        seconds, after = time.perf_counter() - began, os.times()
    cpu_s = sum(after[2:4]) - sum(before[2:4])
    document = FindingsDocument.model_validate_json((out / "result/findings.json").read_text(encoding="utf-8"))
    errors = identify(out / "result/case_augmented.yaml").document.relative_error_percent
    found = texts(document, seconds, cpu_s, [errors[run].total for run in ("estimation", "validation")])
    print("\n".join([*found["table"], *(f"{key}: {value}" for key, value in found.items() if key != "table")]))
    if options.figures:
        data = {"commit": commit(options.folder / cases.TX40), "findings": document.model_dump(mode="json")["findings"]}
        write_figures(options.figures, command_of("tests.tools.public_arms.discovered", given), found, data=data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
