"""One thread for small matrices: with more they wait for each other. Before numpy is loaded."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
