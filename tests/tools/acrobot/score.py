"""Windows of a discovery against the pulses that were logged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fmu_didim.data.signals import Array
from tests.tools.acrobot.cases import Pulse

EDGE_S = 0.020
"""[s] By which begin and end may be off."""
PART = 0.7
"""[1] Of the smallest pulse that is asked for, from which a window counts as one beyond the pulses: a window of a bell
tells some nine tenths of its height, and the drive gives three quarters of it at least."""
SHORTEST_S = 0.05
"""[s] That such a window lasts: pulses do so by their making."""
START_S = 0.25
"""[s] Of a run, which does not count: the drives start."""
ABOUT_S = 0.35
"""[s] About the middle of a pulse, in which a pulse that is told is moved: it lasts 0.3 s at most from half to half,"""
SHIFTS_S = [0.001 * k for k in range(-60, 61)]
"""[s] and by which."""
Windows = Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class Scored:
    """One run.

    Attributes:
        pulses: each with the errors of begin and end in s, None where it was not found.
        beyond: windows as large and long as a pulse that are none; windows: all that are told.
        names: what was named beside; verdict: of the answer.
        edges: of each begin and end of a pulse that was found, whether its 95 % interval holds it, and how wide that
            is in s; lags: of the drives of the joints, s, by the answer.
        known: by how much each pulse is off, s, that is told in form and place and put through the drive.
    """

    run: str
    pulses: tuple[tuple[Pulse, tuple[float, float] | None], ...]
    beyond: tuple[Mapping[str, Any], ...]
    windows: int
    names: tuple[str, ...]
    verdict: str
    edges: tuple[tuple[bool, float], ...] = ()
    known: tuple[float, ...] = ()
    lags: Mapping[int, float] = field(default_factory=dict)

    @property
    def found(self) -> int:
        """Pulses with a window of their own."""
        return sum(errors is not None for _, errors in self.pulses)

    @property
    def sharp(self) -> int:
        """Pulses whose begin and end are right."""
        return sum(errors is not None and max(map(abs, errors)) <= EDGE_S for _, errors in self.pulses)

    @property
    def sharp_at_the_drive(self) -> int:
        """The same of windows that begin and end earlier by the lag of the drive."""
        return sum(
            errors is not None and max(abs(one - self.lags.get(pulse.joint, 0.0)) for one in errors) <= EDGE_S
            for pulse, errors in self.pulses
        )


def scored(
    run: str,
    document: Mapping[str, Any],
    pulses: Sequence[Pulse],
    *,
    least: float,
    log: Mapping[str, Array] | None = None,
) -> Scored:
    """The windows of ``findings.json`` against the pulses of at least this size: one window stands for one pulse.

    Args:
        log: of the run, for pulses that are told in form and place.
    """
    windows, taken, edges = document["windows"], set[int](), list[tuple[bool, float]]()
    values = {one["name"]: float(one["value"]) for one in document.get("base_parameters", ())}
    pairs = []
    for pulse in pulses:
        near = [i for i, w in enumerate(windows) if i not in taken and _is_of(w, pulse)]
        errors = {i: (windows[i]["begin_s"] - pulse.begin_s, windows[i]["end_s"] - pulse.end_s) for i in near}
        best = min(errors, key=lambda i: abs(errors[i][0]) + abs(errors[i][1]), default=None)
        pairs.append((pulse, None if best is None else errors[best]))
        taken |= set() if best is None else {best}
        if best is not None:
            edges += _edges(windows[best], pulse, values.get(f"lag{pulse.joint}", 0.0))
    beyond = tuple(w for i, w in enumerate(windows) if i not in taken and _as_a_pulse(w, PART * least))
    names = tuple(f["title"] for f in document["findings"])
    known = () if log is None else tuple(known_pulse(log, pulse, values) for pulse in pulses)
    lags = {j: values[f"lag{j}"] for j in (1, 2) if f"lag{j}" in values}
    return Scored(run, tuple(pairs), beyond, len(windows), names, document["verdict"], tuple(edges), known, lags)


def _edges(window: Mapping[str, Any], pulse: Pulse, lag_s: float) -> Iterator[tuple[bool, float]]:
    """Whether the intervals of a window hold the edges of a pulse, and their widths: what a drive gives is late by its
    lag at most."""
    for name, at in (("begin_interval", pulse.begin_s), ("end_interval", pulse.end_s)):
        if (interval := window.get(name)) is not None:
            yield interval[0] - lag_s <= at <= interval[1], interval[1] - interval[0]


def known_pulse(log: Mapping[str, Array], pulse: Pulse, values: Mapping[str, float]) -> float:
    """By how much a logged pulse, put through the drive, must be moved in s to explain best what the drive gave beyond
    its command, whatever its size: what nobody knows better who is told its form and place.

    Args:
        values: ``gain<j>``, ``lag<j>`` of the drives.
    """
    time, j = log["time"], pulse.joint
    near = np.abs(time - (pulse.begin_s + pulse.end_s) / 2) < ABOUT_S
    model = [given(time, log[name], values[f"gain{j}"], values[f"lag{j}"]) for name in (f"tau_con{j}", f"tau_pert{j}")]
    left = (log[f"tau_meas{j}"] - model[0])[near]

    def misfit(late: float) -> float:
        moved = np.interp(time[near] - late, time, model[1])
        return float(left @ left - (left @ moved) ** 2 / (moved @ moved))

    return min(SHIFTS_S, key=misfit)


def given(time: Array, asked: Array, gain: float, lag: float) -> Array:
    """(N,) what a drive gives of what it is asked for, which is held from row to row."""
    result = np.zeros(time.size)
    for k, decay in enumerate(np.exp(-np.diff(time) / lag)):
        result[k + 1] = decay * result[k] + (1 - decay) * gain * asked[k]
    return result


def _is_of(window: Mapping[str, Any], pulse: Pulse) -> bool:
    same = window["signal"] == f"tau{pulse.joint}" and window["torque"] * pulse.torque > 0
    return bool(same and window["begin_s"] < pulse.end_s and window["end_s"] > pulse.begin_s)


def _as_a_pulse(window: Mapping[str, Any], least: float) -> bool:
    lasts = window["end_s"] - window["begin_s"]
    return bool(abs(window["torque"]) >= least and lasts >= SHORTEST_S and window["begin_s"] >= START_S)


def figures_of(runs: Sequence[Scored]) -> dict[str, str]:
    """What the pages show."""
    disturbed = [r for r in runs if r.pulses]
    still = [r for r in runs if not r.pulses]
    count = sum(len(r.pulses) for r in disturbed)
    edges, known = [edge for r in disturbed for edge in r.edges], [late for r in disturbed for late in r.known]
    return {
        "pulses": str(count),
        "found": f"{sum(r.found for r in disturbed)} of {count}",
        "sharp": f"{sum(r.sharp for r in disturbed)} of {count}",
        "sharp_at_the_drive": f"{sum(r.sharp_at_the_drive for r in disturbed)} of {count}",
        "intervals": f"{sum(holds for holds, _ in edges)} of {len(edges)}",
        "wide": f"{500 * float(np.median([width for _, width in edges])):.0f}" if edges else "",
        "told": f"{sum(width <= 2 * EDGE_S for _, width in edges)} of {len(edges)}",
        "known": f"{sum(abs(late) > EDGE_S for late in known)} of {len(known)}",
        "late": " and ".join(f"{late:.0f}" for late in _late(disturbed)),
        "beyond": f"{sum(len(r.beyond) for r in disturbed)} in {len(disturbed)} runs",
        "undisturbed_beyond": f"{sum(bool(r.beyond) for r in still)} of {len(still)} runs",
        "undisturbed_windows": f"{sum(r.windows for r in still)} in {len(still)} runs",
        "named_valid": str(sum(bool(r.names) and r.verdict == "valid" for r in runs)),
    }


def _late(runs: Sequence[Scored]) -> list[float]:
    """Median errors of begin and end in ms, positive where they are late."""
    errors = [errors for run in runs for _, errors in run.pulses if errors is not None]
    return (1e3 * np.median(errors, axis=0)).tolist() if errors else []


def text(runs: Sequence[Scored]) -> str:
    """A line for each run, then the figures."""
    rows = []
    for r in runs:
        told = [
            f"joint {p.joint} {p.begin_s:.2f}-{p.end_s:.2f} s {p.torque:+.2f}: "
            + ("missed" if e is None else f"{1e3 * e[0]:+.0f} {1e3 * e[1]:+.0f} ms")
            for p, e in r.pulses
        ]
        beyond = [f"{w['signal']} {w['begin_s']:.2f}-{w['end_s']:.2f} s {w['torque']:+.2f}" for w in r.beyond]
        names = ", ".join([r.verdict, *r.names])
        rows.append(f"{r.run} ({names}): {'; '.join(told) or 'no pulse'}{'; beyond: ' if beyond else ''}")
        rows[-1] += ", ".join(beyond)
    return "\n".join([*rows, "", *(f"{key}: {value}" for key, value in figures_of(runs).items())])
