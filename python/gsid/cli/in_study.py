"""A verb in a study: `gsid -C DIR VERB`.

The typed words become those of a command in the folder of the study, which is run and noted as a step: files
outside are copied into the study, missing records, model and outputs are filled in.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gsid.cli.common import EXIT_CRITERION, EXIT_GOOD, EXIT_INTERRUPT, EXIT_USAGE
from gsid.cli.files_in_use import FilesInUse, InputPath, Library, OutputPath
from gsid.cli.options import UsageError
from gsid.cli.output import MESSAGES, print_message
from gsid.cli.stopping import Stopping

if TYPE_CHECKING:
    from gsid.study.folder import Study

#: Folder and extension of what a verb writes with -o.
WRITES = {
    "design": ("excitation", ".csv"),
    "run": ("records", ".csv"),
    "cut": ("records", ".csv"),
    "frf": ("responses", ".csv"),
    "join": ("responses", ".csv"),
    "next": ("excitation", ".csv"),
    "fit": ("models", ".json"),
    "start": ("models", ".json"),
    "diagnose": ("models", ".json"),
    "add": ("models", ".json"),
    "export-c": ("models", ".c"),
    "report": ("verdicts", ".html"),
}
#: Verbs that are steps of a study. Those of OWN use the study in another way.
STEPS = (*WRITES, "look", "noise", "distortion", "compare", "predict")
OWN = ("open", "script", "studio")
#: Folder of a copied input, by the name of the parameter.
COPIED_TO = {
    "records": "records",
    "held_out": "records",
    "other_level": "records",
    "journal_file": "records",
    "noise_record": "records",
    "u_file": "excitation",
    "model_path": "models",
    "controller": "models",
    "rival_path": "models",
    "table": "models",
}
C_FILES = (".c", ".h")  # their names are names in C too, and are kept
ENDS_WELL = (EXIT_GOOD, EXIT_CRITERION, EXIT_INTERRUPT)


@dataclass
class Typed:
    """The words of a verb, by parameter.

    Attributes
    ----------
    verb : list of str
        The verb, and its kind if it has kinds.
    command : click.Command
    values : dict
        Words of each parameter by its name; a flag has none.
    """

    verb: list[str]
    command: click.Command
    values: dict[str, list[str]]

    @classmethod
    def read(cls, ctx: click.Context, words: Sequence[str]) -> Typed | None:
        """Read the words; None if they ask for help, or if they are not valid."""
        command, verb, rest = ctx.command, [], list(words)
        while isinstance(command, click.Group):
            found = command.get_command(ctx, rest[0]) if rest else None
            if found is None:
                return None
            command, ctx = found, click.Context(found, info_name=rest[0], parent=ctx)
            verb.append(rest.pop(0))
        given, left, order = command.make_parser(ctx).parse_args(rest)
        names = dict.fromkeys(param.name for param in order)
        known = {param.name for param in command.params}
        if left or not known.issuperset(names):  # the second: --help
            return None
        values = {name: _texts(given[name]) for name in names}
        typed = cls(verb, command, {name: texts for name, texts in values.items() if texts is not None})
        if verb == ["add"]:
            typed._sort_words_of_add()
        return typed

    def _sort_words_of_add(self) -> None:
        """With a law of the user the first name is a record."""
        from gsid.effects.types import catalogue

        is_own = any(map(self.has, ("torque", "table", "library")))
        if is_own and self.has("effect") and self.values["effect"][0] not in catalogue():
            self.values["records"] = self.values.pop("effect") + self.values.get("records", [])

    def words(self) -> list[str]:
        """The command as typed, after `gsid`."""
        params = {param.name: param for param in self.command.params}
        arguments = [
            text
            for name, param in params.items()
            if isinstance(param, click.Argument)
            for text in self.values.get(name, [])
        ]
        options = []
        for name, texts in self.values.items():
            param = params[name]
            if isinstance(param, click.Option) and param.is_flag:
                options.append(param.opts[0])
            elif isinstance(param, click.Option):
                options += [word for text in texts for word in (param.opts[0], text)]
        return [*self.verb, *arguments, *options]

    def params(self, kind: type) -> list[click.Parameter]:
        """Parameters of one type."""
        return [param for param in self.command.params if isinstance(param.type, kind)]

    def has(self, name: str) -> bool:
        """Whether a parameter is given."""
        return name in self.values


def _texts(value: object) -> list[str] | None:
    """Words of a parameter as click's parser returns them; None if it was not given."""
    if value is True:
        return []
    if isinstance(value, str):
        return [value]
    return list(value) if isinstance(value, (list, tuple)) and value else None


