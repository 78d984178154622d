from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.effects.base import ControllerEffect
from fmu_didim.dynamics.effects.joint import Parameter, Search

WORDS: Mapping[str, tuple[str, ...]] = {
    "integral_gain": ("integral",),
    "velocity_gain": ("derivative", "velocity"),
    "position_gain": ("proportional", "position"),
}
"""Words by which the description of a gain says what it multiplies; the first factor of which one fits is meant: the
proportional gain of a velocity loop is one of the velocity."""
STEMS: Mapping[str, str] = {"p": "position_gain", "d": "velocity_gain", "i": "integral_gain"}
"""What a gain multiplies whose description says nothing, by its name: Kp1, K_d_2, i3."""


def _factor(name: str, of: str) -> Parameter:
    return Parameter(
        name, "1", f"true over assumed gain of {of}", 1.0, neutral=1.0, limits=(0.05, 20.0), search=Search(0.5, 2.0, 7)
    )


class ControllerGains(ControllerEffect):
    """Kp -> position_gain Kp, Kd -> velocity_gain Kd, Ki -> integral_gain Ki: each gain of the joint's controller is
    wrong by a factor of its own.

    The factors act inside the controller, on those of its parameters that are gains by their description or name: in
    ``pd`` and ``pid`` Kp, Kd and Ki, in ``cascade_ppi`` the gains Kv of the position loop, Kp and Ki of the velocity
    loop. A law may hide its derivative, and a gain may stand within another's loop, so that nothing outside the
    controller amounts to them. Of a controller without such parameters the one factor ``controller_gain`` remains.
    """

    name = "controller_gains"
    title = "Gains of the controller"
    equation = "Kp -> position_gain*Kp, Kd -> velocity_gain*Kd, Ki -> integral_gain*Ki"
    class_name = "controller_gain"
    confounded_with = ("controller_gain", "joint_elasticity", "actuator_lag", "delay")
    signature = "A residual like that of a softer or a stiffer gear: the joint leaves its reference by another way."
    experiment = "Logged positions: the command against the error of the position and its rate."
    source = "Gautier, Janot, Vandanjon: DIDIM, section on errors of the controller's gains"
    is_smooth = True
    shows_at_start = True
    is_stated = True
    own_parameters = (
        _factor("position_gain", "the position"),
        _factor("velocity_gain", "the velocity"),
        _factor("integral_gain", "the integral"),
    )

    def gains(self, parameters: Iterable[Variable], joint: int) -> dict[str, str]:
        found: dict[str, list[str]] = {}
        for variable in parameters:
            stem = re.fullmatch(rf"(.*?\D)_?{joint}", variable.name)
            factor = None if stem is None else _meant(stem[1].rstrip("_"), variable.description)
            if factor is not None:
                found.setdefault(factor, []).append(variable.name)
        return {p.name: found[p.name][0] for p in self.own_parameters if len(found.get(p.name, ())) == 1}


def _meant(stem: str, description: str) -> str | None:
    """The factor of a gain, by its description, else by its name; None of any other parameter."""
    text = description.lower()
    if "gain" in text:
        return next((factor for factor, words in WORDS.items() if any(word in text for word in words)), None)
    short = re.fullmatch(r"k?_?([pid])", stem.lower())
    return STEMS[short[1]] if short and not text else None
