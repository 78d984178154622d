"""The loop as a drawing: components in the order of a step, wires with their signals, rate and delay."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup, escape

from fmu_didim.report.numbers import component_words

REFERENCE, INPUTS = "reference", "inputs"
"""What acts from outside on a loop, and on a model without controller."""
ALONE = "model"
"""Name of the only component of such a model."""
BOX_WIDTH, BOX_HEIGHT, GAP, MARGIN = 170, 84, 96, 12
LEVEL = 30
"""px between wires that run below or above the boxes."""
SHOWN_SIGNALS = 3
CHARACTERS = 24
_WIRE = re.compile(r"^(?P<target>[^.]+)\.(?P<into>\S+) <- (?P<gain>\S+) \* (?P<source>[^.]+)\.(?P<signal>\S+)$")


@dataclass(frozen=True)
class Wire:
    """All connections from one component to another: the signals without their joints, and their gains."""

    source: str
    target: str
    signals: tuple[str, ...]
    gains: tuple[float, ...]

    @property
    def signal_text(self) -> str:
        """The signals, the first ones where there are many."""
        return ", ".join(self.signals[:SHOWN_SIGNALS]) + (", …" if len(self.signals) > SHOWN_SIGNALS else "")

    @property
    def gain_text(self) -> str:
        """The gain where it is not one."""
        gains = [f"{gain:.4g}" for gain in self.gains if gain != 1]
        return f"× {gains[0]}{', …' if len(gains) > 1 else ''}" if gains else ""

    @property
    def text(self) -> str:
        """Signals and gain."""
        return f"{self.signal_text} {self.gain_text}".strip()


def wires(connections: Sequence[object]) -> list[Wire]:
    """The wires between components from the connections of a result."""
    found: dict[tuple[str, str], tuple[dict[str, None], dict[float, None]]] = {}
    for connection in connections:
        match = _WIRE.match(str(connection))
        if match is None:
            continue
        signals, gains = found.setdefault((match["source"], match["target"]), ({}, {}))
        signals[re.sub(r"\d+$", "", match["signal"])] = None
        gains[float(match["gain"])] = None
    return [Wire(*ends, tuple(signals), tuple(gains)) for ends, (signals, gains) in found.items()]


def loop_diagram(loop: Mapping[str, Any]) -> Markup | None:
    """The loop of a result as SVG in the colours of the page; None if the result does not describe it."""
    order, components = loop.get("order"), loop.get("components")
    if not order or not isinstance(components, Mapping):
        return None
    lines = wires(loop.get("connections", ()))
    outside = INPUTS if any(w.source == INPUTS for w in lines) or list(order) == [ALONE] else REFERENCE
    names = [outside, *order]
    forward = [w for w in lines if names.index(w.target) > names.index(w.source) + 1]
    back = [w for w in lines if names.index(w.target) <= names.index(w.source)]
    top = MARGIN + 24 + LEVEL * len(forward)
    height = top + BOX_HEIGHT + 34 + LEVEL * len(back) + MARGIN
    width = 2 * MARGIN + len(names) * BOX_WIDTH + (len(names) - 1) * GAP
    left = {name: MARGIN + k * (BOX_WIDTH + GAP) for k, name in enumerate(names)}
    drawn = [_box(name, left[name], top, _texts(name, k, loop)) for k, name in enumerate(names)]
    for wire in lines:
        if wire in forward:
            drawn.append(_around(wire, left, top, -LEVEL * (1 + forward.index(wire))))
        elif wire in back:
            drawn.append(_around(wire, left, top + BOX_HEIGHT, LEVEL * (1 + back.index(wire))))
        else:
            drawn.append(_straight(wire, left, top, loop))
    what = "loop" if outside == REFERENCE else "model"
    title = f"The {what}: {' → '.join(names)}"
    return Markup(
        f'<div class="scroll" tabindex="0" role="group" aria-label="drawing of the {what}">'
        f'<svg class="loop" viewBox="0 0 {width} {height}" width="{width}" role="img" aria-label="{escape(title)}">'
        f"{''.join(drawn)}</svg></div>"
    )


def _texts(name: str, place: int, loop: Mapping[str, Any]) -> list[str]:
    """The texts of a box: the component, its rate, and its place in a step."""
    step = loop.get("step_size_s")
    if name == ALONE and REFERENCE not in str(loop.get("connections")):
        return [*component_words(loop["components"].get(name, {}))[:2], f"a step every {step:.6g} s"]
    if name == INPUTS:
        return []
    if name == REFERENCE:
        return [f"a row every {1e3 * step:.6g} ms"] if isinstance(step, int | float) else []
    texts = component_words(loop["components"].get(name, {}))[:2]
    every = dict(loop.get("ticks_per_step") or {}).get(name, 1)
    rate = f"{1 / (step * every):.6g} Hz" if isinstance(step, int | float) else ""
    late = ", output after its step" if name in loop.get("outputs_after_step", ()) else ""
    return [*texts, ", ".join(part for part in (f"{place}. in a step", rate) if part) + late]


def _box(name: str, x: int, y: int, texts: Sequence[str]) -> str:
    lines = "".join(
        f'<text class="small" x="{x + 12}" y="{y + 42 + 17 * k}">{escape(_cut(text))}</text>'
        for k, text in enumerate(texts)
    )
    box = f'<rect class="box" x="{x}" y="{y}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}" rx="6"/>'
    head = f'<text class="name" x="{x + 12}" y="{y + 22}">{escape(_cut(name))}</text>'
    return f"<g><title>{escape('; '.join(texts))}</title>{box}{head}{lines}</g>"


def _cut(text: str) -> str:
    return text if len(text) <= CHARACTERS else text[: CHARACTERS - 1] + "…"


def _straight(wire: Wire, left: Mapping[str, int], top: int, loop: Mapping[str, Any]) -> str:
    """A wire between neighbours, its signals above, its gain and the delay at its end below."""
    begin, end, y = left[wire.source] + BOX_WIDTH, left[wire.target], top + BOX_HEIGHT // 2
    samples = float(dict(loop.get("delay_samples") or {}).get(wire.target, 0.0) or 0.0)
    below = [("small", wire.gain_text), ("late", f"delay {samples:.4g}" if samples else "")]
    lines = [("small", y - 9, wire.signal_text)]
    lines += [(style, y + 18 + 15 * k, text) for k, (style, text) in enumerate(line for line in below if line[1])]
    texts = "".join(
        f'<text class="{style}" text-anchor="middle" x="{(begin + end) / 2}" y="{at}">{escape(text)}</text>'
        for style, at, text in lines
    )
    return f'<path class="wire" d="M{begin} {y}H{end}"/>{_tip(end, y, "right")}{texts}'


def _around(wire: Wire, left: Mapping[str, int], edge: int, away: int) -> str:
    """A wire that leaves and enters the boxes on one side, at a distance ``away``."""
    shift = 16 if away > 0 else -16
    begin, end = left[wire.source] + BOX_WIDTH // 2 + shift, left[wire.target] + BOX_WIDTH // 2 - shift
    y = edge + away
    path = f'<path class="wire" d="M{begin} {edge}V{y}H{end}V{edge}"/>{_tip(end, edge, "up" if away > 0 else "down")}'
    return (
        path
        + f'<text class="small" text-anchor="middle" x="{(begin + end) / 2}" y="{y - 6}">{escape(wire.text)}</text>'
    )


def _tip(x: int, y: int, way: str) -> str:
    """The head of an arrow that ends at (x, y)."""
    shape = {"right": "l-9 -5v10Z", "up": "l-5 9h10Z", "down": "l-5 -9h10Z"}[way]
    return f'<path class="tip" d="M{x} {y}{shape}"/>'
