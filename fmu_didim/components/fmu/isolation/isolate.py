"""FMUs that run in a process of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fmu_didim.components.base import Component, Instance
from fmu_didim.components.fmu.isolation.process import START_LIMIT, Worker
from fmu_didim.components.fmu.isolation.trust import record_trust
from fmu_didim.components.fmu.settings import PROCESS, STATE, FmuSettings
from fmu_didim.data.signals import Array


def _hold(there: Any, component: FmuSettings) -> None:
    """Receive the component: that imports all that it needs, which takes time."""
    there.component = component


def _instantiate(there: Any, keep_new_state: bool) -> None:
    there.instance, there.states = there.component.instantiate_in_process(keep_new_state=keep_new_state), []
    there.closing = [there.instance]


def _restart(there: Any, strategy: str, component: FmuSettings) -> None:
    """Restart in that process, by a new instance where no strategy applies."""
    there.states.clear()
    if not there.instance.restart_by(strategy, component):
        there.instance.close()
        there.instance = component.instantiate_in_process(keep_new_state=strategy == STATE)
        there.closing = [there.instance]


def _call(there: Any, name: str, inputs: bytes | None, arguments: tuple[Any, ...]) -> Any:
    """Call a method of the instance there, with new inputs if any; its saved states stay there, known by number."""
    instance, states = there.instance, there.states
    if inputs is not None:
        instance.inputs[:] = np.frombuffer(inputs)
        instance.set()
    if name == "restore_state":
        arguments = (states[arguments[0]],)
    result = getattr(instance, name)(*arguments)
    if name == "save_state":
        states.append(result)
        return len(states) - 1
    return instance.outputs.tobytes() if name == "get" else result


class IsolatedInstance(Instance):
    """The proxy of an FMU that runs in a process of its own."""

    def __init__(self, component: FmuSettings, time_limit: float, *, keep_new_state: bool = False) -> None:
        self._component, self._stepped = component, False
        self._take(component)
        self._worker = Worker(str(component.path), time_limit)
        try:
            self._worker.request("start", _hold, component, limit=START_LIMIT)
            self._worker.request("instantiate", _instantiate, keep_new_state)
        except BaseException:
            self._worker.close()
            raise

    def _take(self, component: FmuSettings) -> None:
        self.take_variables(component.inputs, component.outputs)
        self._changed = False

    def restart(self, component: Component) -> bool:
        if not isinstance(component, FmuSettings):
            return False
        rerun = component.find_rerun()
        if rerun.strategy == PROCESS:
            return False
        own = replace(component, isolated=False)
        self._worker.request("restart", _restart, rerun.strategy, own)
        self._take(own)
        return True

    def _call(self, name: str, *arguments: Any, when: str = "") -> Any:
        inputs = self.inputs.tobytes() if self._changed else None
        self._changed = False
        return self._worker.request(name + when, _call, name, inputs, arguments)

    def begin_initialisation(self, time: float) -> None:
        self._call("begin_initialisation", time)

    def end_initialisation(self) -> None:
        self._call("end_initialisation")

    def set(self) -> None:
        self._changed = True  # they travel with the next call

    def get(self) -> None:
        self.outputs[:] = np.frombuffer(self._call("get"))

    def step(self, time: float, size: float) -> None:
        self._call("step", time, size, when=f" at t = {time:.6g} s")
        self._stepped = True

    def set_parameters(self, values: Mapping[str, float]) -> None:
        self._call("set_parameters", dict(values))

    def derivatives(
        self, outputs: Sequence[int], inputs: Sequence[int], parameters: Mapping[str, float]
    ) -> tuple[Array, Array]:
        self._changed = True
        found: tuple[Array, Array] = self._call("derivatives", list(outputs), list(inputs), dict(parameters))
        return found

    def save_state(self) -> Any:
        return self._call("save_state")

    def restore_state(self, state: Any) -> None:
        self._call("restore_state", state)

    def close(self) -> None:
        self._worker.close()
        if self._stepped and self._worker.ended_well:
            record_trust(self._component)
