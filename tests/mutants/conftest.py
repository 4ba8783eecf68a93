"""The packages of requirements.txt stand behind those of the project."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "build/mutants/packages"))
