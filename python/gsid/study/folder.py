"""The folder of a study, which `gsid studio` writes; other commands neither read nor change its session.

    session.json    version, files with their hashes, steps in order
    commands.log    one command a line
    excitation/ records/ responses/ models/ verdicts/

All paths in it are relative to the folder. It is changed under a lock; `session.json` is replaced as a whole.
None of these files and folders is a symbolic link, so that nothing is written elsewhere.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shlex
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from gsid.base.errors import InputError
from gsid.base.files import write_atomically
from gsid.base.json_files import read_json

VERSION = 1
SESSION, LOG, LOCK = "session.json", "commands.log", ".lock"
FOLDERS = ("excitation", "records", "responses", "models", "verdicts")
LOCK_TIME_S = 10.0
BLOCK = 1 << 20
META = "meta.json"  # rate, period and units of the records beside it that it lists
NAME_MOST = 200  # bytes; file systems allow 255, and a number may follow


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
        The folder holds other files but no study, or a study of another version, or symbolic links.
    OSError
        It cannot be made or read.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder).resolve()
        self._refuse_links()
        if not (self.folder / SESSION).exists():
            self._begin()
        self._read()
        self._make_folders()

    def _begin(self) -> None:
        if self.folder.is_dir() and not all(map(_is_of_a_new_study, self.folder.iterdir())):
            hint = "name an empty or a new folder"
            raise InputError("the folder holds files but no study", str(self.folder), None, hint)
        self._make_folders()
        with self._lock():
            if not (self.folder / SESSION).exists():  # another process may have begun it
                self._write(_State())

    def _make_folders(self) -> None:
        """Those that are not there; copies of a study may lack empty folders."""
        for name in FOLDERS:
            (self.folder / name).mkdir(parents=True, exist_ok=True)

    def _refuse_links(self) -> None:
        for name in (SESSION, LOG, LOCK, *FOLDERS):
            if (self.folder / name).is_symlink():
                hint = "replace the link by what it leads to"
                raise InputError("a study has no symbolic links", str(self.folder / name), None, hint)

    # ---- reading -------------------------------------------------------------------------------------

    @property
    def files(self) -> dict[str, str]:
        """Path in the study and SHA-256 of each file that was opened or made; without each `META`."""
        return {name: digest for name, digest in self._read().files.items() if Path(name).name != META}

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
        try:
            found = (self.folder / name).resolve()
            is_inside = found.is_relative_to(self.folder) and found.is_file()
        except (OSError, ValueError, RuntimeError):  # too long, a NUL, a loop of links
            is_inside = False
        if not is_inside:
            raise InputError("no such file in the study", name, None, "open the file in the study first")
        return found

    def _read(self) -> _State:
        path = self.folder / SESSION
        try:
            known = read_json(path)
            version = known["gsid_study"]
            state = _state_of(known) if version == VERSION else None
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError("not the session of a study", str(path), error, "name another folder") from error
        if state is None:
            hint = "use the version of gsid that wrote it"
            raise InputError("the study has another version", str(path), version, hint)
        return state

    # ---- writing -------------------------------------------------------------------------------------

    @contextlib.contextmanager
    def _lock(self) -> Iterator[None]:
        """Other processes wait."""
        self._refuse_links()
        try:
            with FileLock(self.folder / LOCK, timeout=LOCK_TIME_S):
                yield
        except Timeout as error:
            hint = "wait until the other command has ended"
            raise InputError("the study is in use", str(self.folder), None, hint) from error

    def _write(self, state: _State) -> None:
        content = {"gsid_study": VERSION, "files": state.files, "steps": [asdict(one) for one in state.steps]}
        text = json.dumps(content, indent=1) + "\n"
        write_atomically(self.folder / SESSION, lambda part: part.write_text(text, encoding="utf-8"))

    def add_file(self, source: str | Path, name: str = "", kind: str = "records") -> str:
        """Copy a file into the study. The same content is kept once.

        A file that a meta.json beside it lists gets a folder of its own, with this meta.json.

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

        Raises
        ------
        InputError
            The name is not usable (`usable_name`), or the file is a device or a pipe.
        OSError
            It cannot be read or copied.
        """
        if kind not in FOLDERS:
            raise ValueError(f"kind must be one of {', '.join(FOLDERS)}, got {kind}")
        source = Path(source)
        own = usable_name(name or source.name)
        if source.exists() and not source.is_file():
            raise InputError("not a regular file", str(source), None, "name a file")
        meta = _meta_of(source, own)
        with tempfile.TemporaryDirectory(dir=self.folder, prefix=".gsid-") as folder:
            new = Path(folder) / "new"
            new.mkdir()
            write_atomically(new / own, lambda part: shutil.copyfile(source, part))
            digest = _sha256(new / own)
            if meta is not None:
                text = json.dumps(meta, indent=1) + "\n"
                write_atomically(new / META, lambda part: part.write_text(text, encoding="utf-8"))
            with self._lock():
                return self._keep(new, own, digest, meta, kind)

    def _keep(self, new: Path, own: str, digest: str, meta: dict[str, Any] | None, kind: str) -> str:
        """Rename what was copied to its place, unless the study has it."""
        state = self._read()
        for known, other in state.files.items():
            is_alike = known.startswith(f"{kind}/") and Path(known).suffix == Path(own).suffix
            if is_alike and other == digest and self._still_has(known, digest, own, meta):
                return known
        if meta is None:
            place = self._free(f"{kind}/{own}")
            os.replace(new / own, self.folder / place)
        else:
            folder = self._free(f"{kind}/{Path(own).stem}")
            os.replace(new, self.folder / folder)
            place = f"{folder}/{own}"
            state.files[f"{folder}/{META}"] = _sha256(self.folder / folder / META)
        state.files[place] = digest
        self._write(state)
        return place

    def _still_has(self, known: str, digest: str, own: str, meta: dict[str, Any] | None) -> bool:
        """Whether a file has not changed since, and has what the new one's meta.json states."""
        try:
            path = self.path(known)
        except InputError:
            return False
        is_alike = meta is None or _meta_of(path, own) == meta
        return is_alike and _sha256(path) == digest

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
        made = [one for one in outputs if (self.folder / one).is_file()]
        digests = {one: _sha256(self.folder / one) for one in made}
        with self._lock():
            state = self._read()
            number = len(state.steps) + 1
            step = Step(number, arguments[0], tuple(arguments), exit_code, tuple(words), tuple(made))
            state.steps.append(step)
            state.files |= digests
            self._write(state)
            with open(self.folder / LOG, "a", encoding="utf-8") as log:
                log.write(step.command + "\n")
        return step


