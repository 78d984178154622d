"""What explains a change: one way for two logs, and for a log beside a reference."""

from __future__ import annotations

from functools import partial

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.change.causes import Machine
from fmu_didim.discovery.change.contest import Contest, Explanation, World, contest
from fmu_didim.discovery.change.difference import Difference
from fmu_didim.discovery.change.log_fit import Known, LogFit
from fmu_didim.discovery.change.worlds import forms_in, worlds_of
from fmu_didim.discovery.progress import Progress


def explained(
    found: Difference,
    known: tuple[Known, Known],
    robot: Machine | None,
    logs: tuple[LogFit, LogFit] | None,
    progress: Progress,
    *,
    between: Array | None = None,
) -> tuple[Contest, str]:
    """The contest of causes, and why effects were not looked for after all; empty where they were, or nobody asked.

    Args:
        found: the change of the values; known: these before and after, with their covariances.
        logs: both with their loops, in which effects are looked for, too.
        between: (p, p) covariance of the values between logs of one state, beside the noise of each.
    """
    every, forms, why = [World(found)], partial(forms_in, base=found.names, machine=robot), ""
    if logs is not None:
        covered = frozenset((form.kind, form.joint) for form in forms(every[0]))
        try:
            every += worlds_of(*logs, found, known, progress, covered=covered, between=between)
        except FmuDidimError as error:  # a loop that fails with an effect in it: values can still be compared
            why = f"{error.what.rstrip('.')} ({error.got})"
    return contest(every, forms), why


def shows_effect(found: Explanation) -> bool:
    """Whether an effect that has come, gone or grown is among its causes."""
    lacks = {(lack.kind, lack.joint) for lack in found.world.lacks}
    return bool(found.world.fixed) or any((form.kind, form.joint) in lacks for form in found.forms)
