"""`write_page.py FOLDER` writes docs/reference/thesis_study.md and its pictures from the chapters in FOLDER.

tests/build/test_thesis_study.py compares the page with these sources. It also runs the quick form of the
study and compares its figures with those in quick_figures.json.
"""

import hashlib
import importlib
import json
import sys
import tempfile
from pathlib import Path

from PIL import Image
from thesis_study import AXIS, Row, Study, read_rows

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PAGE = ROOT / "docs/reference/thesis_study.md"
PICTURES = ROOT / "docs/pictures/thesis"
FIGURES = HERE / "quick_figures.json"
CHAPTERS = ("chapter3", "chapter4", "chapter5", "chapter7", "chapter8")
WIDTH_PX, COLOURS = 900, 200
HEAD = f"""# The thesis, measured again

`make thesis` runs the study of the thesis on the simulated axis and writes this page: each number that the
thesis prints in chapters 3 to 7 beside that of gsid, and the pictures. The commands are below each table.

The axis is `gsid simulate` with

    {AXIS}

Its linear part, noise and fan are those of [the simulated axis](../how-to/simulated_axis.md). The thesis
measured another axis: the last column states where a figure depends on the axis and not on the method.
The gyro measures 400.02 times a second by its own clock. Responses end at 200 Hz, half of that rate, since
they contain images above it. The excitations of the thesis reach 250 Hz: the images of 200 to 250 Hz lie at
150 to 200 Hz, drift through each period, and appear as noise there.

Chapter 6 prints no number: its equations have their tests in [the thesis, row by row](thesis.md). σ is a
standard deviation.
"""


def main() -> None:
    """Write the page, the pictures, and the figures of the quick form."""
    folder = Path(sys.argv[1])
    chapters = {name: read_rows(folder / f"{name}.json") for name in CHAPTERS}
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name in CHAPTERS:
        for picture in importlib.import_module(name).PICTURES:
            shrink(folder / f"{picture}.png", PICTURES / f"{picture}.png")
    PAGE.write_text(page(chapters), encoding="utf-8")
    FIGURES.write_text(json.dumps(quick_figures(), indent=1) + "\n", encoding="utf-8")
    print(PAGE)


def page(chapters: dict[str, list[Row]]) -> str:
    """Text of the page."""
    parts = [HEAD]
    for name, rows in chapters.items():
        module = importlib.import_module(name)
        parts += [f"\n## {module.TITLE}\n", table(rows), commands(rows)]
        parts += [
            f"\n![{text}](../pictures/thesis/{file}.png)\n\n{text}\n"
            for file, text in module.PICTURES.items()
        ]
    return "\n".join(parts) + f"\n<!-- sources: {fingerprint()} -->\n"


def table(rows: list[Row]) -> str:
    """Table of a chapter."""
    lines = [f"| {row.place} | {row.what} | {row.thesis} | {row.text()} | {row.why} |" for row in rows]
    return (
        "\n".join(
            ["| place | figure | thesis | gsid | difference |", "| --- | --- | --- | --- | --- |", *lines]
        )
        + "\n"
    )


def commands(rows: list[Row]) -> str:
    """Commands of a chapter, in the order of their first use."""
    used = dict.fromkeys(command for row in rows for command in row.command.split("; "))
    typed = [f"gsid {command}" for command in used if not command.startswith("gsid.")]
    return "\n".join(["```text", *typed, "```"]) + "\n"


def fingerprint() -> str:
    """SHA-256 of the sources of the study."""
    sources = sorted(HERE.glob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()


def quick_figures() -> dict[str, list[str]]:
    """Figures of the quick form, by chapter."""
    with tempfile.TemporaryDirectory() as folder:
        study = Study(Path(folder), quick=True)
        return {name: [row.text() for row in importlib.import_module(name).rows(study)] for name in CHAPTERS}


def shrink(source: Path, to: Path) -> None:
    """Copy a picture with few colours and the width of the page."""
    with Image.open(source) as image:
        height = round(image.height * WIDTH_PX / image.width)
        small = image.convert("RGB").resize((WIDTH_PX, height), Image.Resampling.LANCZOS)
        small.quantize(COLOURS, Image.Quantize.FASTOCTREE).save(to, optimize=True)


if __name__ == "__main__":
    main()
