"""The scripts that repeat a study: its commands, and the same with the functions of the package."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import click

from gsid.cli.common import EXIT_CRITERION, EXIT_INTERRUPT, HELP_NAMES
from gsid.cli.files_in_use import InputPath
from gsid.cli.in_study import Typed
from gsid.cli.output import visible

if TYPE_CHECKING:
    from gsid.study.folder import Step, Study

MEASURES = ("run",)  # verbs that need the rig: their records are used as they are
READING = {
    "u_name": "u",
    "y_name": "y",
    "fs_hz": "fs_hz",
    "period": "period",
    "settle": "settle",
    "hold": "hold",
    "units": "units",
    "factors": "factors",
}
HELPER = '''

def command(line, exit_code=0):
    """Run a step that the package has no function for; it may end with the exit code of the study."""
    words = [sys.executable, "-m", "gsid.cli.main", *shlex.split(line)]
    if (code := subprocess.run(words).returncode) not in (0, exit_code):
        sys.exit(code)

'''


def shell_script(study: Study) -> str:
    """The commands of a study, for sh.

    Parameters
    ----------
    study : Study

    Returns
    -------
    str
    """
    lines, written = [], []
    for step in study.steps:
        if why := _why_not(step):
            lines.append(_comment(f"{why}: {step.command}"))
            continue
        written.append((step, set(step.outputs)))
        if step.exit_code == EXIT_CRITERION:
            lines.append(f"{step.command} || [ $? -eq {EXIT_CRITERION} ]  # its criterion was not met")
        else:
            lines.append(step.command)
    return "\n".join(["#!/bin/sh -e", *_head(study, written), *lines]) + "\n"


def python_script(study: Study) -> str:
    """The steps of a study with the functions of the package.

    Parameters
    ----------
    study : Study

    Returns
    -------
    str
    """
    writer, written = _Writer(), []
    for step in study.steps:
        files = writer.add(step)
        if not _why_not(step):
            written.append((step, files))
    imports = sorted(writer.imports)
    plain = "".join(f"{line}\n" for line in imports if line.startswith("import "))
    others = "".join(f"{line}\n" for line in ["import gsid", *imports] if not plain or line not in plain)
    head = "\n".join(_head(study, written))
    helper = HELPER if "import subprocess" in imports else ""
    return f"{head}\n\n{plain}\n{others}{helper}\n" + "\n".join(writer.lines) + "\n"


def _comment(text: str) -> str:
    """One line of comment: words and names of a study must not end it."""
    return f"# {visible(text)}".replace("\n", r"\n")  # `visible` keeps some breaks of lines


def _head(study: Study, written: list[tuple[Step, set[str]]]) -> list[str]:
    """What the script needs, with hashes: files that no step made, and inputs that no line before writes.

    `written` has the repeated steps, each with the files that its lines write.
    """
    made, needed, products = set(), set(), set()
    for step, files in written:
        needed |= _inputs(step) - made
        made |= files
        products |= {*step.outputs, step.answer}
    files = [
        _comment(f"    {digest}  {name}")
        for name, digest in study.files.items()
        if name in needed or name not in products
    ]
    return [
        "# Repeats a study of gsid: run it in its folder, or in a copy. SHA-256 of the files it uses:",
        *files,
    ]


def _inputs(step: Step) -> set[str]:
    """Files that the command of a step reads, as its words name them."""
    typed = _typed(step)
    params = [] if typed is None else typed.params(InputPath)
    return {text for param in params for text in typed.values.get(param.name, [])}


def _typed(step: Step) -> Typed | None:
    """Its words by parameter, without a --library before the verb."""
    from gsid.cli.main import gsid

    root = click.Context(gsid, info_name="gsid", help_option_names=HELP_NAMES)
    words = list(step.arguments)
    with contextlib.suppress(click.UsageError):  # of another version of gsid
        return Typed.read(root, words[words.index(step.verb) :]) if step.verb in words else None
    return None


def _why_not(step: Step) -> str:
    """Why a step is not repeated; empty if it is."""
    if step.exit_code == EXIT_INTERRUPT:
        return "stopped"
    if not step.has_result:
        return "failed"
    return "measured" if step.verb in MEASURES else ""


class _NoFunction(Exception):
    """The package has no function for a step with these options."""


@dataclass
class _Writer:
    """Lines of the script in Python."""

    lines: list[str] = field(default_factory=list)
    imports: set[str] = field(default_factory=set)
    _known: str = ""  # the expression of which `records` holds the value

    def add(self, step: Step) -> set[str]:
        """Add the lines of a step; returns the files that they write."""
        title = f"{step.number}. {step.command}"
        if why := _why_not(step):
            self.lines.append(_comment(f"{title}  ({why})"))
            return set()
        self.lines.append(_comment(title))
        before, known = len(self.lines), self._known
        values = _Values.of(step)
        try:
            if values is None or step.verb not in WRITERS:
                raise _NoFunction
            self.imports |= WRITERS[step.verb](self, values) or set()
        except _NoFunction:
            del self.lines[before:]
            self._known = known
            self.imports |= {"import shlex", "import subprocess", "import sys"}
            words = step.command.removeprefix("gsid ")
            more = f", exit_code={step.exit_code}" if step.exit_code else ""
            self.lines.append(f"command({words!r}{more})")
            return set(step.outputs)
        text = "\n".join(self.lines[before:])
        return {name for name in step.outputs if repr(name) in text}

    def records(self, values: _Values) -> str:
        """Name of the records of a step, which are read unless they were."""
        text = values.read("records")
        if text != self._known:
            self.lines.append(f"records = {text}")
            self._known = text
        return "records"


@dataclass
class _Values:
    """Values of the options of a step that were given, by the name of the parameter."""

    given: dict[str, Any]

    @classmethod
    def of(cls, step: Step) -> _Values | None:
        if step.arguments[0] != step.verb:  # --library before it
            return None
        typed = _typed(step)
        if typed is None:
            return None
        params = {param.name: param for param in typed.command.params}
        return cls({name: _converted(params[name], texts) for name, texts in typed.values.items()})

    def only(self, *names: str) -> None:
        """Refuse options that the function has not."""
        others = set(self.given) - {*names, *READING, "records", "picture", "as_json"}
        if others:
            raise _NoFunction

    def read(self, name: str) -> str:
        """Expression for the records of a parameter."""
        paths = self.given.get(name, [])
        if not paths or any("," in str(self.given.get(key, "")) for key in ("u_name", "y_name")):
            raise _NoFunction  # several inputs or outputs
        known = {key: self.given[name] for name, key in READING.items() if name in self.given}
        known |= {key: dict(known[key]) for key in ("units", "factors") if key in known}
        how = "".join(f", {key}={value!r}" for key, value in known.items())
        if len(paths) == 1:
            return f"[gsid.read_record({paths[0]!r}{how})]"
        return f"[gsid.read_record(name{how}) for name in {paths!r}]"

    def keywords(self, **names: str) -> str:
        """Further arguments of a call: keyword=name of the parameter."""
        return "".join(f", {key}={self.given[name]!r}" for key, name in names.items() if name in self.given)

    def __getitem__(self, name: str) -> Any:
        return self.given.get(name)


def _converted(param: click.Parameter, texts: list[str]) -> Any:
    """A value as a verb gets it; files stay names."""
    if isinstance(param, click.Option) and param.is_flag:
        return True
    is_file = isinstance(param.type, click.Path)
    values = texts if is_file else [param.type.convert(text, param, None) for text in texts]
    return values if param.multiple or param.nargs == -1 else values[-1]


# ---- one function for each verb --------------------------------------------------------------------------


def _look(writer: _Writer, values: _Values) -> None:
    values.only()
    writer.lines.append(f"print({writer.records(values)})")


def _noise(writer: _Writer, values: _Values) -> None:
    values.only("alpha", "noise_model")
    records = writer.records(values)
    if values["noise_model"]:
        writer.lines.append(f"found = gsid.noise({records}[0]{values.keywords(alpha='alpha')})")
        writer.lines += ["print(found)", f"found.save({values['noise_model']!r})"]
        return
    writer.lines.append(
        f"print([gsid.noise(record{values.keywords(alpha='alpha')}) for record in {records}])"
    )


def _frf(writer: _Writer, values: _Values) -> None:
    own = ("band", "remove_periodic", "lpm", "window", "merge", "min_input")
    values.only("output", "reference", *own)
    more = values.keywords(reference="reference", **{name: name for name in own})
    call = f"gsid.frf({writer.records(values)}{more})"
    writer.lines.append(f"print({call})  # the command writes it as a table")


def _distortion(writer: _Writer, values: _Values) -> None:
    values.only("band")
    writer.lines.append(f"print(gsid.distortion({writer.records(values)}{values.keywords(band='band')}))")


def _start(writer: _Writer, values: _Values) -> None:
    values.only("reference", "band", "y_is", "path")
    more = values.keywords(output="y_is", band="band", reference="reference")
    writer.lines += [f"found = gsid.start({writer.records(values)}{more})", "print(found)"]
    writer.lines.append(f"found.save({values['path']!r})")


def _fit(writer: _Writer, values: _Values) -> set[str]:
    if values["model_path"]:
        return _fit_stack(writer, values)
    values.only("reference", "order", "delay", "method", "band", "domain", "output")
    if values["method"] == "all" or str(values["output"]).endswith(".mat"):
        raise _NoFunction
    measured = "from gsid.response.with_distortion import frf_with_distortion"
    reference = values.keywords(reference="reference")
    writer.lines.append(f"response = frf_with_distortion({writer.records(values)}{reference})")
    how = values.keywords(delay="delay", band="band", domain="domain")
    method, order = values.keywords(method="method"), repr(values["order"])
    if values["order"] == "auto":
        writer.lines.append(f"choice = gsid.select_order(response{how})")
        order, method = "choice.chosen.order", f"{method}, relative_error=choice.relative_error"
    writer.lines += [f"model = gsid.fit(response, {order}{method}{how})", "print(model)"]
    writer.lines.append(f"model.save({values['output']!r})")
    return {measured}


def _fit_stack(writer: _Writer, values: _Values) -> set[str]:
    values.only("model_path", "method", "band", "output")
    records = writer.records(values)
    writer.lines += [
        f"measured = [gsid.spectra(record) for record in {records}]",
        f"given = load_plant({values['model_path']!r})",
        f"found = fit_from_better_start(given, measured{values.keywords(band='band', method='method')})",
        "print(found)",
        f"found.model.save({values['output']!r})",
    ]
    return {
        "from gsid.greybox.better_start import fit_from_better_start",
        "from gsid.models.load import load_plant",
    }


def _compare(writer: _Writer, values: _Values) -> None:
    values.only("model_path", "band", "alpha", "fitted", "check")
    more = values.keywords(band="band", alpha="alpha", fitted="fitted")
    model = f"gsid.load_model({values['model_path']!r})"
    writer.lines.append(f"print(gsid.compare({model}, {writer.records(values)}{more}))")


def _predict(writer: _Writer, values: _Values) -> None:
    values.only("model_path")
    model = f"gsid.load_model({values['model_path']!r})"
    writer.lines.append(f"print(gsid.predict({model}, {writer.records(values)}))")


def _diagnose(writer: _Writer, values: _Values) -> set[str]:
    own = ("reference", "band", "fast", "time_s", "alpha")
    values.only("model_path", "y_is", "path", "curve", *own)
    more = values.keywords(output="y_is", **{name: name for name in own})
    records, needs = writer.records(values), set()
    if values["model_path"]:
        more = f", load_plant({values['model_path']!r}){more}"
        needs = {"from gsid.models.load import load_plant"}
    writer.lines += [f"found = gsid.diagnose_records({records}{more})", "print(found)"]
    if values["curve"]:
        writer.lines.append(f"found.torque_residual().best.save({values['curve']!r})")
    writer.lines += ["if found.model is not None:", f"    found.model.save({values['path']!r})"]
    return needs


def _add(writer: _Writer, values: _Values) -> set[str]:
    needs = {"from gsid.models.load import load_plant"}
    model = f"load_plant({values['model_path']!r})"
    if values["undo"]:
        writer.lines.append(f"gsid.undo({model}).save({values['output']!r})")
        return needs
    values.only(
        "effect",
        "model_path",
        "torque",
        "table",
        "library",
        "params",
        "held_out",
        "reference",
        "band",
        "output",
    )
    start = {name: value for name, value, _ in values["params"] or ()}
    if values["torque"]:
        bounds = {name: limits for name, _, limits in values["params"] or () if limits}
        effect, start = f"gsid.effects.expression({values['torque']!r}, {start!r}, bounds={bounds!r})", {}
    elif values["table"]:
        effect = f"gsid.effects.table({values['table']!r})"
    elif values["library"]:
        effect = f"gsid.effects.load{values['library']!r}"
    else:
        effect = repr(values["effect"])
    more = values.keywords(reference="reference", band="band") + (f", params={start!r}" if start else "")
    more += f", held_out={values.read('held_out')}" if values["held_out"] else ""
    writer.lines += [f"added = gsid.add({effect}, {model}, {writer.records(values)}{more})", "print(added)"]
    writer.lines.append(f"added.model.save({values['output']!r})")
    return needs


def _cut(writer: _Writer, values: _Values) -> None:
    values.only("from_s", "to_s", "output")
    more = values.keywords(from_s="from_s", to_s="to_s")
    records = writer.records(values)
    writer.lines.append(f"gsid.write_record({values['output']!r}, gsid.cut({records}[0]{more}))")


WRITERS: dict[str, Callable[[_Writer, _Values], set[str] | None]] = {
    "look": _look,
    "noise": _noise,
    "frf": _frf,
    "distortion": _distortion,
    "start": _start,
    "fit": _fit,
    "compare": _compare,
    "predict": _predict,
    "diagnose": _diagnose,
    "add": _add,
    "cut": _cut,
}
