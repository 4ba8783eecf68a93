"""The tables' writer is that of the benchmarks. One thread for small matrices, set before numpy is loaded."""

import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))
