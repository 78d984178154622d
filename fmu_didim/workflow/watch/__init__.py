"""The verb ``watch``: what has changed over many logs of one machine, and when."""

from fmu_didim.workflow.watch.verb import Watched, watch

__all__ = ["Watched", "watch"]
