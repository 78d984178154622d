"""The verb ``excite``: the motion on which the torque log of a loop will tell most of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

from fmu_didim.case import Case, CaseParts, case_of, with_objects
from fmu_didim.discovery.excitation.optimum import Criterion
from fmu_didim.workflow.excitation.design import STARTS, Kind, Request, designed
from fmu_didim.workflow.excitation.excited import Excited
from fmu_didim.workflow.excitation.limits import MotionLimits, limits_document
from fmu_didim.workflow.excitation.weigh import weighed


@with_objects
def excite(
    case: Case | Path | str | Mapping[str, Any] | None = None,
    out: Path | str | None = None,
    *,
    limits: MotionLimits | Mapping[str, Any] | Path | str | None = None,
    only: Sequence[str] = (),
    criterion: Criterion = "determinant",
    kind: Kind = "fourier",
    harmonics: int | None = None,
    moves: int | None = None,
    dwell_s: float | None = None,
    period_s: float | None = None,
    periods: int | None = None,
    rate_hz: float | None = None,
    torque_std: Sequence[float] | None = None,
    starts: int = STARTS,
    seed: int = 0,
    parameters: Mapping[str, float] | None = None,
    experiment: str | None = None,
    weigh: Sequence[float] = (),
    at: Sequence[Sequence[float]] = (),
    progress: Callable[[str], None] = lambda text: None,
    **objects: Unpack[CaseParts],
) -> Excited:
    """Design the motion on which the torque log of a case will tell most of the parameters: the D-optimal Fourier
    series, or moves from point to point, that begins and ends at rest within limits, by CasADi and IPOPT from several
    random starts. The best ones are simulated in the closed loop, from whose sensitivities the standard deviations are
    predicted.

    Args:
        case: a loaded case, the path of its file, or its content; its torque log need not exist.
        out: folder for ``reference.yaml``, ``reference.csv`` and ``excite.json``; nothing is written by default.
        limits: a YAML file or a mapping with ``position``, ``velocity``, ``acceleration``, ``torque``, ``start``, and
            what the arm keeps clear of: ``inside``, ``boxes``, ``capsules``, ``clearance``; by default the range of the
            robot description, and else what the reference of the case uses.
        only: parameters to be known best, the others being unknown, too; all by default.
        criterion: ``determinant`` of their information, or ``mean`` of their relative standard deviations, without
            those of values so small that a log would not show them, were all others known.
        kind: a Fourier series, or moves of a fifth order polynomial ``point_to_point``.
        harmonics: of the series (5); moves: from point to point in a period (10), of equal duration; dwell_s: rest
            after each (0).
        period_s, periods: of the motion; by default those of the case's reference.
        rate_hz: of the torque log; by default that of the case. torque_std: (n,) standard deviations of its noise; by
            default those of the case.
        starts: random motions from which the optimisation begins; seed: of them.
        parameters: values by name; those of the robot description by default, for which the motion is the best.
        experiment: label of the experiment whose loop and log are meant; the first one by default.
        weigh: masses of weights that may hang on the last link, kg. The motion is then that of two runs, one without
            and one with the weight, the case having both (``load:``), and the weight is taken with which their logs
            tell best, first of all the gains of drives if these are free.
        at: places of the centre of the weight, m, in the frame of the last link; by default the ``centre`` that the
            case states, or the end of the shape of that link.
        progress: told of each start.

    Raises:
        InputError, UnknownNameError: the case, a limit or a name is wrong, the noise or the rate is unknown, or no
            start succeeds; SimulationError: the loop diverges on each motion.
    """
    case = case_of(case, objects, require_torque=False, require_positions=False)
    request = Request(
        limits_document(limits), tuple(only), criterion, kind, harmonics, moves, dwell_s, period_s, periods, rate_hz,
        torque_std, starts, seed, parameters or {}, progress,
    )  # fmt: skip
    if len(weigh) or len(at):
        made = weighed(case, request, weights=weigh, places=at, label=experiment)
    else:
        made = designed(case, [experiment or next(iter(case.document.runs))], request)
    if out is not None:
        made.save(out)
    return made