@dataclass
class StudyStep:
    """The step of a study that this process runs; without -C nothing of it is used.

    Attributes
    ----------
    study : Study or None
    """

    study: Study | None = None
    _caller: Path = field(default_factory=Path)
    _number: int = 0
    _verb: str = ""
    _arguments: list[str] = field(default_factory=list)
    _outputs: list[str] = field(default_factory=list)
    _copies: list[tuple[str, Path]] = field(default_factory=list)
    _facts: dict[str, Any] = field(default_factory=dict)
    _answer: bytes = b""

    # ---- begin ---------------------------------------------------------------------------------------

    def begin(self, ctx: click.Context, folder: str, words: list[str]) -> list[str]:
        """Fill in what is missing, and go to the folder of the study.

        Parameters
        ----------
        ctx : click.Context
            That of `gsid`.
        folder : str
        words : list of str
            The verb and what follows.

        Returns
        -------
        list of str
            The words as typed in the folder of the study.

        Raises
        ------
        InputError
            There is no study, or it lacks records or a model.
        """
        if words[0] in OWN:
            return words
        if words[0] not in STEPS:
            raise UsageError(f"`gsid {words[0]}` uses no study", "leave out -C")
        typed = Typed.read(ctx, words)
        if typed is None:
            return words  # click reports what is wrong, or prints the help
        from gsid.study.folder import Study, check_words

        study, self._caller = Study(folder, create=False), Path.cwd()
        self._take_port(typed)
        self._take_inputs(study, ctx, typed)
        self._take_records(study, typed)
        self._take_model(study, typed)
        wanted = self._check_outputs(study, typed)
        check_words(typed.words())
        self._number, self._verb, self.study = study.begin_step(), words[0], study
        for param in typed.params(OutputPath):
            self._take_output(typed, param, wanted.get(param.name))
        libraries = [f"{path}:{name}" for path, name in ctx.params["libraries"]]
        self._arguments = [word for one in libraries for word in ("--library", one)] + typed.words()
        self._facts = {"step": self._number} | self._facts
        os.chdir(study.folder)
        return typed.words()

    def _take_inputs(self, study: Study, ctx: click.Context, typed: Typed) -> None:
        """Name all inputs by their place in the study; those outside are copied."""
        opened = False
        for param in typed.params(InputPath):
            texts = typed.values.get(param.name, [])
            is_outside = [self._found(study, text)[1] for text in texts]
            for i, text in enumerate(texts):
                texts[i] = self._copied(study, text, COPIED_TO[param.name])
            opened |= param.name == "records" and any(is_outside)
        if opened:
            study.begin_experiment(typed.values["records"])
        for param in typed.params(Library):
            for i, text in enumerate(typed.values.get(param.name, [])):
                path, colon, name = text.rpartition(":")
                if colon:
                    typed.values[param.name][i] = f"{self._copied(study, path, 'models')}:{name}"
        libraries = ctx.params["libraries"]
        ctx.params["libraries"] = [(self._copied(study, path, "models"), name) for path, name in libraries]

    def _take_port(self, typed: Typed) -> None:
        """A port in the caller's folder, as a link to that of `gsid simulate`, is named from the root."""
        for i, name in enumerate(typed.values.get("port", [])):
            path = self._caller / name
            if path.exists() and not path.is_dir():
                typed.values["port"][i] = str(path)

    def _found(self, study: Study, name: str) -> tuple[Path, bool]:
        """A file, and whether it is outside the study; it is searched in the caller's folder first."""
        path = self._caller / name
        if not path.exists() and (study.folder / name).exists():
            path = study.folder / name
        if not path.exists():
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
        return path, not path.resolve().is_relative_to(study.folder)

    def _copied(self, study: Study, name: str, kind: str) -> str:
        path, is_outside = self._found(study, name)
        if not is_outside:
            return path.resolve().relative_to(study.folder).as_posix()
        if kind == "records" and path.suffix != ".journal":
            check_kind(path)
        kept = study.add_file(path, kind=kind, experiment=None)
        print_message(f"opened {name} as {kept}")
        return kept

    def _take_records(self, study: Study, typed: Typed) -> None:
        """The records of the last experiment if none are named."""
        if not any(param.name == "records" for param in typed.command.params) or typed.has("undo"):
            return
        if not typed.has("records"):
            from gsid.base.errors import InputError

            typed.values["records"] = study.last_experiment
            if not typed.values["records"]:
                hint = "name a record, or measure with `gsid -C DIR run`"
                raise InputError("the study has no records", str(study.folder), None, hint)
            print_message(f"records of the last experiment: {', '.join(typed.values['records'])}")
        self._facts["records"] = typed.values["records"]

    def _take_model(self, study: Study, typed: Typed) -> None:
        """The newest model if the verb needs one and none is named."""
        param = next((one for one in typed.command.params if one.name == "model_path"), None)
        if param is None or not (param.required or typed.has("model_path")):
            return
        if not typed.has("model_path"):
            typed.values["model_path"] = [_newest_model(study)]
            print_message(f"newest model: {typed.values['model_path'][0]}")
        self._facts["model"] = typed.values["model_path"][0]

    def _check_outputs(self, study: Study, typed: Typed) -> dict[str, Path]:
        """The files that the caller named, as absolute paths; none of them replaces an input."""
        inputs = [text for param in typed.params(InputPath) for text in typed.values.get(param.name, [])]
        in_use = FilesInUse([str(study.folder / text) for text in inputs])
        wanted = {}
        for param in typed.params(OutputPath):
            for text in typed.values.get(param.name, [])[-1:]:
                if text != "-":
                    wanted[param.name] = self._caller / text
                    in_use.write(wanted[param.name])
        return wanted

    def _take_output(self, typed: Typed, param: click.Parameter, wanted: Path | None) -> None:
        """A numbered name in the study; a file that the caller named elsewhere becomes a copy of it."""
        if wanted is None and (typed.has(param.name) or not _has_default(typed, param)):
            return  # the standard output, or nothing
        verb, place = typed.verb[0], ""
        folder, suffix = _kind_of_output(verb, param, wanted)
        if wanted is not None:
            place = _inside(self.study.folder, wanted)
        if not place:
            place = f"{folder}/{self._number}-{verb}{suffix}"
            if suffix in C_FILES:
                place = f"{folder}/{self._number}-{verb}/{wanted.name if wanted else 'model.c'}"
                (self.study.folder / place).parent.mkdir(exist_ok=True)
            self._copies += [] if wanted is None else [(place, wanted)]
        typed.values[param.name] = [place]
        self._outputs.append(place)
        if verb == "export-c":
            self._outputs.append(str(Path(place).with_suffix(".h")))
            self._copies += [(self._outputs[-1], one.with_suffix(".h")) for _, one in self._copies]

    # ---- end -----------------------------------------------------------------------------------------

    def kept(self, answer: dict) -> dict:
        """Keep the answer of the command, with the records and the model that it used.

        Parameters
        ----------
        answer : dict

        Returns
        -------
        dict
            As printed with --json.
        """
        if self.study is None:
            return answer
        answer = answer | {"study": self._facts | {"outputs": self._outputs}}
        self._answer = (json.dumps(answer, allow_nan=False) + "\n").encode()
        return answer

    def end(self, exit_code: int) -> int:
        """Note the step and write the files that the caller named. Signals that arrive meanwhile are ignored.

        Parameters
        ----------
        exit_code : int

        Returns
        -------
        int
            The same.

        Raises
        ------
        InputError, OSError
            The study or one of these files cannot be written.
        """
        if self.study is None:
            return exit_code
        self.leave()
        with Stopping().caught():
            if exit_code == EXIT_USAGE:
                self.study.cancel_step(self._number)
                return exit_code
            self._note(exit_code)
            if exit_code in ENDS_WELL:
                self._write_copies()
        return exit_code

    def leave(self) -> None:
        """Go back to the caller's folder, from that of the study."""
        if self.study is not None:
            os.chdir(self._caller)

    def _note(self, exit_code: int) -> None:
        from gsid.webpage.words import outcome_of

        verb = self._verb
        found = outcome_of(verb, exit_code, self._answer, MESSAGES, stopped=exit_code == EXIT_INTERRUPT)
        self.study.add_step(
            self._arguments,
            exit_code,
            words=found.sentences,
            outputs=self._outputs,
            answer=self._answer,
            verb=verb,
            number=self._number,
        )

    def _write_copies(self) -> None:
        from gsid.base.files import write_atomically

        for place, wanted in self._copies:
            source = self.study.folder / place
            if source.is_file():
                write_atomically(wanted, lambda part, source=source: shutil.copyfile(source, part))
                print_message(f"wrote {wanted}, a copy")


