"""Instances kept for the next run of the loop."""

from __future__ import annotations

import threading
import weakref
from typing import Any

from fmu_didim.components import Component, Instance
from fmu_didim.errors import FmuDidimError


class InstancePool:
    """Instances that have run and may run again, each for its component, parameter values aside.

    An instance comes back only if its component can :meth:`~fmu_didim.components.Instance.restart` it. The pool may be
    used by several threads; an instance is in one run at a time. What is left is closed with the pool.

    Args:
        size: instances kept of one component at most.

    Attributes:
        failure: the first error in a run by which a component failed whose equations are not known here.
    """

    def __init__(self, *, size: int = 4) -> None:
        self._size = size
        self.failure: FmuDidimError | None = None
        self._kept: dict[Any, list[Instance]] = {}
        self._lock = threading.Lock()
        self._end = weakref.finalize(self, _close_all, self._kept)

    def take(self, component: Component) -> Instance:
        """An instance ready for its initialisation: one that was given back, or a new one."""
        key = component.pool_key()
        while True:
            with self._lock:
                waiting = self._kept.get(key, []) if key is not None else []
                instance = waiting.pop() if waiting else None
            if instance is None:
                return component.instantiate()
            ready = False
            try:
                ready = instance.restart(component)
            finally:
                if not ready:
                    instance.close()
            if ready:
                return instance

    def give_back(self, component: Component, instance: Instance) -> None:
        """Keep an instance whose run is over."""
        key = component.pool_key()
        with self._lock:
            waiting = self._kept.setdefault(key, [])
            if key is not None and self._end.alive and len(waiting) < self._size:
                waiting.append(instance)
                return
        instance.close()

    def close(self) -> None:
        """Close all instances; the pool can be used on, but keeps nothing any more."""
        with self._lock:
            self._end()
            self._kept.clear()

    def __getstate__(self) -> dict[str, int]:
        return {"size": self._size}

    def __setstate__(self, state: dict[str, int]) -> None:
        self.__init__(size=state["size"])  # type: ignore[misc]


def _close_all(kept: dict[Any, list[Instance]]) -> None:
    for waiting in kept.values():
        while waiting:
            waiting.pop().close()
