"""Pages that print what commands print: their blocks, and the comparison."""

import re

import numpy as np

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:e[-+]?\d+)?")
# Seeded noise printed to two digits: libm and the optimiser's last steps may turn the last one over.
TOLERANCE = {"rtol": 0.1, "atol": 1e-12}


def blocks(page, language):
    """Texts of a page's blocks in one language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(), re.DOTALL | re.MULTILINE)


def commands(block):
    """Split a console block into (command, what it prints)."""
    parts = re.split(r"^\$ (.*)\n", block, flags=re.MULTILINE)[1:]
    return list(zip(parts[::2], parts[1::2], strict=True))


def assert_same_text(printed, shown):
    """Words exactly, numbers to TOLERANCE; what is shown may end in a line of dots."""
    lines = shown.splitlines()
    if "..." in lines:
        lines = lines[: lines.index("...")]
        shown, printed = "\n".join(lines), "\n".join(printed.splitlines()[: len(lines)])
    assert NUMBER.sub("#", printed.strip()).split() == NUMBER.sub("#", shown.strip()).split()
    numbers = [[float(number) for number in NUMBER.findall(text)] for text in (printed, shown)]
    np.testing.assert_allclose(*numbers, **TOLERANCE)
