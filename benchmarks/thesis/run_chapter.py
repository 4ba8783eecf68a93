"""Run one chapter: `run_chapter.py chapter3 FOLDER` writes FOLDER/chapter3.json and its pictures."""

import importlib
import sys
from pathlib import Path

from thesis_study import Study, write_rows

if __name__ == "__main__":
    name, folder = sys.argv[1], Path(sys.argv[2])
    write_rows(folder / f"{name}.json", importlib.import_module(name).rows(Study(folder)))
