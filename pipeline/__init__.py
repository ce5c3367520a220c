"""Sequential multi-object grasping as a reproducible data pipeline."""

import os

# Sums split over threads round differently, so results would depend on the machine's cores and on who starts a stage.
# Independent items run in processes of their own instead (pipeline.compute). Read by the libraries when they load.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"):
    os.environ[_variable] = "1"
