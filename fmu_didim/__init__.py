"""Identify robots and drives from motor torque alone (DIDIM), and find the physical effect that a model lacks.

The verbs take a case, as a path, as a mapping or loaded by :func:`load_case`:

* :func:`check` says what is wrong with it before any long work;
* :func:`identify` gives parameters with their standard deviations, an :class:`Outcome`;
* :func:`discover` names and adds what the model lacks, a :class:`Discovered`;
* :func:`simulate` runs its loop, a :class:`Trajectory`;
* :func:`export_ssp` writes its loop for other tools.

Many cases at once are a :func:`campaign` or a :func:`study`, whose runs give :class:`Results`.

    case = load_case("case.yaml")
    outcome = identify(case.with_(train={"torque": {"rate_hz": 20}}))
    print(outcome.summary())

All names of this module are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from fmu_didim.version import __version__ as __version__

if TYPE_CHECKING:
    from fmu_didim.campaigns.campaign import Campaign as Campaign
    from fmu_didim.campaigns.campaign import campaign as campaign
    from fmu_didim.campaigns.campaign import study as study
    from fmu_didim.campaigns.results import Results as Results
    from fmu_didim.case import Case as Case
    from fmu_didim.case import load_case as load_case
    from fmu_didim.components import load_fmu as load_fmu
    from fmu_didim.components import to_control as to_control
    from fmu_didim.controllers import read_controller as read_controller
    from fmu_didim.diagnosis.validation import Validation as Validation
    from fmu_didim.diagnosis.validation import validate as validate
    from fmu_didim.discovery.findings import FindingsDocument as FindingsDocument
    from fmu_didim.discovery.findings import load_findings as load_findings
    from fmu_didim.errors import FmuDidimError as FmuDidimError
    from fmu_didim.errors import IdentificationError as IdentificationError
    from fmu_didim.errors import InputError as InputError
    from fmu_didim.errors import SimulationError as SimulationError
    from fmu_didim.estimators import Clie as Clie
    from fmu_didim.estimators import Didim as Didim
    from fmu_didim.estimators import IdimLs as IdimLs
    from fmu_didim.estimators import OutputError as OutputError
    from fmu_didim.export import build_fmu as build_fmu
    from fmu_didim.identification.estimate import Estimate as Estimate
    from fmu_didim.identification.result import ResultDocument as ResultDocument
    from fmu_didim.identification.result import load_result as load_result
    from fmu_didim.master import System as System
    from fmu_didim.prediction.experiment import Experiment as Experiment
    from fmu_didim.prediction.loop_model import LoopModel as LoopModel
    from fmu_didim.robot import RobotDescription as RobotDescription
    from fmu_didim.robot import RobotModel as RobotModel
    from fmu_didim.robot import read_robot as read_robot
    from fmu_didim.robot import write_robot as write_robot
    from fmu_didim.signals import Trajectory as Trajectory
    from fmu_didim.signals import trajectory as trajectory
    from fmu_didim.signals import write_csv as write_csv
    from fmu_didim.ssp import read_ssp as read_ssp
    from fmu_didim.ssp import write_ssp as write_ssp
    from fmu_didim.tables import read_trajectory as read_trajectory
    from fmu_didim.workflow.check import Checked as Checked
    from fmu_didim.workflow.check import check as check
    from fmu_didim.workflow.discover import discover as discover
    from fmu_didim.workflow.discovered import Discovered as Discovered
    from fmu_didim.workflow.export import export_ssp as export_ssp
    from fmu_didim.workflow.identify import identify as identify
    from fmu_didim.workflow.outcome import Outcome as Outcome
    from fmu_didim.workflow.simulate import simulate as simulate
else:
    _NAMES = {
        "campaigns.campaign": ("Campaign", "campaign", "study"),
        "campaigns.results": ("Results",),
        "case": ("Case", "load_case"),
        "components": ("load_fmu", "to_control"),
        "controllers": ("read_controller",),
        "diagnosis.validation": ("Validation", "validate"),
        "discovery.findings": ("FindingsDocument", "load_findings"),
        "errors": ("FmuDidimError", "IdentificationError", "InputError", "SimulationError"),
        "estimators": ("Clie", "Didim", "IdimLs", "OutputError"),
        "export": ("build_fmu",),
        "identification.estimate": ("Estimate",),
        "identification.result": ("ResultDocument", "load_result"),
        "master": ("System",),
        "prediction.experiment": ("Experiment",),
        "prediction.loop_model": ("LoopModel",),
        "robot": ("RobotDescription", "RobotModel", "read_robot", "write_robot"),
        "signals": ("Trajectory", "trajectory", "write_csv"),
        "ssp": ("read_ssp", "write_ssp"),
        "tables": ("read_trajectory",),
        "workflow": ("Checked", "Discovered", "Outcome", "check", "discover", "export_ssp", "identify", "simulate"),
    }
    _HOMES = {name: f"fmu_didim.{home}" for home, names in _NAMES.items() for name in names}
    __all__ = sorted(_HOMES)

    def __getattr__(name: str) -> object:
        import importlib

        if name not in _HOMES:
            raise AttributeError(f"module 'fmu_didim' has no attribute '{name}'; it has {', '.join(__all__)}")
        return getattr(importlib.import_module(_HOMES[name]), name)

    def __dir__() -> list[str]:
        return __all__
