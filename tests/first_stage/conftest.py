"""One thread for small matrices; before numpy is loaded. The trials are those of tests/blind."""

import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.append(str(Path(__file__).resolve().parents[1] / "blind"))
