"""The scorer: what an answer is worth, and the tables of all answers. README.md says the same in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from examples.benchmark.methods import TITLES
from tests.figures import table
from tests.tools.blind.score import VISIBLE, Truth, catalogued, matches, members, same_class, without_clutter

SIGMAS = 3.0
"""[1] Standard deviations within which the true value of a base parameter must lie."""
OUTCOMES = ("right", "in_set", "wrong", "refused", "missed", "failed")
HEADS = ("right", "in the set", "wrong name", "refused", "missed", "failed")
"""As tables call the outcomes."""
GROUPS = {"catalogue": "an effect of the catalogue", "outside": "an effect outside it", "clean": "nothing hidden"}

Line = Mapping[str, Any]


def group(truth: Truth) -> str | None:
    """One of GROUPS; None for a gap that the noise hides, which is not judged."""
    if not truth.effects:
        return "clean"
    if truth.gap < VISIBLE:
        return None
    return "catalogue" if catalogued(truth.effects[0][0]) else "outside"


def outcome(line: Line, truth: Truth) -> str:
    """One of OUTCOMES, by the first name that is no planted clutter.

    ``right``: class and joint of what is hidden; nothing is hidden and nothing is named; no name for what no catalogue
    holds, and the answer *unknown*. ``in_set``: another name, with the right one in its set and on the right joint.
    ``refused``: *unknown* without a name. ``missed``: it says that nothing is missing, or names clutter alone.
    """
    if line["verdict"] == "error":
        return "failed"
    names, unknown = without_clutter(line["findings"], truth), line["verdict"] == "unknown"
    if not truth.effects:
        return "wrong" if names else "refused" if unknown else "right"
    effect, joint = truth.effects[0]
    if not catalogued(effect):
        if names:
            return "right" if all(matches(name, effect, joint) for name in names) else "wrong"
        return "right" if unknown else "missed"
    if not names:
        return "refused" if unknown else "missed"
    if matches(names[0], effect, joint):
        return "right"
    on_joint = joint is None or names[0].get("joint") == joint
    return "in_set" if on_joint and any(same_class(name, effect) for name in members(names[0])) else "wrong"


def false_names(line: Line, truth: Truth) -> int:
    """How many of all its names are neither what is hidden, class and joint, nor planted clutter."""
    names = without_clutter(line["findings"], truth)
    return sum(not any(matches(name, *hidden) for hidden in truth.effects) for name in names)


def within(line: Line, truth: Truth) -> tuple[int, int]:
    """Base parameters whose true value is within ``SIGMAS`` of theirs, and all that have a standard deviation."""
    pairs = [(truth.parameters[n], v, s) for n, (v, s) in line["parameters"].items() if n in truth.parameters]
    return sum(abs(true - value) <= SIGMAS * std for true, value, std in pairs), len(pairs)


def counted(lines: Mapping[str, Sequence[Line]], truths: Mapping[str, Truth]) -> dict[str, Any]:
    """Method -> counts of its lines: what the tables are made of.

    Raises:
        ValueError: methods were run on different cases.
    """
    found: dict[str, Any] = {}
    for method, own in lines.items():
        if (ran := sorted(line["case"] for line in own)) != sorted(truths):
            raise ValueError(f"{method} was run on {len(ran)} cases that are not the {len(truths)} of the benchmark")
        found[method] = _of_method([(line, truths[line["case"]]) for line in own])
    return found


def _of_method(pairs: Sequence[tuple[Line, Truth]]) -> dict[str, Any]:
    tally: dict[str, Counter[str]] = {name: Counter() for name in GROUPS}
    kinds: dict[str, Counter[str]] = {}
    inside: dict[bool, list[int]] = {True: [0, 0], False: [0, 0]}
    judged = 0
    for line, truth in pairs:
        if (of := group(truth)) is None:
            continue
        result = outcome(line, truth)
        judged += 1
        tally[of][result] += 1
        tally[of]["false names"] += false_names(line, truth) > 0
        tally[of]["right alone"] += result == "right" and not false_names(line, truth)
        kinds.setdefault(truth.effects[0][0] if truth.effects else "nothing", Counter())[result] += 1
        inside[truth.clutter] = [a + b for a, b in zip(inside[truth.clutter], within(line, truth), strict=True)]
    return {
        "judged": judged,
        "groups": {name: dict(counts) for name, counts in tally.items()},
        "kinds": {name: dict(counts) for name, counts in sorted(kinds.items())},
        "within": {"bare": inside[False], "planted": inside[True]},
        "seconds": [round(f(line["seconds"] for line, _ in pairs), 1) for f in (median, max)],
    }


def texts(data: Mapping[str, Any]) -> dict[str, str | list[str]]:
    """What pages show of the counts, by name."""
    methods = data["methods"]
    shown: dict[str, str | list[str]] = {of: _of_group(methods, of) for of in GROUPS}
    names = list(next(iter(methods.values()))["kinds"])
    rows = [(kind.replace("_", " "), *(_kind(counts["kinds"][kind]) for counts in methods.values())) for kind in names]
    shown["kinds"] = table(("hidden", *(TITLES[m] for m in methods)), rows)
    shown["cost"] = table(
        (
            "method",
            f"parameters within {SIGMAS:g} σ",
            "... with small further effects",
            "processor time, median (largest)",
        ),
        [
            (
                TITLES[m],
                *(_part(*c["within"][of]) for of in ("bare", "planted")),
                "{:g} s ({:g} s)".format(*c["seconds"]),
            )
            for m, c in methods.items()
        ],
    )
    for method, counts in methods.items():
        for of in GROUPS:
            own = counts["groups"][of]
            shown[f"{method}.{of}"] = _part(own.get("right", 0), _number(own))
        own = counts["groups"]["catalogue"]
        shown[f"{method}.alone"] = _part(own.get("right alone", 0), _number(own))
        shown[f"{method}.seconds"] = f"{counts['seconds'][0]:g} s"
    order = data["order"]
    shown["cases"] = str(next(iter(methods.values()))["judged"])
    shown["seeds"] = f"{order['first_seed']} to {order['first_seed'] + order['seeds'] - 1}"
    shown["packages"] = ", ".join(f"{name} {version}" for name, version in data["packages"].items()) or "none"
    return shown


def _number(counts: Mapping[str, int]) -> int:
    """Cases that are judged."""
    return sum(counts.get(name, 0) for name in OUTCOMES)


def _of_group(methods: Mapping[str, Any], of: str) -> list[str]:
    """The table of a group of cases, a row for each method."""
    rows = []
    for method, counts in methods.items():
        own = counts["groups"][of]
        number = _number(own)
        cells = [str(own.get(name, 0)) for name in OUTCOMES]
        rows.append(
            (TITLES[method], str(number), *cells, str(own.get("right alone", 0)), str(own.get("false names", 0)))
        )
    return table(("method", "cases", *HEADS, "right and nothing false beside", "cases with a false name"), rows)


def _kind(counts: Mapping[str, int]) -> str:
    """Right ones of all, and what the others are."""
    others = [f"{HEADS[i]} {counts[name]}" for i, name in enumerate(OUTCOMES) if name != "right" and counts.get(name)]
    return ", ".join([f"{counts.get('right', 0)} of {sum(counts.values())}", *others])


def _part(good: int, count: int) -> str:
    return f"{good} of {count}" if count else "none given"
