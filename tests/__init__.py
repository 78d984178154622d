"""Tests and tools. BLAS has one thread here, as in the verbs (``fmu_didim.model.workers``): matrices are narrow, and
processes side by side would wait for each other's threads, actively (a tenth of the time of the processor is left).
What is imported is compiled once and kept, as where a user works: an environment that forbids it makes each process
that a test or a benchmark starts compile all anew, half of the time of a short command. Git ignores what is written."""

import os
import sys

for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_variable, "1")
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    sys.dont_write_bytecode = False
