"""The folder of a study, which the page and the command line share.

    session.json    version, files with their hashes, steps in order
    commands.log    one command a line
    excitation/ records/ responses/ models/ verdicts/

All paths in it are relative to the folder. It is changed under a lock; `session.json` is replaced as a whole.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shlex
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from gsid.base.errors import InputError
from gsid.base.files import write_atomically

VERSION = 1
SESSION, LOG, LOCK = "session.json", "commands.log", ".lock"
FOLDERS = ("excitation", "records", "responses", "models", "verdicts")
LOCK_TIME_S = 10.0
BLOCK = 1 << 20


@dataclass(frozen=True)
class Step:
    """One command of a study and what it made.

    Attributes
    ----------
    number : int
        From 1 on.
    verb : str
    arguments : tuple of str
        Words after `gsid`, with paths relative to the study.
    exit_code : int
    words : tuple of str
        The result in sentences.
    outputs : tuple of str
        Files that it wrote, relative to the study.
    """

    number: int
    verb: str
    arguments: tuple[str, ...]
    exit_code: int
    words: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    @property
    def command(self) -> str:
        """The command as typed in the folder of the study."""
        return shlex.join(["gsid", *self.arguments])


@dataclass
class _State:
    files: dict[str, str] = field(default_factory=dict)  # path in the study: SHA-256
    steps: list[Step] = field(default_factory=list)


class Study:
    """A study in a folder.

    Parameters
    ----------
    folder : path_like
        Made if it does not exist.

    Raises
    ------
    InputError
        The folder holds other files but no study, or a study of a later version.
    OSError
        It cannot be made or read.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder).resolve()
        if not (self.folder / SESSION).exists():
            self._begin()
        self._read()

    def _begin(self) -> None:
        if self.folder.is_dir() and any(self.folder.iterdir()):
            hint = "name an empty or a new folder"
            raise InputError("the folder holds files but no study", str(self.folder), None, hint)
        for name in FOLDERS:
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        self._write(_State())

    # ---- reading -------------------------------------------------------------------------------------

    @property
    def files(self) -> dict[str, str]:
        """Path in the study and SHA-256 of each file that was opened."""
        return self._read().files

    @property
    def steps(self) -> list[Step]:
        """All steps in order."""
        return self._read().steps

    def path(self, name: str) -> Path:
        """A file of the study.

        Parameters
        ----------
        name : str
            Relative to the study.

        Raises
        ------
        InputError
            It lies outside, or a symbolic link leads outside, or it does not exist.
        """
        found = (self.folder / name).resolve()
        if not found.is_relative_to(self.folder) or not found.is_file():
            raise InputError("no such file in the study", name, None, "open the file in the study first")
        return found

    def _read(self) -> _State:
        path = self.folder / SESSION
        try:
            known = json.loads(path.read_text(encoding="utf-8"))
            version = known["gsid_study"]
            steps = [_step_of(entry) for entry in known["steps"]]
            state = _State({str(name): str(digest) for name, digest in known["files"].items()}, steps)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError("not the session of a study", str(path), error, "name another folder") from error
        if version != VERSION:
            hint = "use the version of gsid that wrote it"
            raise InputError("the study has another version", str(path), version, hint)
        return state

    # ---- writing -------------------------------------------------------------------------------------

    @contextlib.contextmanager
    def _changing(self) -> Iterator[_State]:
        """The state, to change; other processes wait."""
        try:
            with FileLock(self.folder / LOCK, timeout=LOCK_TIME_S):
                state = self._read()
                yield state
                self._write(state)
        except Timeout as error:
            hint = "wait until the other command has ended"
            raise InputError("the study is in use", str(self.folder), None, hint) from error

    def _write(self, state: _State) -> None:
        content = {"gsid_study": VERSION, "files": state.files, "steps": [asdict(one) for one in state.steps]}
        text = json.dumps(content, indent=1) + "\n"
        write_atomically(self.folder / SESSION, lambda part: part.write_text(text, encoding="utf-8"))

    def add_file(self, source: str | Path, name: str = "", kind: str = "records") -> str:
        """Copy a file into the study. The same content is kept once.

        Parameters
        ----------
        source : path_like
        name : str, optional
            Name in the study; default that of the file. A name that another content has gets a number.
        kind : str
            One of `FOLDERS`.

        Returns
        -------
        str
            Path in the study.
        """
        if kind not in FOLDERS:
            raise ValueError(f"kind must be one of {', '.join(FOLDERS)}, got {kind}")
        own = Path(name or source).name
        digest = _sha256(Path(source))
        with self._changing() as state:
            for known, other in state.files.items():
                if (
                    other == digest
                    and known.startswith(f"{kind}/")
                    and Path(known).suffix == Path(own).suffix
                ):
                    return known
            place = self._free(f"{kind}/{own}")
            write_atomically(self.folder / place, lambda part: shutil.copyfile(source, part))
            state.files[place] = digest
        return place

    def _free(self, wanted: str) -> str:
        """This path, or with a number if the study has it."""
        path, number = Path(wanted), 2
        place = wanted
        while (self.folder / place).exists():
            place = str(path.with_stem(f"{path.stem}-{number}"))
            number += 1
        return place

    def next_number(self) -> int:
        """Number of the next step."""
        return len(self.steps) + 1

    def add_step(
        self,
        arguments: Sequence[str],
        exit_code: int,
        *,
        words: Sequence[str] = (),
        outputs: Sequence[str] = (),
    ) -> Step:
        """Note a command that has ended.

        Parameters
        ----------
        arguments : sequence of str
            Words after `gsid`.
        exit_code : int
        words : sequence of str
        outputs : sequence of str

        Returns
        -------
        Step
        """
        with self._changing() as state:
            number = len(state.steps) + 1
            made = [one for one in outputs if (self.folder / one).is_file()]
            step = Step(number, arguments[0], tuple(arguments), exit_code, tuple(words), tuple(made))
            state.steps.append(step)
            for one in made:
                state.files[one] = _sha256(self.folder / one)
            with open(self.folder / LOG, "a", encoding="utf-8") as log:
                log.write(step.command + "\n")
        return step


def _step_of(entry: dict[str, Any]) -> Step:
    several = {name: tuple(map(str, entry[name])) for name in ("arguments", "words", "outputs")}
    return Step(int(entry["number"]), str(entry["verb"]), exit_code=int(entry["exit_code"]), **several)


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()
