"""Evaluated campaigns as a table of all cases and as Markdown for the documentation."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from tests.blind.harness import case_folders, read_lines
from tests.blind.score import Rate, Score, Truth, read_truth, rms, score

COLUMNS = ("campaign", "case", "rate_hz", "hidden", "gap", "verdict", "named", "right", "test_before", "test_after")


def collected(pairs: Sequence[tuple[Path, Path]]) -> tuple[list[Mapping[str, Any]], dict[str, Truth]]:
    """The lines of several campaigns, (folder of cases, file of lines) each, and the truth of those that were run.

    Cases are called ``<campaign>/<case>``, by the name of the folder.
    """
    lines: list[Mapping[str, Any]] = []
    truths: dict[str, Truth] = {}
    for folder, out in pairs:
        run = {line["case"]: line for line in read_lines(out)}
        for case in case_folders(folder, list(run)):
            name = f"{folder.name}/{case.name}"
            lines.append({**run[case.name], "case": name})
            truths[name] = read_truth(case)
    return lines, truths


def write_rows(path: Path, lines: Sequence[Mapping[str, Any]], truths: Mapping[str, Truth]) -> None:
    """One row a case: what it hides, with the gap in noise deviations after refitting the base, and what was named."""
    wrong = {note.partition(":")[0] for note in score(lines, truths).notes}
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(COLUMNS)
        for line in lines:
            truth = truths[line["case"]]
            campaign, _, case = line["case"].partition("/")
            hidden = "+".join(f"{e}@{j}" if j is not None else e for e, j in truth.effects) or "nothing"
            named = "+".join(f"{f['effect']}@{f['joint']}" for f in line["findings"])
            before, after = (rms(x) for x in line["gap"].get("test") or (np.nan, np.nan))
            row = (campaign, case, f"{truth.rate_hz:g}", hidden, f"{truth.gap:.2f}", line["verdict"], named)
            table.writerow((*row, int(line["case"] not in wrong), f"{before:.3f}", f"{after:.3f}"))


def markdown(lines: Sequence[Mapping[str, Any]], truths: Mapping[str, Truth]) -> str:
    """The criteria with their bars, and the confusion matrix by torque rate."""
    found = score(lines, truths)
    rows = ["| criterion | reached | cases | 95 % interval | bar |", "|---|---|---|---|---|"]
    for rate in found.rates:
        if rate.name.startswith(" ") or rate.name.startswith("median"):
            continue
        bar = f"{'≤' if rate.most else '≥'} {100 * rate.bar:.0f} %"
        share = f"{100 * rate.share:.1f} %" if rate.count else "–"
        rows.append(f"| {rate.name} | {share} | {rate.good} of {rate.count} | {_interval(rate)} | {bar} |")
    if found.shrinks:
        rows.append(
            f"| held-out gap shrinks by (median) | {100 * float(np.median(found.shrinks)):.0f} % | | | ≥ 60 % |"
        )
    rates = sorted({t.rate_hz for t in truths.values()}, reverse=True)
    rows += ["", "| hidden | " + " | ".join(f"named at {r:g} Hz (cases)" for r in rates) + " |"]
    rows.append("|---|" + "---|" * len(rates))
    parts = [_matrix(lines, truths, rate) for rate in rates]
    for hidden in sorted({key for part in parts for key in part}):
        cells = [", ".join(f"{name} {n}" for name, n in part.get(hidden, Counter()).most_common()) for part in parts]
        rows.append(f"| {hidden.replace('_', ' ')} | " + " | ".join(c.replace("_", " ") for c in cells) + " |")
    return "\n".join(rows)


def _interval(rate: Rate) -> str:
    """Of Clopper and Pearson, Biometrika 26 (1934)."""
    if not rate.count:
        return "–"
    low, high = binomtest(rate.good, rate.count).proportion_ci()
    return f"{100 * low:.1f} to {100 * high:.1f} %"


def _matrix(lines: Sequence[Mapping[str, Any]], truths: Mapping[str, Truth], rate_hz: float) -> dict[str, Counter[str]]:
    chosen = [line for line in lines if truths[line["case"]].rate_hz == rate_hz]
    found: Score = score(chosen, truths)
    result: dict[str, Counter[str]] = {}
    for (hidden, called), count in found.matrix.items():
        result.setdefault(hidden, Counter())[called] += count
    return result
