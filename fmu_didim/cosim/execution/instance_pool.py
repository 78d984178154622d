"""Instances kept for the next run of the loop."""

from __future__ import annotations

import threading
import weakref
from collections import deque
from collections.abc import Hashable
from typing import Any

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components import Component, Instance

KEPT_ASSEMBLIES = 16
"""[1] Wired systems kept: one is in use by each experiment and thread of an identification, the last few models of a
discovery; they hold little beside their instances."""


class InstancePool:
    """Instances that have run and may run again, each for its component, parameter values aside.

    An instance comes back only if its component can :meth:`~fmu_didim.components.Instance.restart` it. The pool may be
    used by several threads; an instance is in one run at a time. What is left is closed with the pool.

    Args:
        size: instances kept of one component at most.

    Attributes:
        failure: the first error in a run by which a component failed whose equations are not known here.
        slow_runs: number of runs that took long.
        noted: keys of loops that cannot run in one process of their own.
    """

    def __init__(self, *, size: int = 4) -> None:
        self._size = size
        self.failure: FmuDidimError | None = None
        self.slow_runs = 0
        self._kept: dict[Any, list[Any]] = {}
        self.noted: set[Hashable] = set()
        self._assemblies: deque[tuple[object, Any]] = deque(maxlen=KEPT_ASSEMBLIES)
        self._lock = threading.Lock()
        self._end = weakref.finalize(self, _close_all, self._kept)

    def take(self, component: Component, wanted: Instance | None = None) -> Instance:
        """An instance ready for its initialisation: one that was given back, the wanted one before others, or a new
        one."""
        key = component.pool_key()
        while True:
            instance: Instance | None = self.borrow(key, wanted) if key is not None else None
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
        self.put_back(component.pool_key(), instance)

    def borrow(self, key: Hashable, wanted: Any = None) -> Any:
        """The instance or process that was returned under a key, the wanted one before others; None if none is
        waiting."""
        with self._lock:
            waiting = self._kept.get(key, [])
            for i, thing in enumerate(waiting):
                if thing is wanted:
                    return waiting.pop(i)
            return waiting.pop() if waiting else None

    def put_back(self, key: Hashable | None, thing: Any) -> None:
        """Keep something that has a method ``close``, or close it if there is no room or no key."""
        with self._lock:
            waiting = self._kept.setdefault(key, [])
            if key is not None and self._end.alive and len(waiting) < self._size:
                waiting.append(thing)
                return
        thing.close()

    def find_assembly(self, layout: object) -> Any:
        """The assembly of this very layout that was kept last; None without. Others that begin meanwhile do not find
        it. Its instances wait in the pool, unless another system has taken them."""
        with self._lock:
            for i in range(len(self._assemblies) - 1, -1, -1):
                if self._assemblies[i][0] is layout:
                    found = self._assemblies[i][1]
                    del self._assemblies[i]
                    return found
        return None

    def keep_assembly(self, layout: object, assembly: Any) -> None:
        """Keep the parts of a run that is over, whose instances were given back."""
        with self._lock:
            if self._end.alive:
                self._assemblies.append((layout, assembly))

    def close(self) -> None:
        """Close all instances; the pool can still be used, but keeps no further instances."""
        with self._lock:
            self._assemblies.clear()
            self._end()
            self._kept.clear()

    def __getstate__(self) -> dict[str, int]:
        return {"size": self._size}

    def __setstate__(self, state: dict[str, int]) -> None:
        self.__init__(size=state["size"])  # type: ignore[misc]


def _close_all(kept: dict[Any, list[Any]]) -> None:
    for waiting in kept.values():
        while waiting:
            waiting.pop().close()
