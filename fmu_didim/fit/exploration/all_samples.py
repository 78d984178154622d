"""What all samples of long logs say, beside the part of them that was judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array


@dataclass(frozen=True)
class BlockOfLog:
    """Consecutive samples of a log, at the values of all of them.

    Attributes:
        label: of the log; begin_s, end_s: where its samples lie.
        score: (p,) S' r / s^2 of them, with the sensitivity S, residual r and deviation s of the noise; gram: (p, p)
            S' S / s^2; scatter: (p, p) covariance of the score by noise.
        rms: (n,) root mean square of the residual of each joint.
    """

    label: str
    begin_s: float
    end_s: float
    score: Array
    gram: Array
    scatter: Array
    rms: Array


@dataclass(frozen=True)
class FarSamples:
    """The samples of a joint in a log whose residual is far above the noise: their rows (k,) in the log, and (k, p) by
    which the values follow their errors."""

    rows: Indices
    influence: Array


@dataclass(frozen=True)
class AllSamples:
    """All samples of the logs, of which a part was judged.

    Attributes:
        count: of all of them; judged: of that part; spans: label of a long log -> (k, 2) s, its stretches in the part.
        blocks: of all of them; rms: (n,) of the residual of each joint in the stretch of the part where it is largest.
        far: (label, joint from 0) -> the samples that may be outliers.
        deviation_of_part: (p,) standard deviations of the values of the part alone.
    """

    count: int
    judged: int
    spans: Mapping[str, Array]
    blocks: tuple[BlockOfLog, ...]
    rms: Array
    far: Mapping[tuple[str, int], FarSamples]
    deviation_of_part: Array
