"""Estimators, one per file, and the table of their names."""

from collections.abc import Mapping

from fmu_didim.estimators.base import Estimator, Progress, no_progress
from fmu_didim.estimators.clie import Clie
from fmu_didim.estimators.didim import Didim
from fmu_didim.estimators.idim_iv import IdimIv
from fmu_didim.estimators.idim_ls import IdimLs
from fmu_didim.estimators.output_error import OutputError

ESTIMATORS: Mapping[str, type[Estimator]] = {e.name: e for e in (Didim, Clie, IdimLs, IdimIv, OutputError)}

__all__ = ["ESTIMATORS", "Clie", "Didim", "Estimator", "IdimIv", "IdimLs", "OutputError", "Progress", "no_progress"]
