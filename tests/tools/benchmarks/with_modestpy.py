"""The house by ModestPy with its own settings: its genetic algorithm, then its pattern search. Run by its Python.

    python with_modestpy.py ORDER.json

ORDER.json names the FMU, the tables, the parameters with start and bounds, what is known, and how many rounds; the last
line that is printed is JSON: values and seconds of each round.
"""

import json
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ["MPLBACKEND"] = "Agg"

import pandas as pd
from modestpy import Estimation


def main(order: dict) -> None:
    """Estimate as often as asked for, in an empty folder each time."""
    inputs, measured = (pd.read_csv(order[name]).rename(columns={"t": "time"}) for name in ("inputs", "measured"))
    rounds = []
    for _ in range(order["rounds"]):
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            begin = time.perf_counter()
            session = Estimation(
                folder, order["fmu"], inputs.set_index("time"), order["known"], order["estimated"],
                measured.set_index("time"), modestga_opts={"workers": os.cpu_count()},
            )  # fmt: skip
            values = session.estimate()
            rounds.append({"seconds": time.perf_counter() - begin, "values": dict(values)})
            os.chdir("/")
    print("\n" + json.dumps(rounds))


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
