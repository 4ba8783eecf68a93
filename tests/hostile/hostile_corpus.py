"""Bad input of every kind, made by a seed: records, models, tables and excitations.

Each entry has the commands that read it. What is at fault is always a file, never how the command was typed:
every run must end with exit status 3, or with 0 where the file can be read in spite of its fault.
"""

import numpy as np
from bad_json import beside_entries, model_entries
from bad_records import excitation_entries, record_entries
from bad_tables import table_entries
from sound_files import SEED, T, U, Y, csv

MOST = {
    "samples": 90,
    "catalogue": 50,
    "container": 90,
    "type": 60,
    "plant": 90,
    "rational": 50,
    "matrix": 50,
}
MOST |= {"rational z": 20, "pieces": 20, "meta.json": 40, "excitation": 30}
"""Entries of each class in the short form; all of the others."""


def corpus(*, short=False):
    """Every entry, in an order and with contents that depend on the seed alone."""
    rng = np.random.default_rng(SEED)
    entries = [
        *record_entries(rng),
        *excitation_entries(),
        *beside_entries(),
        *model_entries(rng),
        *table_entries(),
    ]
    for entry in entries:
        if any("two.csv" in command for command in entry.commands):
            entry.files["two.csv"] = csv(columns={"t_s": T, "u1": U, "y1": Y, "y2": 2 * Y})
    return shortened(entries) if short else entries


def shortened(entries):
    """Some of each class, evenly over it."""
    of_kind = {}
    for entry in entries:
        of_kind.setdefault(entry.kind, []).append(entry)
    chosen = []
    for kind, listed in of_kind.items():
        n = min(len(listed), MOST.get(kind, len(listed)))
        chosen += [listed[int(i * len(listed) / n)] for i in range(n)]
    return chosen
