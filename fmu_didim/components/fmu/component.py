"""FMUs as components."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from typing import Any

from fmu_didim.components.base import Component, Instance, start_names
from fmu_didim.components.fmu.cvode import CVODE_TOLERANCE
from fmu_didim.components.fmu.description import CO_SIMULATION, FLOAT_TYPES, MODEL_EXCHANGE
from fmu_didim.components.fmu.events import EventInstance
from fmu_didim.components.fmu.instance import CoSimulationInstance, FmuInstance
from fmu_didim.components.fmu.isolation.isolate import IsolatedInstance
from fmu_didim.components.fmu.isolation.trust import is_trusted, log_isolation, mark_running
from fmu_didim.components.fmu.model_exchange import ModelExchangeInstance
from fmu_didim.components.fmu.reuse.reset import find_rerun, known_rerun
from fmu_didim.components.fmu.settings import AGAIN, AUTO, DEFAULT_SUBSTEPS, PROCESS, STATE, FmuSettings, Rerun
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.export.variables import SUBSTEPS_NAME, TOLERANCE_NAME

USUAL_TOLERANCE = 1e-6
"""[1] Relative tolerance of solvers inside FMUs that name none, as Dymola, OpenModelica and FMUs that are exported here
take it by default."""


@dataclass(frozen=True)
class FmuComponent(FmuSettings):
    """An FMU as a component; made by :func:`fmu_didim.components.fmu.load_fmu`.

    Attributes:
        block: the equations from which the FMU was built, if it was built here.
    """

    block: Block | None = field(default=None, compare=False, repr=False)

    def with_names(self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]) -> FmuComponent:
        return replace(self, inputs=inputs, outputs=outputs)

    def with_substeps(self, count: int) -> FmuComponent | None:
        if self.interface.kind == MODEL_EXCHANGE:
            return self.of_other_values(substeps=count) if self.solver == "rk4" else None
        if SUBSTEPS_NAME not in self.option_types:
            return None
        return self.of_other_values(options={**self.options, SUBSTEPS_NAME: count})

    @property
    def stated_substeps(self) -> int | None:
        if self.interface.kind == MODEL_EXCHANGE:
            return self.substeps
        return int(self.options.get(SUBSTEPS_NAME, 0)) or None

    def pool_key(self) -> Hashable:
        how = (self.interface.kind, self.solver, self.substeps, self.event_mode, self.rerun)
        where = (self.isolated, self.time_limit_s, self.tolerance)
        names = (self.ports.inputs, self.ports.outputs)
        return (self.digest, how, where, self.input_references, self.output_references, names)

    def response_key(self) -> Hashable | None:
        if self.block is None:
            return None
        values = tuple(v.start for v in (*self.inputs, *self.parameters))
        return self.pool_key(), values, *(tuple(sorted(known.items())) for known in (self.options, self.start_values))

    def instantiate(self) -> Instance:
        rerun = known_rerun(self)
        keep = rerun is not None and rerun.strategy == STATE
        if self._must_be_isolated(rerun):
            if self.isolated is None and self.rerun == AUTO and rerun is not None:
                log_isolation(self, rerun)
            return IsolatedInstance(replace(self, isolated=False, block=None), self.time_limit_s, keep_new_state=keep)
        if not self.is_own:
            mark_running(self)
        return self.instantiate_in_process(keep_new_state=keep)

    def _must_be_isolated(self, rerun: Rerun | None) -> bool:
        if self.isolated is not None:
            return self.isolated
        return rerun is not None and rerun.isolated

    def needs_own_process(self, instances: int = 1) -> bool:
        """Whether so many instances of it may crash their process, so that loops with them run in a process of their
        own."""
        rerun = known_rerun(self)
        if self._must_be_isolated(rerun):
            return True
        return self.isolated is None and not self.is_own and not is_trusted(self, instances)

    @property
    def takes_any_step(self) -> bool:
        return self.interface.kind == MODEL_EXCHANGE or self.interface.has_variable_step

    @property
    def follows_ramps(self) -> bool:
        return self.interface.kind == MODEL_EXCHANGE and all(kind in FLOAT_TYPES for kind in self.input_types)

    def for_separate_process(self, *, run_before: bool) -> tuple[FmuComponent, Rerun | None]:
        """The FMU to send to a process of loops, and how it is run again there, as far as that is known here.

        Args:
            run_before: whether it has run there before, so that the way to run it again matters; else it is not asked.
        """
        rerun = self.find_rerun() if run_before else known_rerun(self)
        way = AUTO if rerun is None else AGAIN if rerun.strategy == PROCESS else rerun.strategy
        return replace(self, isolated=False, rerun=way), rerun

    def instantiate_in_process(self, *, keep_new_state: bool = False) -> FmuInstance:
        if self.interface.kind == MODEL_EXCHANGE:
            return ModelExchangeInstance(self, keep_new_state=keep_new_state)
        if self.event_mode:
            return EventInstance(self, keep_new_state=keep_new_state)
        return CoSimulationInstance(self, keep_new_state=keep_new_state)

    def find_rerun(self) -> Rerun:
        return find_rerun(self)

    def built_from(self, block: Block) -> FmuComponent:
        """The same FMU with what only the block knows: its sample time and its equations."""
        return replace(self, sample_time=block.sample_time, block=block)

    def equations(self) -> tuple[Block, int | None] | None:
        if self.block is None or self.interface.kind == MODEL_EXCHANGE or self.event_mode:
            return None
        if len(self.parameters) != len(self.block.parameters):
            return None  # a start value has become a parameter
        if (self.options.get(TOLERANCE_NAME) or self.tolerance) and self.stated_substeps is None:
            return None  # the FMU takes more substeps than the rule
        return self.block.with_variables(self.inputs, self.outputs, self.parameters), self.stated_substeps

    @property
    def start_parameters(self) -> tuple[str, ...]:
        return start_names(self.fixed) if self.is_own else ()

    @property
    def start_candidates(self) -> tuple[str, ...]:
        return self.start_parameters if self.is_own else (*(v.name for v in self.parameters), *self.start_values)

    def describe(self) -> dict[str, Any]:
        rerun = known_rerun(self) or Rerun(AUTO, "not found out yet: that is done before the first run again")
        described: dict[str, Any] = {
            "kind": "fmu",
            "file": self.path.name,
            "sha256": self.digest,
            "guid": self.fmu.token,
            "fmi_version": self.fmu.version,
            "interface": self.interface.kind,
            "reset": rerun.strategy,
            "reset_reason": rerun.reason,
            "options": dict(self.options),
        }
        if self.tolerance is not None:
            described["tolerance"] = self.tolerance
        if self.event_mode:
            described["event_mode"] = True
        if self.interface.has_derivatives and not self.has_derivatives:
            described["derivatives"] = "differences"
        if not self.reads_between:
            described["outputs"] = "those after the last step"
        if self.interface.kind == MODEL_EXCHANGE:
            described["solver"] = self.solver
            if self.solver == "rk4":
                described["substeps"] = self.substeps or DEFAULT_SUBSTEPS
        return described | ({"isolated": True} if self._must_be_isolated(rerun) else {})


def solver_tolerance(component: Component) -> float:
    """Relative tolerance of the solver that integrates an FMU with steps that are not known here: CVode in model
    exchange; in co-simulation the one that it is given or that its file names, else what tools take by default; 0
    where the steps are known."""
    form = component.compiled()
    if not isinstance(form, FmuComponent):
        return 0.0
    if form.interface.kind == MODEL_EXCHANGE:
        return CVODE_TOLERANCE if form.solver == "cvode" else 0.0
    if form.is_own and (form.equations() is not None or form.sample_time is not None):
        return 0.0
    given = form.options.get(TOLERANCE_NAME) or form.tolerance or form.fmu.experiment.tolerance
    return float(given or USUAL_TOLERANCE)


def own_step(component: Component) -> float | None:
    """Step in s of the solver inside an FMU of another tool in co-simulation, as its file states it: that of FMI 3.0,
    else that of its default experiment, which is the step of a solver that has a fixed one; None without."""
    form = foreign_co_simulation(component)
    return None if form is None else form.interface.own_step or form.fmu.experiment.step


def foreign_co_simulation(component: Component) -> FmuComponent | None:
    """The FMU of another tool that a component runs in co-simulation, by a solver that is unknown here; None if it
    does not run one."""
    form = component.compiled()
    if not isinstance(form, FmuComponent) or form.is_own or form.interface.kind != CO_SIMULATION:
        return None
    return form
