"""The folder of a study, which `gsid studio` and `gsid -C DIR VERB` share.

    session.json    version, files with their hashes, experiments, steps in order
    commands.log    one command a line, of the steps that can be repeated
    excitation/ records/ responses/ models/ verdicts/

All paths in it are relative to the folder. It is changed under a lock; `session.json` and `commands.log` are
replaced as a whole, the session first: whenever the process ends, the study can be read. None of these files
and folders is a symbolic link, so that nothing is written elsewhere.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import shlex
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from gsid.base.arguments import is_one_line
from gsid.base.errors import InputError
from gsid.base.files import TEMPORARY, write_atomically
from gsid.base.json_files import read_json

VERSION = 2
READ = (1, VERSION)  # the next change writes the present version
SESSION, LOG, LOCK = "session.json", "commands.log", ".lock"
FOLDERS = ("excitation", "records", "responses", "models", "verdicts")
LOCK_TIME_S = 10.0
BLOCK = 1 << 20
NOISE_MODEL = "-noise.json"  # end of the name of a noise model
ZERO_INPUT = "--zero"  # option of `gsid run` whose record shows noise alone
META = "meta.json"  # rate, period and units of the records beside it that it lists
NAME_MOST = 200  # bytes; file systems allow 255, and a number may follow
GOOD, CRITERION, INTERRUPTED = 0, 1, 130  # exit codes of commands with a result


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
    answer : str
        File with the JSON that it printed, relative to the study; empty: none.
    """

    number: int
    verb: str
    arguments: tuple[str, ...]
    exit_code: int
    words: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    answer: str = ""

    @property
    def command(self) -> str:
        """The command as typed in the folder of the study."""
        return shlex.join(["gsid", *self.arguments])

    @property
    def has_result(self) -> bool:
        """Whether it ended well, failed its criterion, or was stopped after it had written a file."""
        return self.exit_code in (GOOD, CRITERION) or (self.exit_code == INTERRUPTED and bool(self.outputs))

    @property
    def picture(self) -> str:
        """The plotly figure that it drew; empty: none."""
        drawn = (one for one in self.outputs if one.startswith("verdicts/") and one.endswith(".json"))
        return next(drawn, "")


@dataclass
class _State:
    files: dict[str, str] = field(default_factory=dict)  # path in the study: SHA-256
    steps: list[Step] = field(default_factory=list)
    experiments: list[list[str]] = field(default_factory=list)  # paths of records, the last experiment last
    n_numbers: int = 0  # of steps that have ended or have begun

    def note(self, name: str, digest: str) -> None:
        """Note a file as the newest."""
        self.files.pop(name, None)
        self.files[name] = digest

    def begin_experiment(self, records: Sequence[str]) -> None:
        """Make these records the last experiment."""
        records = list(dict.fromkeys(records))
        if records and (not self.experiments or self.experiments[-1] != records):
            self.experiments.append(records)


