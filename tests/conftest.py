"""The test run's environment, set before numba starts its threads."""

import os

# Two workers with two threads each on two cores: waiting threads must sleep, not spin.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
