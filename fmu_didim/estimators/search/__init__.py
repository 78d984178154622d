"""More than one start: local minima from starts all over the bounds, and global search, whose best is refined.

bounds -> starts (p,) -> crew: local fits, side by side -> minima, told apart -> the best is the answer
"""

from fmu_didim.estimators.search.best import searched
from fmu_didim.estimators.search.crew import Crew, Ended, InThisProcess, check_minima, from_values
from fmu_didim.estimators.search.options import Search
from fmu_didim.estimators.search.processes import crew_of
from fmu_didim.estimators.search.profiles import profiled
from fmu_didim.estimators.search.reduced import check_reducible, with_essential

__all__ = [
    "Crew", "Ended", "InThisProcess", "Search", "check_minima", "check_reducible", "crew_of", "from_values", "profiled",
    "searched", "with_essential",
]  # fmt: skip
