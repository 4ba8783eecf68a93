"""An experiment whose step the server could not note: the study gets it later, from a note in its folder.

The note is locked while the server or `gsid run`, which inherits its descriptor, has it open: the lock ends
with the last of them, however they end.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Sequence

from gsid.base.files import write_atomically
from gsid.base.json_files import read_json
from gsid.study.folder import Study
from gsid.webpage.words import INTERRUPTED

NOTE = ".run.json"
SERVER_ENDED = "The server ended during this run, and gsid run stopped the axis."


def note_run(study: Study, number: int, arguments: Sequence[str], record: str) -> int:
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

    Returns
    -------
    int
        Descriptor that holds the lock: the run inherits it, and the caller closes it when the run has ended.
    """
    text = json.dumps({"number": number, "arguments": list(arguments), "record": record})
    write_atomically(study.folder / NOTE, lambda part: part.write_text(text, encoding="utf-8"))
    held = os.open(study.folder / NOTE, os.O_RDWR)
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(held)
        raise
    return held


def has_note(study: Study) -> bool:
    """Whether the step of an experiment is not noted yet."""
    return (study.folder / NOTE).exists()


def forget_run(study: Study) -> None:
    """The step is noted: nothing is left to do."""
    (study.folder / NOTE).unlink(missing_ok=True)


def adopt_run(study: Study, why: str = SERVER_ENDED, exit_code: int = INTERRUPTED) -> str | None:
    """Note the step of an experiment, unless it still runs or still writes its record.

    Parameters
    ----------
    study : Study
    why : str
        Why it was not noted when it ended.
    exit_code : int

    Returns
    -------
    str or None
        None: there is no such experiment, or it has not ended. Otherwise what the page has to report of a
        step that was noted before; empty: nothing.

    Raises
    ------
    InputError
        The study is in use. The note is kept.
    """
    try:
        held = os.open(study.folder / NOTE, os.O_RDWR)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return _adopt(study, why, exit_code)
    except BlockingIOError:
        return None
    finally:
        os.close(held)


def _adopt(study: Study, why: str, exit_code: int) -> str:
    try:
        noted = read_json(study.folder / NOTE)
        number, arguments = int(noted["number"]), [str(word) for word in noted["arguments"]]
        record = str(noted["record"])
    except (ValueError, KeyError, TypeError):  # not a note of this program
        forget_run(study)
        return ""
    report = ""
    if any(step.number == number for step in study.steps):
        if not (study.folder / record).is_file():
            report = f"Step {number} wrote no record. {_kept(study, record)}"
    else:
        study.add_step(
            arguments, exit_code, words=(why, _kept(study, record)), outputs=[record], number=number
        )
    forget_run(study)
    return report


def _kept(study: Study, record: str) -> str:
    if (study.folder / record).is_file():
        return f"Its samples are in {record}."
    journal = f"{record}.journal"
    if (study.folder / journal).is_file():
        return f"Its samples are in {journal}: `gsid run --recover {journal} -o {record}` makes a record."
    return "No sample was kept."
