"""gsid script"""

from __future__ import annotations

from pathlib import Path

import click

from gsid.cli.files_in_use import OUTPUT
from gsid.cli.options import UsageError
from gsid.cli.output import print_message

KINDS = (".py", ".sh")


@click.command(short_help="Write the script that repeats a study.")
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    type=OUTPUT,
    default="-",
    help="Script to write: .py with the functions of the package, .sh with the commands. [default: .py to the"
    " standard output]",
)
def script(*, output: str) -> None:
    """Write a script that repeats the study of `gsid -C DIR`: its steps in order, with the same files.

    Run it in the folder of the study, or in a copy. Files that were opened or measured are used as they are;
    what was measured and what was stopped stands in the script as a comment. A step that has no function of
    the package calls the command.
    """
    folder = click.get_current_context().find_root().params["folder"]
    if folder is None:
        raise UsageError("`gsid script` needs a study", "give -C DIR: gsid -C DIR script -o study.py")
    from gsid.base.files import is_stdout, kind_of, write_atomically
    from gsid.cli.study_script import python_script, shell_script
    from gsid.study.folder import Study

    kind = kind_of(output, stream=".py")
    if kind not in KINDS:
        raise UsageError(f"cannot write {Path(output).name}", f"name a file with {' or '.join(KINDS)}")
    study = Study(folder, create=False)
    text = python_script(study) if kind == ".py" else shell_script(study)
    write_atomically(output, lambda part: part.write_text(text, encoding="utf-8"))
    if not is_stdout(output):
        print_message(f"wrote {output}: {sum(step.has_result for step in study.steps)} steps")
