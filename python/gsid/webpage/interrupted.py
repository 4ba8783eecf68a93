"""An experiment whose server ended: the study gets its step when the next server begins."""

from __future__ import annotations

import json
from collections.abc import Sequence

from gsid.base.files import write_atomically
from gsid.base.json_files import read_json
from gsid.study.folder import Study
from gsid.webpage.words import INTERRUPTED

NOTE = ".run.json"


def note_run(study: Study, number: int, arguments: Sequence[str], record: str) -> None:
    """Note that an experiment begins.

    Parameters
    ----------
    study : Study
    number : int
        Of the step.
    arguments : sequence of str
        Words after `gsid`.
    record : str
        File in the study that it writes.
    """
    text = json.dumps({"number": number, "arguments": list(arguments), "record": record})
    write_atomically(study.folder / NOTE, lambda part: part.write_text(text, encoding="utf-8"))


def forget_run(study: Study) -> None:
    """The server has noted the step: nothing is left to do."""
    (study.folder / NOTE).unlink(missing_ok=True)


def adopt_run(study: Study) -> bool:
    """Note the step of an experiment whose server ended; whether there was one."""
    try:
        noted = read_json(study.folder / NOTE)
        number, arguments = int(noted["number"]), [str(word) for word in noted["arguments"]]
        record = str(noted["record"])
    except (OSError, ValueError, KeyError, TypeError):
        return False
    if all(step.number != number for step in study.steps):
        words = ("The server ended during this run, and gsid run stopped the axis.", _kept(study, record))
        study.add_step(arguments, INTERRUPTED, words=words, outputs=[record], number=number)
    forget_run(study)
    return True


def _kept(study: Study, record: str) -> str:
    if (study.folder / record).is_file():
        return f"Its samples are in {record}."
    journal = f"{record}.journal"
    if (study.folder / journal).is_file():
        return f"Its samples are in {journal}: `gsid run --recover {journal} -o {record}` makes a record."
    return "No sample was kept."