class Study:
    """A study in a folder.

    Parameters
    ----------
    folder : path_like
    create : bool
        Whether to make it if it does not exist or is empty.

    Raises
    ------
    InputError
        The folder holds other files but no study, or a study of another version, or symbolic links; or there
        is no study and `create` is false.
    OSError
        It cannot be made or read.
    """

    def __init__(self, folder: str | Path, *, create: bool = True) -> None:
        self.folder = Path(folder).resolve()
        self._refuse_links()
        if not (self.folder / SESSION).exists():
            if not create:
                hint = f"`{shlex.join(['gsid', '-C', str(folder), 'open'])} [FILES]...` makes one"
                raise InputError("the folder is not a study", str(folder), None, hint)
            self._begin()
        self._read()
        if os.access(self.folder, os.W_OK):
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

    @property
    def stamp(self) -> tuple[int, int]:
        """Changes with each change of the session; (0, 0) if it cannot be read."""
        try:
            known = (self.folder / SESSION).stat()
        except OSError:
            return 0, 0
        return known.st_ino, known.st_mtime_ns

    @property
    def last_experiment(self) -> list[str]:
        """Records that were opened or measured together last, relative to the study."""
        experiments = self._read().experiments
        return list(experiments[-1]) if experiments else []

    @property
    def models(self) -> list[str]:
        """All models, the newest last, relative to the study."""
        return [name for name in self.files if name.startswith("models/") and name.endswith(".json")]

    @property
    def noise_model(self) -> str:
        """The noise model that was made last, relative to the study; empty: none."""
        return next((name for name in reversed(self.files) if name.endswith(NOISE_MODEL)), "")

    @property
    def newest_models(self) -> list[str]:
        """The model that was made or opened last; several if they were opened since a step made one."""
        models = self.models
        made = {name for step in self.steps for name in step.outputs}
        newest = [len(models) - 1, *(i for i, name in enumerate(models) if name in made)]
        first = max(newest[1:], default=-1) + 1
        return models[first:] or models[-1:]

    def answer(self, step: Step) -> dict[str, Any] | None:
        """The JSON that a step printed; None if it printed none, or if the file cannot be read."""
        if not step.answer:
            return None
        try:
            found = read_json(self.path(step.answer))
        except (InputError, OSError, ValueError):
            return None
        return found if isinstance(found, dict) else None

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
            state = _state_of(known) if version in READ else None
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError("not the session of a study", str(path), error, "name another folder") from error
        if state is None:
            hint = f"use the version of gsid that wrote it; this one reads {', '.join(map(str, READ))}"
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
        except OSError as error:
            if error.errno not in (errno.EACCES, errno.EROFS, errno.EPERM):
                raise
            hint = "make the folder writable, or copy the study"
            raise InputError("the study cannot be written", str(self.folder), error.strerror, hint) from error

    def _write(self, state: _State) -> None:
        content = {
            "gsid_study": VERSION,
            "files": state.files,
            "experiments": state.experiments,
            "n_numbers": state.n_numbers,
            "steps": [asdict(one) for one in state.steps],
        }
        text = json.dumps(content, indent=1) + "\n"
        write_atomically(self.folder / SESSION, lambda part: part.write_text(text, encoding="utf-8"))

    def open_files(self, sources: Sequence[str | Path], kind: str = "records") -> list[str]:
        """Copy files into the study. Records become the last experiment, together.

        Parameters
        ----------
        sources : sequence of path_like
        kind : str
            One of `FOLDERS`.

        Returns
        -------
        list of str
            Paths in the study.

        Raises
        ------
        InputError, OSError
            As `add_file`.
        """
        kept = [self.add_file(source, kind=kind, experiment=None) for source in sources]
        if kind == "records":
            self.begin_experiment(kept)
        return kept

    def begin_experiment(self, records: Sequence[str]) -> None:
        """Make these records of the study the last experiment."""
        with self._lock():
            state = self._read()
            state.begin_experiment(records)
            self._write(state)

    def add_file(
        self,
        source: str | Path,
        name: str = "",
        kind: str = "records",
        experiment: str | None = "new",
    ) -> str:
        """Copy a file into the study. The same content is kept once.

        A file that a meta.json beside it lists gets a folder of its own, with this meta.json.

        Parameters
        ----------
        source : path_like
        name : str, optional
            Name in the study; default that of the file. A name that another content has gets a number.
        kind : str
            One of `FOLDERS`.
        experiment : {"new", "last"} or None
            Of a record: whether it is a new experiment, joins the last one, or belongs to none.

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
        with tempfile.TemporaryDirectory(dir=self.folder, prefix=TEMPORARY) as folder:
            new = Path(folder) / "new"
            new.mkdir()
            write_atomically(new / own, lambda part: shutil.copyfile(source, part))
            digest = _sha256(new / own)
            if meta is not None:
                text = json.dumps(meta, indent=1) + "\n"
                write_atomically(new / META, lambda part: part.write_text(text, encoding="utf-8"))
            with self._lock():
                state = self._read()
                place = self._keep(state, new, own, digest, meta, kind)
                if kind == "records" and experiment is not None:
                    with_last = state.experiments[-1] if experiment == "last" and state.experiments else []
                    state.begin_experiment(list(dict.fromkeys([*with_last, place])))
                self._write(state)
            return place

    def _keep(
        self, state: _State, new: Path, own: str, digest: str, meta: dict[str, Any] | None, kind: str
    ) -> str:
        """Rename what was copied to its place, unless the study has it."""
        for known, other in state.files.items():
            is_alike = known.startswith(f"{kind}/") and Path(known).suffix == Path(own).suffix
            if is_alike and other == digest and self._still_has(known, digest, own, meta):
                state.note(known, digest)
                return known
        if meta is None:
            place = self._free(f"{kind}/{own}")
            os.replace(new / own, self.folder / place)
        else:
            folder = self._free(f"{kind}/{Path(own).stem}")
            os.replace(new, self.folder / folder)
            place = f"{folder}/{own}"
            state.note(f"{folder}/{META}", _sha256(self.folder / folder / META))
        state.note(place, digest)
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

    def begin_step(self) -> int:
        """Number of a step that begins, for the names of its files. No other step gets it."""
        with self._lock():
            state = self._read()
            state.n_numbers += 1
            while any(any((self.folder / name).glob(f"{state.n_numbers}-*")) for name in FOLDERS):
                state.n_numbers += 1  # of a step that an older version began
            self._write(state)
        return state.n_numbers

    def cancel_step(self, number: int) -> None:
        """Give back the number of a step that has written nothing, unless another one has begun since."""
        with self._lock():
            state = self._read()
            if number == state.n_numbers:
                state.n_numbers -= 1
                self._write(state)

    def add_step(
        self,
        arguments: Sequence[str],
        exit_code: int,
        *,
        words: Sequence[str] = (),
        outputs: Sequence[str] = (),
        answer: bytes = b"",
        verb: str = "",
        number: int | None = None,
    ) -> Step:
        """Note a command that has ended.

        Parameters
        ----------
        arguments : sequence of str
            Words after `gsid`.
        exit_code : int
        words : sequence of str
        outputs : sequence of str
            Those that do not exist are left out. Records become the last experiment, unless they are of
            `gsid run --zero`.
        answer : bytes
            The JSON object that it printed. It is kept in verdicts/; other bytes are not.
        verb : str, optional
            Default the first of the arguments.
        number : int, optional
            From `begin_step`; default a new one.

        Returns
        -------
        Step

        Raises
        ------
        InputError
            A word has a character that cannot be printed: a command is one line of the log.
        """
        check_words((*arguments, *outputs))
        verb, number = verb or arguments[0], self.begin_step() if number is None else number
        made = tuple(one for one in outputs if (self.folder / one).is_file())
        kept = self._keep_answer(f"verdicts/{number}-{verb}.answer.json", answer)
        digests = {one: _sha256(self.folder / one) for one in (*made, *([kept] if kept else []))}
        step = Step(number, verb, tuple(arguments), exit_code, tuple(words), made, kept)
        with self._lock():
            state = self._read()
            state.steps = sorted([*state.steps, step], key=lambda one: one.number)
            state.n_numbers = max(state.n_numbers, number)
            for name, digest in digests.items():
                state.note(name, digest)
            if ZERO_INPUT not in arguments:
                state.begin_experiment([one for one in made if one.startswith("records/")])
            self._write(state)
            self._write_log(state)
        return step

    def _keep_answer(self, place: str, answer: bytes) -> str:
        """Write the answer of a step; its place, or nothing if it is no JSON object."""
        try:
            if not isinstance(json.loads(answer), dict):
                return ""
        except ValueError:
            return ""
        write_atomically(self.folder / place, lambda part: part.write_bytes(answer))
        return place

    def _write_log(self, state: _State) -> None:
        """All commands again: a process that ended between session and log loses no line."""
        text = "".join(f"{step.command}\n" for step in state.steps if step.has_result)
        write_atomically(self.folder / LOG, lambda part: part.write_text(text, encoding="utf-8"))


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
    if not own or own.startswith(".") or not is_one_line(own) or len(own.encode()) > NAME_MOST:
        shown = own.encode("unicode_escape").decode()[:NAME_MOST]
        hint = f"rename the file: no leading dot, no control characters, at most {NAME_MOST} bytes"
        raise InputError("the file has no usable name", "", shown, hint)
    return own


def check_words(words: Iterable[str]) -> None:
    """Refuse words that are not one line of commands.log.

    Parameters
    ----------
    words : iterable of str

    Raises
    ------
    InputError
        One has a character that cannot be printed, as a line break.
    """
    for word in words:
        if not is_one_line(word):
            hint = "leave out line breaks, tabs and control characters"
            raise InputError("a word of the command cannot be printed", "", f"{word[:NAME_MOST]!a}", hint)


def _is_of_a_new_study(path: Path) -> bool:
    """The lock, an empty folder or an unfinished session: all there is if the process ended before it was."""
    if path.name == LOCK or path.name.startswith(TEMPORARY):
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
    files = {_printable(name): _printable(digest) for name, digest in known["files"].items()}
    steps = [_step_of(entry) for entry in known["steps"]]
    if known["gsid_study"] == 1:  # it had neither: all its records were one list
        records = [name for name in files if name.startswith("records/") and Path(name).name != META]
        return _State(files, steps, [records] if records else [], max((s.number for s in steps), default=0))
    experiments = [list(map(_printable, records)) for records in known["experiments"]]
    return _State(files, steps, experiments, int(known["n_numbers"]))


def _step_of(entry: dict[str, Any]) -> Step:
    several = {name: tuple(map(_printable, entry[name])) for name in ("arguments", "outputs")}
    own = {"exit_code": int(entry["exit_code"]), "answer": _printable(entry.get("answer", ""))}
    words = tuple(map(str, entry["words"]))
    return Step(int(entry["number"]), _printable(entry["verb"]), words=words, **own, **several)


def _printable(text: object) -> str:
    """Text that stays one line, in the log of commands and in a script."""
    if not is_one_line(str(text)):
        raise ValueError(f"a character that cannot be printed: {str(text)[:NAME_MOST]!a}")
    return str(text)


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()
