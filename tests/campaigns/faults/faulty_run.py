"""A run whose process may end; a module of its own, as workers do not look for modules in the current folder."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.campaigns.running import execute as run
from fmu_didim.campaigns.running.execute import Task, execute


def eat(*_: Any) -> dict[str, Any]:
    """Ask for memory without end."""
    return {"all": [np.ones(2**22) for _ in range(10_000)]}


def faulty(process: Any, task: Task) -> dict[str, Any]:
    """The real run, but for seeds whose process ends, hangs, eats memory or is killed once from outside."""
    match task.seed:
        case 11:
            os.abort()
        case 12:
            time.sleep(600)
        case 13:
            run._answer = eat
        case 14 if not (mark := Path(task.content.options["mark"])).exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        case 15:
            os.kill(os.getpid(), signal.SIGKILL)
        case 16:
            sys.exit(3)
    return execute(process, task)
