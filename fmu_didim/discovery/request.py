"""The settings of a search, beside the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from fmu_didim.base.diagnostics import DOUBT, Diagnostic
from fmu_didim.checks.plant.reading import READING_ACTS
from fmu_didim.checks.virtual import discovered_beside
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.dynamics.effects import EFFECTS, Effect
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.model.experiment import Experiment
from fmu_didim.results.findings import FindingsDocument

OF_THE_WIRING = ("controller", "drive", "sensor", "measurement")
"""Places of effects that look like outputs of an FMU that hold at another time than the machine's."""
NOT_OF_THE_WIRING = (
    "Effects of the controller, of drives, sensors and the log were not tried: as long as it is open when the outputs "
    "of a component hold, they could be a consequence of that."
)
BESIDE_VIRTUAL = ("torque balance", "measurement")
"""Places of effects that can be told where a virtual controller follows measured positions."""
NOT_OF_A_VIRTUAL_LOOP = (
    "Effects of drives, sensors and the structure (elastic gears, play) were not tried: nobody knows what the real "
    "controller did with them, they show above the frequencies up to which positions are followed, and beside a "
    "virtual controller a clock that is off, a lag, a delay and how long a torque is held are one set."
)
OF_THE_DATA = 16
"""[rank] Diagnostics of the data before this rank hold whatever the model is. Those after it, such as a torque limit,
a clock or a delay, discovery names itself."""


@dataclass(frozen=True)
class Request:
    """The settings of a search.

    Attributes:
        name: of the case; description: the robot, None for a black-box plant.
        effects: the catalogue by name; options: how to discover.
        progress: receives messages and limits the time; when it is up, the search returns the answer so far.
        keep: called with the answer so far, after the base fit and after each round.
        case: file of the case, for the commands in the reasons of a verdict.
        acknowledged: code -> sentence of the doubts that the user has checked.
        provenance: recorded in the document.
        doubts: errors of the data, which hold whatever the model is; notes: further remarks on the data.
        whole: label -> all samples of an experiment, by which the torque errors of the answer are, as everywhere else;
            the search leaves out the beginning. Those that are not there: the samples of the search.
    """

    name: str
    description: RobotDescription | None
    effects: Mapping[str, Effect] = field(default_factory=lambda: EFFECTS)
    options: Options = field(default_factory=Options)
    progress: Progress = field(default_factory=Progress)
    keep: Callable[[FindingsDocument], None] | None = None
    case: str = ""
    acknowledged: Mapping[str, str] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    doubts: Sequence[Diagnostic] = ()
    notes: Sequence[str] = ()
    whole: Mapping[str, Experiment] = field(default_factory=dict)

    @property
    def external(self) -> Effect | None:
        """The effect that stands for torques from outside; None without one or if it is forbidden."""
        allowed = (e for name, e in self.effects.items() if e.is_external and name not in self.options.forbid)
        return next(allowed, None)

    def noting(self, *notes: str) -> Request:
        """The same request with further remarks."""
        return replace(self, notes=(*self.notes, *notes))

    def about_data(self, diagnostics: Sequence[Diagnostic]) -> Request:
        """The same request with the diagnostics of its data."""
        doubts = [d for d in diagnostics if d.code.severity is DOUBT and d.code.rank < OF_THE_DATA]
        forbidden, notes = self.options.forbid, [str(d) for d in diagnostics if d not in doubts]
        if any(d.code is READING_ACTS for d in doubts):
            forbidden |= {name for name, effect in self.effects.items() if effect.place in OF_THE_WIRING}
            notes.append(NOT_OF_THE_WIRING)
        options = replace(self.options, forbid=forbidden)
        return replace(self, doubts=doubts, notes=notes, options=options)

    def beside_virtual(self) -> Request:
        """The same request where a virtual controller follows measured positions: without effects of drives,
        sensors and the structure. The clock of the log is tried, which otherwise would pass for an effect of the
        machine."""
        untold = {name for name, effect in self.effects.items() if effect.place not in BESIDE_VIRTUAL}
        options = replace(self.options, forbid=self.options.forbid | untold)
        found = replace(self, options=options, doubts=(*self.doubts, *discovered_beside()))
        return found.noting(NOT_OF_A_VIRTUAL_LOOP)
