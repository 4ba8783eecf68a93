"""Where the measured records are, for the tests that need them."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("GSID_DATA") or Path(__file__).parents[2] / "shared" / "data").resolve()
BENCH = DATA / "twomass_motor_bench"
needs_bench = pytest.mark.skipif(not BENCH.is_dir(), reason=f"no measured records in {BENCH} (set GSID_DATA)")
