"""The verb ``compare``: what has changed between two results."""

from fmu_didim.workflow.compare.verb import Compared, compare

__all__ = ["Compared", "compare"]
