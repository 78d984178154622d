"""Other calibration tools, each in an environment of its own that is made for the run: they need other packages than
this project, and none of them is installed with it."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.tools.versions.environments import MissingToolError, uv

HERE = Path(__file__).parent
LIMIT_S = 3600.0
"""[s] For all rounds of a tool."""


@dataclass(frozen=True)
class Answer:
    """What a tool gave.

    Attributes:
        values: name of each parameter -> value in its best round; seconds: the median of the rounds, its imports not
            counted.
    """

    values: Mapping[str, float]
    seconds: float


@dataclass(frozen=True)
class Peer:
    """A tool.

    Attributes:
        name: of it; script: of this folder, run by its Python; packages: that make its environment.
    """

    name: str
    script: str
    packages: Sequence[str]

    def answer(self, order: Mapping[str, Any]) -> Answer | str:
        """What its script gives for an order, or why there is nothing."""
        with tempfile.TemporaryDirectory() as folder:
            try:
                python = self._environment(Path(folder) / "env")
            except (MissingToolError, subprocess.CalledProcessError, OSError) as error:
                return f"absent: {self.name} cannot be installed here ({_last(error)})"
            file = Path(folder) / "order.json"
            file.write_text(json.dumps(order), encoding="utf-8")
            call = [str(python), str(HERE / self.script), str(file)]
            environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
            try:
                done = subprocess.run(
                    call, cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=True
                )  # fmt: skip
            except (subprocess.SubprocessError, OSError) as error:
                return f"absent: {self.name} ended without an answer ({_last(error)})"
        rounds = json.loads(done.stdout.splitlines()[-1])
        return Answer(rounds[-1]["values"], statistics.median(one["seconds"] for one in rounds))

    def _environment(self, folder: Path) -> Path:
        uv("venv", "--quiet", "--python", sys.executable, str(folder), check=True)
        python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        uv("pip", "install", "--quiet", "--python", str(python), *self.packages)
        return python


def _last(error: Exception) -> str:
    """The last line of what a program said of its end."""
    said = getattr(error, "stderr", None) or str(error)
    return said.strip().splitlines()[-1][:200] if said.strip() else type(error).__name__


MODESTPY = Peer("ModestPy", "with_modestpy.py", ("modestpy==0.1.1", "pandas==1.5.3", "numpy<2"))
"""Abandoned: with today's pandas it does not import."""
ESTIM8 = Peer("estim8", "with_estim8.py", ("estim8==0.1.6",))