def check_kind(path: str | Path) -> None:
    """Refuse a file that is no record, before it is copied.

    Parameters
    ----------
    path : path_like

    Raises
    ------
    InputError
    """
    from gsid.base.errors import InputError
    from gsid.records.files import KINDS

    path = Path(path)
    if path.suffix.lower() not in KINDS:
        hint = f"records are {', '.join(KINDS)}"
        raise InputError("unknown kind of file", str(path), path.suffix or "no extension", hint)


def _newest_model(study: Study) -> str:
    from gsid.base.errors import InputError

    found = study.newest_models
    if not found:
        hint = "`gsid -C DIR start` finds one, or name one with --model"
        raise InputError("the study has no model", str(study.folder), None, hint)
    if len(found) > 1:
        raise InputError("several models were opened last", ", ".join(found), None, "name one with --model")
    return found[0]


def _kind_of_output(verb: str, param: click.Parameter, wanted: Path | None) -> tuple[str, str]:
    """Folder and extension of an output."""
    if "-o" in param.opts:
        folder, suffix = WRITES[verb]
    elif param.name == "picture":
        folder, suffix = "verdicts", ".json"
    elif param.name == "noise_model":
        from gsid.study.folder import NOISE_MODEL

        folder, suffix = "responses", NOISE_MODEL
    else:
        folder, suffix = "models", f"-{param.name}.csv"
    own = wanted is not None and wanted.suffix and param.name != "noise_model"
    return folder, wanted.suffix if own else suffix


def _has_default(typed: Typed, param: click.Parameter) -> bool:
    """Whether a study has this output without its option."""
    if "-o" in param.opts:
        return True
    if param.name == "noise_model":
        return typed.has("zero_s") if typed.verb == ["run"] else len(typed.values["records"]) == 1
    if param.name != "picture" or typed.has("undo") or typed.has("journal_file"):
        return False
    if typed.verb == ["noise"]:
        return len(typed.values["records"]) == 1
    return typed.values.get("periods") != ["1"]  # `gsid run --periods 1` has no response


def _inside(folder: Path, wanted: Path) -> str:
    """Place of a file in one of the study's folders; empty: it is elsewhere."""
    from gsid.study.folder import FOLDERS

    path = wanted.parent.resolve() / wanted.name
    if not path.is_relative_to(folder):
        return ""
    place = path.relative_to(folder)
    return place.as_posix() if place.parts[0] in FOLDERS else ""
