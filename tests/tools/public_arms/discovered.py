"""The measured log of a TX40, with a model that lacks the coupling of the wrist, looked through as its user would.

    python -m tests.tools.public_arms.discovered FOLDER --figures docs/figures/measured_tx40.json

FOLDER holds the repository :data:`tests.tools.public_arms.cases.TX40`; the case is written into its folder
``discovered``. The model that was found is identified once more, its shapes held, as its user would. Seconds are of
the whole ``discover``, without anything cached where ``--anew`` is given.

What limits the held-out error is asked of the same model: without the values that the data do not need, fitted to the
held-out run itself, what noise like that of the fit and the covariance of the values would make, and by least squares
along filtered motions, whose values are judged in the same loop. Nothing is chosen by these.
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

import numpy as np
import yaml

from fmu_didim import Result, identify, load_case
from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.statistics import relative_error_percent
from fmu_didim.results.findings import FindingsDocument
from tests.figures import command_of, table, write_figures
from tests.tools.benchmarks.command_start import command
from tests.tools.public_arms import cases
from tests.tools.public_arms.__main__ import commit

ONE = "1"
"""The unit of what has none."""
HEADS = ("named", "found", "share of the gap")
RUNS = ("estimation", "validation")
CUTOFFS_HZ = (None, 20, 10)
"""[Hz] Of the motion and the torque of least squares."""
LIMITS = ("the same model", "fitted", "held out")


def texts(
    document: FindingsDocument, seconds: float, cpu_s: float, limits: Sequence[tuple[str, float, float]]
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
        "identified": " and ".join(f"{error:.2f} %" for error in limits[0][1:]), "seconds": f"{seconds:.0f} s",
        "cpu": f"{cpu_s:.0f} s", "rerun": next((n for n in document.notes if "FMU" in n), ""),
        "limits": table(LIMITS, [(words, f"{one:.2f} %", f"{other:.2f} %") for words, one, other in limits]),
    }  # fmt: skip


def errors(result: Result) -> tuple[float, float]:
    """Errors of the torque in the fitted and in the held-out run, per cent."""
    found = [float(result.validation(run).total_percent) for run in RUNS]
    return found[0], found[1]


def limits_of(case: Path) -> list[tuple[str, float, float]]:
    """What the model that was found, and other fits of it, leave of the torque, per cent: in words, of the fitted run
    and of the held-out one."""
    content = yaml.safe_load(case.read_text(encoding="utf-8"))
    result = identify(case, essential=True)
    rows = [(f"identified, {result.estimate.value.size} values", *errors(result))]
    rows.append(("what noise as in the fit, and the uncertainty of the values, make", *by_chance(result)))
    essential = result.document.essential
    assert essential is not None and essential.held_out is not None
    without = essential.error_percent or 0.0, rows[0][2] * (essential.held_out.value or 0.0)
    rows.append((f"without the {len(essential.left_out)} values that the data do not need", *without))
    swapped = {**content, "train": content["validation"], "validation": content["train"]}
    rows.append(("fitted to the held-out run, held out the fitted one", *errors(identify(_beside(case, swapped)))))
    model = load_case(case).model
    raw = {run: {**content[run], "torque": _as_recorded(content[run]["torque"])} for run in ("train", "validation")}
    for cutoff_hz in CUTOFFS_HZ:
        estimator = {"kind": "idim_ls", "decimation": 1, **({"cutoff_hz": cutoff_hz} if cutoff_hz else {})}
        found = identify(_beside(case, {**content, **raw, "estimator": estimator})).estimate
        values = dict(zip(found.model.names, found.value, strict=True))
        own = np.array([values[name] for name in model.names])
        behind = f"behind {cutoff_hz} Hz" if cutoff_hz else "unfiltered"
        torques = [(model.experiments[run].torque, model.torque(own, run)) for run in RUNS]
        rows.append((f"least squares along the motion, {behind}", *(_percent(*pair) for pair in torques)))
    return rows


def by_chance(result: Result) -> tuple[float, float]:
    """Errors by noise of the variance that the fit leaves, and held out by the covariance of the values as well."""
    estimate, shown = result.estimate, {run: result.validation(run) for run in RUNS}
    fitted, held = shown["estimation"], shown["validation"]
    noise = np.sum((fitted.measured - fitted.simulated) ** 2, axis=0) / fitted.measured.shape[0]
    noise *= fitted.measured.size / (fitted.measured.size - estimate.value.size)
    model = estimate.validated_model.on("validation").torque_alone
    table = sensitivity(model, estimate.value, model.outputs(estimate.value))
    spread = np.mean(np.einsum("mjp,pq,mjq->mj", table, estimate.covariance, table), axis=0)
    sizes = [one.measured.shape[0] / np.sum(one.measured**2) for one in (fitted, held)]
    return 100 * float(np.sqrt(noise.sum() * sizes[0])), 100 * float(np.sqrt((noise + spread).sum() * sizes[1]))


def _percent(measured: Array, simulated: Array) -> float:
    return relative_error_percent(measured, simulated)[0]


def _beside(case: Path, content: dict[str, Any]) -> Path:
    """Another case in the folder of one."""
    return cases.write(content, case.with_name("case_limits.yaml"))


def _as_recorded(torque: dict[str, Any]) -> dict[str, Any]:
    """The entry of a log without the filter and the rate of the case: torque and positions in the same rows."""
    return {key: value for key, value in torque.items() if key not in cases.TX40_LOG}


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
    found = texts(document, seconds, cpu_s, limits_of(out / "result/case_augmented.yaml"))
    told = (f"{key}: {value}" for key, value in found.items() if not isinstance(value, list))
    print("\n".join([*found["table"], *found["limits"], *told]))
    if options.figures:
        data = {"commit": commit(options.folder / cases.TX40), "findings": document.model_dump(mode="json")["findings"]}
        write_figures(options.figures, command_of("tests.tools.public_arms.discovered", given), found, data=data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
