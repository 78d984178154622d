import casadi as ca

from fmu_didim.dynamics.effects.bristles import BristleFriction, presliding_distance
from fmu_didim.dynamics.effects.joint import OperatingRange, Parameter, Search, Surroundings, Values
from fmu_didim.dynamics.effects.stribeck import stribeck_velocity


class LuGre(BristleFriction):
    """tau_e = (Fz + Fzs exp(-(dq/vs)^2)) (z + Tz dz/dt)/zs, dz/dt = dq - |dq| z/zs; the state z starts at 0.

    In the model's own terms sigma_0 = (Fz + Fzs)/zs at rest, sigma_1 = sigma_0 Tz, and sliding friction is
    g(dq) = Fz + Fzs exp(-(dq/vs)^2). The state is scaled by g, which makes the torque linear in Fz and Fzs. With
    Coulomb friction at the same joint, that one takes the part which has no memory.
    """

    name = "lugre"
    title = "LuGre friction"
    equation = "(Fz + Fzs*exp(-(dq/vs)^2))*(z + Tz*dz/dt)/zs, dz/dt = dq - |dq|*z/zs"
    class_name = "presliding"
    confounded_with = ("presliding", "stribeck", "coulomb")
    signature = "Residual after every reversal: it builds up over a distance, then falls with speed."
    experiment = "Many reversals with amplitudes below five times zs at two speeds, and slow constant speeds."
    source = (
        "Canudas de Wit, Olsson, Astrom, Lischinsky: A new model for control of systems with friction, IEEE TAC 1995"
    )
    is_composed = True
    own_parameters = (
        Parameter("Fz", "torque", "Coulomb friction that builds up over a distance", least=0.0),
        Parameter("Fzs", "torque", "static friction above that, likewise", least=0.0),
    )
    own_shapes = (
        presliding_distance,
        stribeck_velocity.searched((Search(0.02, 1.0, 5), Search(0.001, 0.05, 5))),
        Parameter("Tz", "s", "damping over stiffness of the bristles", 1e-4),
    )

    def columns(self, at: Surroundings, shapes: Values) -> tuple[ca.SX, ...]:
        build_up = (at.state[0] + shapes["Tz"] * self.rates(at, shapes)[0]) / shapes["zs"]
        return (build_up, build_up * ca.exp(-((at.dq / shapes["vs"]) ** 2)))

    def damping(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return shapes["Tz"] * self.stiffness(parameters, shapes, within)

    def stiffness(self, parameters: Values, shapes: Values, within: OperatingRange) -> ca.SX:
        return (ca.fabs(parameters["Fz"]) + ca.fabs(parameters["Fzs"])) / shapes["zs"]
