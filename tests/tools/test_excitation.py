"""The tool that puts designed motions beside random ones."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tools import excitation


@pytest.mark.slow
def test_a_designed_motion_is_better_than_random_ones_and_its_deviations_are_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With 200 identifications each deviation is known to 5 %, and their mean square over eight to some 2 %."""
    monkeypatch.setattr(excitation, "RANDOM", 5)
    monkeypatch.setattr(excitation, "STARTS", 1)
    row = excitation.measured("scara", None, draws=200)
    assert row["fourier_percent"] < min(row["random_percent"]) and len(row["random_percent"]) == 5
    assert np.sqrt(np.mean(np.square(row["found_over_predicted"]))) == pytest.approx(1, abs=0.1)
    assert "SCARA" in excitation.texts([row])["table"][2]
