"""gsid studio"""

from __future__ import annotations

import tempfile
import webbrowser
from collections.abc import Sequence
from pathlib import Path

import click

from gsid.cli.files_in_use import RECORD
from gsid.cli.options import is_given
from gsid.cli.output import print_message


@click.command(short_help="Open a page to identify and diagnose by clicks.")
@click.argument("files", metavar="[FILES]...", nargs=-1, type=RECORD)
@click.option(
    "--folder",
    metavar="DIR",
    type=click.Path(),
    default="study",
    show_default=True,
    help="Folder of the files written.",
)
@click.option(
    "--port",
    metavar="N",
    type=click.IntRange(0, 65535),
    default=0,
    help="Port on 127.0.0.1. [default: any free port]",
)
@click.option("--no-browser", is_flag=True, help="Print the address only, for example over ssh.")
@click.option(
    "--max-upload",
    metavar="MB",
    type=click.IntRange(1),
    default=200,
    show_default=True,
    help="Largest file that the page accepts.",
)
def studio(*, files: Sequence[str], folder: str, port: int, no_browser: bool, max_upload: int) -> None:
    """Open a page in the browser that runs each step on your records and shows its picture.

    FILES are records, or folders of studies: the first is opened, unless --folder names one, and the others
    are compared with it.

    Each step is a command of gsid, which the page shows and writes to commands.log of the study. The server
    listens on 127.0.0.1 only and loads nothing from elsewhere. Ctrl-C stops the server; the files of the
    study are kept.
    """
    context = click.get_current_context()
    if context.find_root().params["folder"] is not None and not is_given(context, "folder"):
        folder = context.find_root().params["folder"]
    from gsid.study.folder import Study
    from gsid.webpage.page import Page
    from gsid.webpage.safety import file_that_opens
    from gsid.webpage.server import serve
    from gsid.webpage.studies import is_study

    others = [one for one in files if is_study(Path(one))]
    if others and not is_given(context, "folder") and context.find_root().params["folder"] is None:
        folder = others.pop(0)
    study = Study(folder)
    study.open_files([one for one in files if not is_study(Path(one))])

    with tempfile.TemporaryDirectory(prefix="gsid-studio-") as private:

        def announce(address: str) -> None:
            print(f"gsid studio: {address}", flush=True)
            print_message("Ctrl-C ends the server; the study stays in " + str(study.folder))
            if not no_browser:
                place = file_that_opens(address, Path(private))
                if click.launch(str(place)) != 0:  # no program of the desktop opens files
                    webbrowser.open(place.as_uri())

        serve(Page(study, max_upload << 20), port, announce, others)
