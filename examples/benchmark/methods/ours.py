"""The discovery of this project, as ``fmu-didim discover`` runs it, without its files."""

from __future__ import annotations

from pathlib import Path

from examples.benchmark.answer import Answer, Name
from fmu_didim import discover


def answer(case: Path) -> Answer:
    """What ``discover`` finds, with all its options as they stand."""
    found = discover(case)
    names = tuple(Name(f.effect, f.joint, tuple(rival.effect for rival in f.ambiguous)) for f in found.findings)
    values = {p.name: (p.value, p.std) for p in found.base_parameters if p.std is not None}
    verdict = {"nothing": "nothing", "named": "named", "named_with_remainder": "named"}.get(found.answer, "unknown")
    return Answer(verdict, names, values)
