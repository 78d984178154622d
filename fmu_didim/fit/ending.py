"""How a fit ended."""

from __future__ import annotations

from enum import Enum


class Ending(Enum):
    """How the steps of a fit ended; the value is a text with advice."""

    NONE = "No steps were made: it is a point of the closed loop."
    SETTLED = "The steps became small."
    NO_STEP = "No step lowers the error any further."
    NOTHING_PROMISED = "No step promised to lower the error by as much as the fit asked for."
    AT_EDGE = "The steps crept along the edge of what can be simulated. Start elsewhere."
    HOPELESS = "It was given up: nothing as good as what is already known was in reach."
    OUT_OF_TIME = "It was given up: its time was over. Allow more time."
    MAXIMUM_ITERATIONS = "The steps did not become small. Allow more iterations, or start nearer to the truth."
