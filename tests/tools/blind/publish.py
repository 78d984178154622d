"""Evaluated campaigns as a table of all cases, and the figures of the documentation from that table alone."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from tests.figures import table
from tests.tools.blind.harness import case_folders, read_lines
from tests.tools.blind.score import (
    CLASSES,
    SHRINKS_SURELY,
    VISIBLE,
    Rate,
    Score,
    Truth,
    in_set,
    read_truth,
    rms,
    score,
)

COLUMNS = (
    "campaign", "case", "rate_hz", "hidden", "gap", "clutter", "verdict", "named", "right", "in_set", "test_before",
    "test_after", "judged",
)  # fmt: skip
Lines = list[Mapping[str, Any]]


def collected(pairs: Sequence[tuple[Path, Path]]) -> tuple[Lines, dict[str, Truth]]:
    """The lines of several campaigns, (folder of cases, file of lines) each, and the truth of those that were run.

    Cases are called ``<campaign>/<case>``, by the name of the folder.
    """
    lines: Lines = []
    truths: dict[str, Truth] = {}
    for folder, out in pairs:
        run = {line["case"]: line for line in read_lines(out)}
        for case in case_folders(folder, list(run)):
            name = f"{folder.name}/{case.name}"
            lines.append({**run[case.name], "case": name})
            truths[name] = read_truth(case)
    return lines, truths


def write_rows(path: Path, lines: Sequence[Mapping[str, Any]], truths: Mapping[str, Truth]) -> None:
    """One row a case: what it hides, with the gap in noise deviations after refitting the base, and what was named.

    ``clutter`` says whether small further effects act; ``right`` and ``in_set`` are the judgement of the score:
    everything as it should be, and the hidden effect's class in the set of the first name. ``judged`` is the verdict
    on the answer, such as valid; older tables lack it.
    """
    wrong = {note.partition(":")[0] for note in score(lines, truths).notes}
    with path.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(COLUMNS)
        for line in lines:
            truth = truths[line["case"]]
            campaign, _, case = line["case"].partition("/")
            hidden = "+".join(f"{e}@{j}" if j is not None else e for e, j in truth.effects) or "nothing"
            named = "+".join(f"{f['effect']}@{f['joint']}" for f in line["findings"])
            before, after = (rms(x) for x in line["gap"].get("test") or (np.nan, np.nan))
            row = (campaign, case, f"{truth.rate_hz:g}", hidden, f"{truth.gap:.2f}", int(truth.clutter))
            judged = (int(line["case"] not in wrong), int(in_set(line, truth)), f"{before:.3f}", f"{after:.3f}")
            rows.writerow((*row, line["verdict"], named, *judged, line.get("judged", "")))


def read_rows(path: Path) -> tuple[Lines, dict[str, Truth]]:
    """The lines and the truths that a table of :func:`write_rows` holds: as much of them as the score needs."""
    lines: Lines = []
    truths: dict[str, Truth] = {}
    with path.open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream):
            name = f"{row['campaign']}/{row['case']}"
            hidden = [] if row["hidden"] == "nothing" else [_at(item) for item in row["hidden"].split("+")]
            truths[name] = Truth(tuple(hidden), float(row["gap"]), row["clutter"] == "1", float(row["rate_hz"]))
            found = [_at(item) for item in row["named"].split("+")] if row["named"] else []
            same = [effect for effect, _ in hidden] if row["in_set"] == "1" else []
            findings = [{"effect": effect, "joint": joint, "ambiguous": same} for effect, joint in found]
            before, after = float(row["test_before"]), float(row["test_after"])
            gap = {} if np.isnan(before) else {"test": [before, after]}
            told = {"verdict": row["verdict"], "judged": row.get("judged", "")}
            lines.append({"case": name, **told, "findings": findings, "gap": gap})
    return lines, truths


def _at(item: str) -> tuple[str, int | None]:
    """``effect@joint``; the joint may be absent, or ``None``."""
    effect, _, joint = item.partition("@")
    return effect, int(joint) if joint not in ("", "None") else None


def figures(lines: Lines, truths: Mapping[str, Truth]) -> dict[str, str | list[str]]:
    """What pages say of these cases, by name."""
    found = score(lines, truths)
    return {
        "cases": f"{len(lines):,}".replace(",", " "),
        "criteria": _criteria(found),
        "classes": [f"* {', '.join(sorted(group)).replace('_', ' ')}" for group in CLASSES],
        "matrix": _matrix(lines, truths),
        **_rates(found),
        **_wrong(lines, truths, found),
    }


NAMES: Mapping[str, str] = {
    "fast": "right class, 50 Hz and more",
    "slow": "right class, below 50 Hz",
    "exact": "exactly the hidden effect",
    "outside": "effect outside the catalogue refused",
    "outside_unknown": "effect outside the catalogue answered *unknown*",
    "clean": "a name on a clean plant",
    "both": "both of two effects found",
}
"""Name of a figure -> the criterion whose share, and whose cases under ``<name>_cases``, it is."""


def _rates(found: Score) -> dict[str, str]:
    rates = {rate.name: rate for rate in found.rates}
    chosen = {key: rates[name] for key, name in NAMES.items()}
    shares = {key: _share(rate) for key, rate in chosen.items()}
    outside = chosen["outside"]
    return {
        **shares,
        **{f"{key}_cases": f"{rate.good} of {rate.count}" for key, rate in chosen.items()},
        "outside_wrong": f"{outside.count - outside.good} of {outside.count}",
    }


def _wrong(lines: Lines, truths: Mapping[str, Truth], found: Score) -> dict[str, str]:
    """Of kinds of plants with mistakes, as ``wrong.<effects>``: how many of the cases that are judged are wrong."""
    wrong = {note.partition(":")[0] for note in found.notes}
    kinds: dict[str, list[str]] = {}
    for case, truth in truths.items():
        if truth.effects and truth.gap >= VISIBLE:
            kinds.setdefault("+".join(effect for effect, _ in truth.effects), []).append(case)
    result = {}
    for kind, cases in kinds.items():
        bad = [case for case in cases if case in wrong]
        if not bad:
            continue
        slow = sum(truths[case].rate_hz < 50 for case in bad)
        result[f"wrong.{kind}"] = f"{len(bad)} of {len(cases)}"
        result[f"wrong.{kind}.slow"] = str(slow)
    forces = sum(any(f["effect"].startswith("external_force") for f in line["findings"])
                 for line in lines if line["case"] not in wrong and truths[line["case"]].effects
                 and truths[line["case"]].effects[0][0] == "unknown_push")  # fmt: skip
    valid = [line["case"] for line in lines if line.get("judged") == "valid"]
    if valid:  # as far as the table has verdicts
        result |= {"valid": str(len(valid)), "valid_wrong": str(sum(case in wrong for case in valid))}
    return {**result, "pushes_named": str(forces)}


def _criteria(found: Score) -> list[str]:
    """The criteria with their bars."""
    rows = []
    for rate in found.rates:
        if rate.name == SHRINKS_SURELY or rate.name.startswith("median") or not rate.count:
            continue
        bar = "–" if rate.bar is None else f"{'≤' if rate.most else '≥'} {100 * rate.bar:.0f} %"
        rows.append((rate.name, _share(rate), f"{rate.good} of {rate.count}", _interval(rate), bar))
    if found.shrinks:
        rows.append(
            ("held-out gap shrinks by (median)", f"{100 * float(np.median(found.shrinks)):.0f} %", "", "", "≥ 60 %")
        )
    return table(("criterion", "reached", "cases", "95 % interval", "bar"), rows)


def _share(rate: Rate) -> str:
    return f"{100 * rate.share:.1f} %" if rate.count else "–"


def _interval(rate: Rate) -> str:
    """Of Clopper and Pearson, Biometrika 26 (1934)."""
    if not rate.count:
        return "–"
    low, high = binomtest(rate.good, rate.count).proportion_ci()
    return f"{100 * low:.1f} to {100 * high:.1f} %"


def _matrix(lines: Lines, truths: Mapping[str, Truth]) -> list[str]:
    """Which plants were called what, a column for each torque rate."""
    rates = sorted({t.rate_hz for t in truths.values()}, reverse=True)
    parts = []
    for rate in rates:
        called: dict[str, Counter[str]] = {}
        chosen = [line for line in lines if truths[line["case"]].rate_hz == rate]
        for (hidden, name), count in score(chosen, truths).matrix.items():
            called.setdefault(hidden, Counter())[name] += count
        parts.append(called)
    rows = []
    for hidden in sorted({key for part in parts for key in part}):
        cells = [", ".join(f"{name} {n}" for name, n in part.get(hidden, Counter()).most_common()) for part in parts]
        rows.append([hidden.replace("_", " "), *(cell.replace("_", " ") for cell in cells)])
    return table(("hidden", *(f"named at {rate:g} Hz (cases)" for rate in rates)), rows)
