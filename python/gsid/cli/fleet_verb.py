"""A verb on one unit of a fleet: its options from the recipe, and its answer in JSON."""

from __future__ import annotations

import contextlib
import importlib
import io
from collections.abc import Iterator
from pathlib import Path

import click

from gsid.base.errors import InputError, choose
from gsid.base.json_files import parse_json
from gsid.cli.common import EXIT_CRITERION, EXIT_GOOD, HELP_NAMES
from gsid.cli.files_in_use import InputPath, OutputPath
from gsid.cli.main import main
from gsid.cli.output import MESSAGES
from gsid.fleet.address import address, file_digest, record_digest
from gsid.fleet.plan import Unit
from gsid.fleet.recipe import Recipe
from gsid.fleet.unit import Job

WORK = "gsid.cli.fleet_verb:run"
VERBS = {
    "look": ("gsid.records.condition", "gsid.spectrum.realisation"),
    "noise": ("gsid.spectrum.noise",),
    "frf": ("gsid.response.estimate", "gsid.response.files"),
    "distortion": ("gsid.response.estimate_distortion", "gsid.response.superposition"),
    "fit": ("gsid.fitting.rational", "gsid.greybox.fit", "gsid.models.load"),
    "start": ("gsid.structure.start",),
    "compare": ("gsid.comparison", "gsid.models.load"),
    "diagnose": ("gsid.comparison", "gsid.diagnosis.from_records.diagnose", "gsid.models.load"),
}
"""Verbs of a fleet, with modules that they import when they run: the fork server has imported them before."""


class VerbFailed(Exception):
    """A verb ended with an error, which is the message."""


class VerbOfRecipe:
    """The verb and the options of a recipe, checked.

    Parameters
    ----------
    recipe : Recipe

    Raises
    ------
    InputError
        The verb cannot run on a fleet, or does not accept the options.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        if recipe.verb not in VERBS:
            hint = choose(recipe.verb, VERBS)
            raise InputError("this verb does not run on a fleet", str(recipe.path), recipe.verb, hint)
        self.command: click.Command = getattr(importlib.import_module(f"gsid.cli.{recipe.verb}"), recipe.verb)
        self.words: list[str] = []
        self.content: dict[str, list[str]] = {}
        for name, value in recipe.options.items():
            self._add(name, value)
        self._check()

    def job(self, unit: Unit) -> Job:
        """What is run on a unit."""
        digests = [record_digest(path) for path in unit.records]
        return Job(
            key=address(f"gsid {self.recipe.verb}", self.content, digests),
            work=WORK,
            unit=unit.name,
            records=[str(Path(path).absolute()) for path in unit.records],
            digests=digests,
            arguments={"verb": self.recipe.verb, "words": self.words},
            seed=self.recipe.options.get("seed"),
        )

    @property
    def modules(self) -> tuple[str, ...]:
        """What a fork server imports."""
        return "gsid.cli.fleet_verb", "gsid.records.files", *VERBS[self.recipe.verb]

    def header(self) -> dict[str, object]:
        """What all units share, for the plan."""
        return {"verb": self.recipe.verb, "options": self.content}

    def _add(self, name: str, value: object) -> None:
        """Add the words of an option; files are named from the folder of the recipe."""
        param = self._param(name)
        words, content = [], []
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, bool):
                words += [f"--{name}"] if one else []
                content.append(str(one))
            elif isinstance(param.type, InputPath):
                path = self.recipe.path.parent / str(one)
                words += [f"--{name}", str(path.absolute())]
                content.append(file_digest(path))
            else:
                words += [f"--{name}", str(one)]
                content.append(str(one))
        self.words += words
        self.content[name] = content

    def _param(self, name: str) -> click.Parameter:
        where = f"{self.recipe.path}: options of {self.recipe.verb}"
        known = {
            option.removeprefix("--"): param
            for param in self.command.params
            if isinstance(param, click.Option) and param.name != "as_json"
            for option in param.opts
            if option.startswith("--") and not isinstance(param.type, OutputPath)
        }
        if name not in known:
            raise InputError("the verb has no such option for a fleet", where, name, choose(name, known))
        return known[name]

    def _check(self) -> None:
        """Let the verb parse the words, without running it."""
        try:
            words = [*self.words, "--json", "REC.csv"]
            # A command keeps its help option: without these names `gsid VERB --help` would lose -h.
            with self.command.make_context(self.recipe.verb, words, help_option_names=HELP_NAMES):
                pass
        except click.UsageError as error:
            where = f"{self.recipe.path}: options of {self.recipe.verb}"
            hint = f"see `gsid {self.recipe.verb} --help`"
            raise InputError(error.format_message().rstrip("."), where, None, hint) from None


def run(job: Job) -> dict[str, object]:
    """Run a verb on the records of a unit, in a process of its own.

    Returns
    -------
    dict
        What the verb prints with --json.

    Raises
    ------
    VerbFailed
        The verb ended with an error.
    """
    with _printed() as out:
        code = main([job.arguments["verb"], *job.arguments["words"], "--json", *job.records])
    if code not in (EXIT_GOOD, EXIT_CRITERION):
        raise VerbFailed(" ".join(MESSAGES) or f"exit code {code}")
    return parse_json(out.getvalue())


@contextlib.contextmanager
def _printed() -> Iterator[io.StringIO]:
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        yield out
