"""Files that a command reads and writes: checked, before the work begins, that none replaces another."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import click

STREAMS = ("/dev/stdout", "/dev/stderr")  # where the system has them


@dataclass
class FilesInUse:
    """Files that a command reads and writes, as far as its arguments name them."""

    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    stdout_by: str = ""  # option whose file goes to the standard output

    @classmethod
    def of(cls, ctx: click.Context | None) -> FilesInUse:
        """Those of the command that runs; the same for all its arguments."""
        return cls() if ctx is None else ctx.meta.setdefault("gsid.base.files", cls())

    def read(self, *paths: str) -> None:
        """Note inputs.

        Raises
        ------
        InputError
            One of them is an output.
        """
        self.inputs += paths
        for output in self.outputs:
            self._check(output, paths)

    def write(self, *paths: str | Path) -> None:
        """Note outputs; also the names that a command derives from an argument.

        Raises
        ------
        InputError
            One of them is an input or another output, or nothing can be written there.
        """
        from gsid.base.errors import InputError
        from gsid.base.files import refuse_overwrite, target_of

        for path in map(str, paths):
            folder = target_of(path).parent
            if not folder.is_dir():
                raise InputError("the folder does not exist", path, None, "create it, or name another folder")
            if not os.access(folder, os.W_OK):
                raise InputError("the folder is not writable", path, None, "name another folder")
            self._check(path, self.inputs)
            refuse_overwrite(path, self.outputs, "two outputs have the same name")
            refuse_overwrite(path, STREAMS, "this command prints to the same file")
            self.outputs.append(path)

    @staticmethod
    def _check(output: str, inputs: Iterable[str]) -> None:
        from gsid.base.files import refuse_overwrite

        refuse_overwrite(output, inputs, "the output would replace an input")

    def stream(self, by: str, ctx: click.Context) -> None:
        """Reserve the standard output for one file; other output goes to stderr."""
        if self.stdout_by:
            raise click.UsageError(f"{self.stdout_by} and {by} both write to the standard output", ctx)
        self.stdout_by = by
        if by != "--json":
            ctx.find_root().with_resource(contextlib.redirect_stdout(sys.stderr))


class InputPath(click.Path):
    """A file to read, which no output of the command may replace."""

    def __init__(self, *, with_meta: bool = False) -> None:
        super().__init__()
        self.with_meta = with_meta  # records may have their rate and units in the meta.json of their folder

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        path = super().convert(value, param, ctx)
        FilesInUse.of(ctx).read(path, *([str(Path(path).parent / "meta.json")] if self.with_meta else []))
        return path


class OutputPath(click.Path):
    """A file to write, checked before the work begins; with `streams`, - is the standard output."""

    def __init__(self, *, streams: bool = True) -> None:
        super().__init__()
        self.streams = streams

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        from gsid.base.files import is_stdout

        path = super().convert(value, param, ctx)
        if not is_stdout(path):
            FilesInUse.of(ctx).write(path)
        elif not self.streams:
            self.fail("this output cannot go to the standard output: name a file", param, ctx)
        elif ctx is not None:
            FilesInUse.of(ctx).stream(f"{param.opts[0]} -", ctx)
        return path


class Library(click.ParamType):
    """FILE.so:NAME."""

    name = "FILE.so:NAME"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, str]:
        if isinstance(value, tuple):
            return value
        path, _, name = str(value).rpartition(":")
        if not path or not name.isidentifier():
            self.fail(f"{value} is not {self.name}, for example ./spring.so:spring", param, ctx)
        FilesInUse.of(ctx).read(path)
        return path, name


INPUT, RECORD = InputPath(), InputPath(with_meta=True)
OUTPUT, FILE_OUTPUT = OutputPath(), OutputPath(streams=False)
