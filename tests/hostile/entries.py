"""An entry of the hostile corpus, and the commands that read each kind of file."""

from dataclasses import dataclass, field


@dataclass
class Entry:
    """One bad input: its files by name, what is wrong, and the commands that read it."""

    kind: str  # class of fault
    name: str
    files: dict[str, bytes]
    commands: list[list[str]] = field(default_factory=list)


# For each kind of file those that are quick, then those that take seconds.

RECORD_VERBS = (
    [
        ["frf", "@", "--json"],
        ["noise", "@", "--json"],
        ["distortion", "@"],
        ["fit", "@", "--order", "1/0", "-o", "m.json"],
        ["compare", "--model", "rational.json", "@", "--json"],
        ["frf", "@", "--lpm"],
        ["run", "--port", "none", "--u", "@", "-o", "x.csv"],
        ["distortion", "sound.csv", "--other-level", "@"],
        ["compare", "--model", "plant.json", "@"],
        ["frf", "@", "--window", "30", "-o", "f.mat"],
    ],
    [
        ["fit", "sound.csv", "@", "--order", "auto", "--json"],
        ["report", "@", "-o", "r.html"],
        ["fit", "@", "--model", "plant.json", "--json"],
        ["add", "coulomb_friction", "--model", "plant.json", "sound.csv", "--held-out", "@", "-o", "m.json"],
        ["diagnose", "--model", "plant.json", "@", "-o", "m.json"],
    ],
)
EXCITATION_VERBS = ([["run", "--port", "none", "--u", "@", "-o", "x.csv"], ["frf", "@", "--y", "u"]], [])
DESIGN = (
    "design multisine --fs 1000 --period 60 --band 10:300 --limit-travel-deg 2 --limit-command 500 -o u.csv"
)
PLANT_VERBS = (
    [
        ["compare", "--model", "@", "sound.csv", "--json"],
        ["export-c", "@", "-o", "axis.c"],
        ["add", "--undo", "--model", "@", "-o", "m.json"],
        ["fit", "sound.csv", "--model", "@", "-o", "m.json"],
    ],
    [
        [*DESIGN.split(), "--model", "@"],
        ["add", "coulomb_friction", "--model", "@", "sound.csv", "-o", "m.json"],
        ["report", "sound.csv", "--model", "@", "-o", "r.html"],
        ["diagnose", "--model", "@", "sound.csv", "--json"],
    ],
)
RATIONAL_VERBS = (
    [
        ["compare", "--model", "@", "sound.csv", "--json"],
        ["export-c", "@", "-o", "axis.c", "--json"],
        ["diagnose", "--model", "@", "sound.csv"],
    ],
    [
        ["compare", "--model", "@", "sound.csv", "--plot", "c.svg"],
        ["report", "sound.csv", "--model", "@", "-o", "r.html"],
        [*DESIGN.split(), "--model", "@"],
    ],
)
MATRIX_VERBS = (
    [
        ["compare", "--model", "@", "sound.csv"],
        ["compare", "--model", "@", "--u", "u1", "--y", "y1,y2", "two.csv"],
        ["export-c", "@", "-o", "axis.c"],
    ],
    [],
)
BESIDE_VERBS = ([["frf", "@"], ["compare", "--model", "rational.json", "@"]], [])
TABLE_VERBS = ([["add", "--table", "@", "--model", "plant.json", "sound.csv", "-o", "m.json"]], [])


def read_by(verbs, file, *more, turn=0):
    """The commands with a file's name in the place of @; each turn begins with another of the quick ones."""
    ordered = [part[(turn + i) % len(part)] for part in verbs for i in range(len(part))]
    return [[file if word == "@" else word for word in command] + list(more) for command in ordered]
