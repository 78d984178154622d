import math
from collections.abc import Mapping
from types import MappingProxyType

import casadi as ca

from fmu_didim.dynamics.effects.base import SURE, TorqueEffect
from fmu_didim.dynamics.effects.joint import PAYLOAD, Column, OperatingRange, Parameter, Surroundings, Values
from fmu_didim.dynamics.effects.stated_size import StatedSize
from fmu_didim.dynamics.effects.steps import instants, rise


class PayloadChange(TorqueEffect):
    """tau_e = r(t; t_load) (W_M dM + W_MX dMX + W_MY dMY + W_MZ dMZ): a mass joins the link around t = t_load.

    W_p (n,) is the column of p in the rigid-body regressor of all joints; r(t; t1) = (1 + tanh((t - t1)/w_load))/2 with
    the time t of the loop in s; dM in kg, the first moments in kg.m. The moments of inertia of the load about the
    link's frame are left out. Listed at the joint that carries the load, as a rule the last one. A load that is there
    all the time is part of the link and cannot be separated from it.
    """

    name = "payload_change"
    title = "Change of payload"
    equation = "(t > t_load)*(W_M*dM + W_MX*dMX + W_MY*dMY + W_MZ*dMZ)"
    confounded_with = ("external_force",)
    signature = "Residual like gravity and inertia on all joints below the load, from one instant on."
    experiment = "Repeat the path with and without the load."
    source = (
        "Khalil, Gautier, Lemoine: Identification of the payload inertial parameters of industrial manipulators, "
        "ICRA 2007"
    )
    needs = frozenset({"time", "other joints"})
    signed = frozenset({"t_load"})
    acts_on_link = True
    rivals_external_torque = True
    added_to_link = MappingProxyType({f"d{name}": name for name in PAYLOAD})
    stated = StatedSize(
        "a payload that changes halfway", "% of the mass and first moments of the link", 100.0, largest=200.0,
        shares=added_to_link, in_log={"t_load": 0.5}, joints="last",
    )  # fmt: skip
    own_parameters = tuple(
        Parameter(f"d{name}", "kg" if name == "M" else "kg.m", f"change of {name} of the link") for name in PAYLOAD
    )
    own_shapes = (
        Parameter("t_load", "s", "instant at which the load changes", 1.0, search=instants),
        Parameter("w_load", "s", "width of that step", 0.02),
    )

    def acts(self, shapes: Mapping[str, float]) -> tuple[float, float]:
        return shapes["t_load"], math.inf

    def columns(self, at: Surroundings, shapes: Values) -> tuple[Column, ...]:
        step = rise(at.time, shapes["t_load"], shapes["w_load"])
        return tuple({i: step * at.link[name][i] for i in range(at.all_q.numel())} for name in PAYLOAD)

    def impossible(self, values: Values, deviations: Values, link: Values) -> str:
        left, mass = values.get("dM", 0.0), link.get("M", 0.0)  # a load that is taken off is no more than all there is
        if "dM" in deviations and mass > 0 and left < -mass - SURE * deviations["dM"]:
            return f"dM = {left:.3g} ± {deviations['dM']:.2g} kg taken off a link of {mass:.3g} kg"
        return ""

    def own_rate(self, shapes: Values, within: OperatingRange) -> ca.SX:
        return 1 / shapes["w_load"]
