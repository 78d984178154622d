"""What a long log takes of the memory, from reading to the verdict."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from fmu_didim import identify
from fmu_didim.cosim.recording_cache import KeptRecordings
from fmu_didim.model.workers import VARIABLE
from tests.tools.benchmarks.growth import Size, write_case

BYTES_A_SAMPLE = {(10_000, 20_000): 3500, (100_000, 200_000): 750}
"""Samples of two logs of two joints -> by how much the second may take more, a sample; a table of the sensitivities
takes 192. Where all samples are judged it was 2 900 when this was written."""


@pytest.mark.slow
@pytest.mark.parametrize("sizes", BYTES_A_SAMPLE)
def test_a_sample_takes_little_memory(sizes: tuple[int, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one thread, and without the recordings that are kept up to a fixed size."""
    monkeypatch.setenv(VARIABLE, "1")
    monkeypatch.setattr(KeptRecordings, "keep", lambda self, key, recording: None)
    peaks = []
    for samples in sizes:
        case = write_case(tmp_path / f"{samples}", Size(samples=samples))
        identify(write_case(tmp_path / "first", Size(samples=1000)))  # what is compiled and loaded once
        tracemalloc.start()
        assert identify(case).estimate.value.size == 12
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    slope = (peaks[1] - peaks[0]) / (sizes[1] - sizes[0])
    assert slope < BYTES_A_SAMPLE[sizes]
