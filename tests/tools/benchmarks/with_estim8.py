"""The batch by estim8 as its pages do it: differential evolution, replicates, the likelihood. Run by its Python.

    python with_estim8.py ORDER.json

ORDER.json names the FMU, the tables, the noise, the bounds and how many rounds; the last line that is printed is JSON:
values and seconds of each round. The deviation of a sample is known to it by what was measured, not by what is
simulated, so its optimum is a little elsewhere.
"""

import json
import os
import sys
import time
from pathlib import Path

os.environ["MPLBACKEND"] = "Agg"

import numpy as np
import pandas as pd
from estim8 import Estimator, datatypes
from estim8.models import FmuModel
from estim8.utils import ModelHelpers


def experiment(name: str, path: Path, noise: dict) -> datatypes.Experiment:
    """A replicate: the samples of each output that are there, with their deviations."""
    table, measured = pd.read_csv(path, index_col=0), []
    for output, (absolute, relative) in noise.items():
        taken = table[output].dropna()
        values = taken.to_numpy()
        measured.append(
            datatypes.Measurement(
                name=output, timepoints=taken.index.to_numpy(), values=values, replicate_ID=name,
                errors=np.hypot(absolute, relative * values),
            )
        )  # fmt: skip
    return datatypes.Experiment(measured, replicate_ID=name)


def main(order: dict) -> None:
    """Estimate as often as asked for."""
    model = FmuModel(path=order["fmu"], fmi_type="CoSimulation")
    data = {name: experiment(name, Path(path), order["noise"]) for name, path in order["tables"].items()}
    mapping = [
        ModelHelpers.ParameterMapper(global_name=own["of"], replicate_ID=own["in"], local_name=local)
        for local, own in order["own"].items()
    ]
    estimator = Estimator(
        model=model, bounds=order["bounds"], data=data, t=order["time"], metric="negLL", parameter_mapping=mapping
    )
    rounds = []
    for _ in range(order["rounds"]):
        begin = time.perf_counter()
        values, _ = estimator.estimate(method="de", max_iter=1000, n_jobs=os.cpu_count())
        rounds.append({"seconds": time.perf_counter() - begin, "values": dict(values)})
    print("\n" + json.dumps(rounds))


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
