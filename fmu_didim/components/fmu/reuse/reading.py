"""What reading the outputs of an FMU between its inputs and its step does: tried out once, then remembered.

Some FMUs evaluate their model where their solver stands when they are asked there, and go on differently. An output
that does not follow the inputs at once is the same after the step before; there nothing is lost.
"""

from __future__ import annotations

import hashlib
import json
import threading
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

from fmu_didim.base.cache import cache_directory, read_record, write_record
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.reuse import trials
from fmu_didim.components.fmu.reuse.reset import TIME_LIMIT, TrialRunner
from fmu_didim.components.fmu.reuse.trials import AT_ONCE, SAME
from fmu_didim.components.fmu.settings import FmuSettings

_FORMAT = 1
_lock = threading.Lock()
_known: dict[Path, Reading | None] = {}


@dataclass(frozen=True)
class Reading:
    """What reading between inputs and step does.

    Attributes:
        change: largest change of an output in what follows, as a fraction of its largest value.
        place: of that output among the outputs; at_once: places of those that follow the inputs at once.
    """

    change: float
    place: int
    at_once: tuple[int, ...]

    @property
    def acts(self) -> bool:
        """Whether it changes what follows by more than rounding."""
        return self.change > SAME


def find_reading(component: FmuSettings, step: float) -> Reading | None:
    """What reading does, by runs of 50 steps in another process the first time; None where that cannot be tried: the
    FMU does not run so, is not deterministic or hangs.

    Args:
        step: communication step of the loop, s.
    """
    path = _path(component, step)
    with _lock:
        if path not in _known:
            _known[path] = _remembered(path) or _tried(component, step, path)
        return _known[path]


def _remembered(path: Path) -> Reading | None:
    record = read_record(path)
    try:
        return None if record is None else Reading(record["change"], record["place"], tuple(record["at_once"]))
    except (KeyError, TypeError):  # written by another version
        return None


def _tried(component: FmuSettings, step: float, path: Path) -> Reading | None:
    if not component.outputs or not component.inputs:
        return None
    with closing(TrialRunner(component, step, TIME_LIMIT)) as run:
        run.shared = True
        first, again, change, response = (
            run(trial) for trial in (trials.once, trials.once, trials.reading, trials.response)
        )
    if any(isinstance(answer, FmuDidimError) for answer in (first, again, change, response)):
        return None
    if not trials.same(first, again):
        return None
    names = [v.name for v in component.outputs]
    at_once = tuple(i for i, name in enumerate(names) if response[name] == AT_ONCE)
    found = Reading(change[1], names.index(change[0]), at_once)
    write_record(path, asdict(found))
    return found


def _path(component: FmuSettings, step: float) -> Path:
    """Its place in the cache, by content, interface, step and the values that were set: they decide what follows."""
    values = {**component.parameter_values(), **component.start_values}
    what = [_FORMAT, component.digest, component.interface.kind, step, sorted(values.items())]
    key = hashlib.sha256(json.dumps(what).encode()).hexdigest()
    return cache_directory() / "readings" / f"{component.digest}-{key[:16]}.json"
