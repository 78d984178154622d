"""Tests and tools. BLAS has one thread here, as in the verbs (``fmu_didim.model.workers``): matrices are narrow, and
processes side by side would wait for each other's threads, actively (a tenth of the time of the processor is left)."""

import os

for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_variable, "1")