def usable_name(name: str) -> str:
    """The last part of a path, as the name of a file in a study.

    Parameters
    ----------
    name : str

    Returns
    -------
    str

    Raises
    ------
    InputError
        It is empty, begins with a dot, has control characters, or has more than 200 bytes.
    """
    own = Path(name).name
    if not own or own.startswith(".") or not own.isprintable() or len(own.encode()) > NAME_MOST:
        shown = own.encode("unicode_escape").decode()[:NAME_MOST]
        hint = f"rename the file: no leading dot, no control characters, at most {NAME_MOST} bytes"
        raise InputError("the file has no usable name", "", shown, hint)
    return own


def _is_of_a_new_study(path: Path) -> bool:
    """The lock or an empty folder: all there is if the process ended before the session was written."""
    if path.name == LOCK:
        return path.is_file()
    return path.name in FOLDERS and path.is_dir() and not any(path.iterdir())


def _meta_of(source: Path, own: str) -> dict[str, Any] | None:
    """What the meta.json beside a file states, for this file by its name in the study; None if nothing."""
    try:
        meta = read_json(source.parent / META)
        listed = meta["files"]
        if source.name not in listed:
            return None
    except (OSError, ValueError, KeyError, TypeError):
        return None  # there is none, or it has another purpose
    return meta | {"files": {own: listed[source.name]} if isinstance(listed, dict) else [own]}


def _state_of(known: dict[str, Any]) -> _State:
    files = {str(name): str(digest) for name, digest in known["files"].items()}
    return _State(files, [_step_of(entry) for entry in known["steps"]])


def _step_of(entry: dict[str, Any]) -> Step:
    several = {name: tuple(map(str, entry[name])) for name in ("arguments", "words", "outputs")}
    return Step(int(entry["number"]), str(entry["verb"]), exit_code=int(entry["exit_code"]), **several)


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()
