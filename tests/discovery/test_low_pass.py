"""A case with a low pass: effects are looked for in the log as it is."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from fmu_didim import discover
from fmu_didim.discovery.run import UNFILTERED
from tests.discovery.helpers import arm_case


@pytest.mark.slow
def test_a_low_pass_changes_neither_names_nor_standard_deviations(tmp_path: Path) -> None:
    """What a filter leaves of the noise is predictable from sample to sample: as noise it would count as hardly any."""
    path = arm_case(tmp_path, {"stribeck": {"Fs": 1.5, "vs": 0.1}})
    plain = discover(path).document
    content = yaml.safe_load(path.read_text(encoding="utf-8")) | {"low_pass": {"cutoff_hz": 5.0}}
    filtered = tmp_path / "filtered.yaml"
    filtered.write_text(yaml.safe_dump(content), encoding="utf-8")
    found = discover(filtered, tmp_path / "out").document
    assert [f.effect for f in plain.findings] == ["stribeck"]
    assert found.findings == plain.findings
    assert found.gap == plain.gap
    assert UNFILTERED in found.notes
    assert UNFILTERED not in plain.notes
    (note,) = [n for n in found.notes if "augmented case" in n]
    assert float(note.split(" to ")[-1].split()[0]) < 2e-3
