"""What discovery says where it names nothing, or something else, and the residual still depends on the motion."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.discovery.judge import MUCH, REMAINDER, REMAINDER_FOLLOWS, SMALLEST_WHOLE, explains_little
from fmu_didim.discovery.request import Request
from fmu_didim.discovery.run import discover
from fmu_didim.discovery.selection.decide import Step
from fmu_didim.discovery.selection.rounds import Discovery
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.results.findings import FindingsDocument
from tests.discovery.by_hand import table_fit
from tests.tools.verdict.catalogue import NOISE
from tests.tools.verdict.drawn import nameless
from tests.tools.verdict.power import along, builder, with_logs


def answered(seed: int, *, hidden: bool) -> FindingsDocument:
    """On a SCARA along the motion of a draw, with a drawn torque that is in no catalogue, or without."""
    model = along("scara", seed)
    torques = {label: model.torque(model.start, label) for label in model.experiments}
    if hidden:
        found = nameless(np.random.default_rng([seed, 31]), model, torques["estimation"], "scara")
        assert found is not None
        torques = {label: found[1].torque(found[1].start, label) for label in torques}
    request = Request("drawn", builder("scara").description)
    return discover(with_logs(along("scara", seed), torques, seed, NOISE), request).document


GAIN, OTHER_JOINT = EffectAtJoint("drive_gain", 2), EffectAtJoint("drive_gain", 1)
CLASS, OTHER_CLASS = EffectAtJoint("scale_error", 2), EffectAtJoint("ripple", 2)


@pytest.mark.parametrize(
    ("before", "after", "rivals", "told"),
    [
        ([3.0], [2.76], [OTHER_JOINT], "12 %"),  # a drive gain in the place of a coupling: most is left
        ([3.0], [2.76], [CLASS, OTHER_CLASS], "12 %"),
        ([3.0], [2.76], [CLASS], ""),  # of the class of what was named: a measured gear may lose by its load
        ([3.0], [2.76], [], ""),
        ([5.0], [1 + 4 * (1.01 - SMALLEST_WHOLE)], [OTHER_CLASS], "39 %"),
        ([5.0], [1 + 4 * (0.99 - SMALLEST_WHOLE)], [OTHER_CLASS], ""),
        ([17.0, 1.05], [16.9, 1.04], [OTHER_CLASS], "1 %"),  # the other joint shows nothing that could be explained
        ([17.0, 3.0], [16.9, 1.2], [OTHER_CLASS], ""),  # one joint is explained, the other has something else
        ([2.1], [1 + 0.99 * MUCH**2], [OTHER_CLASS], ""),  # what is left is no more than the noise
        ([2.1], [1 + 1.01 * MUCH**2], [OTHER_CLASS], "8 %"),
    ],
)
def test_what_explains_the_smaller_part_of_all_with_a_rival_is_no_name(
    before: list[float], after: list[float], rivals: list[EffectAtJoint], told: str
) -> None:
    """Mean squares of the residual of each joint, whose noise is one, without and with what was named."""
    step = Step(GAIN, 19.0, 1.0, 0.1, tuple((rival, 1.0) for rival in rivals), {}, {}, None)
    found = Discovery(table_fit(*before), table_fit(*after), (step,))
    classes = {"drive_gain": "scale", "scale_error": "scale"}
    why = explains_little(found, lambda effect_at: classes.get(effect_at.effect, effect_at.effect))
    assert why.startswith(f"all that was named explains {told}") if told else why == ""


@pytest.mark.gate
@pytest.mark.parametrize(("seed", "joint"), [(6, 2), (10, 1)])
def test_a_small_remainder_that_follows_the_motion_is_doubted(seed: int, joint: int) -> None:
    """Torques without a name: nothing was named, and a spring, both valid, while `identify` doubts the same data."""
    found = answered(seed, hidden=True)
    assert max(found.gap["estimation"].after_per_joint) < REMAINDER
    told = {reason.place for reason in found.reasons if reason.code == REMAINDER_FOLLOWS.name}
    assert (found.verdict, told) == ("doubtful", {f"joint {joint}"})


@pytest.mark.gate
def test_a_model_that_lacks_nothing_is_valid() -> None:
    found = answered(6, hidden=False)
    assert (found.answer, found.verdict, found.reasons) == ("nothing", "valid", [])
