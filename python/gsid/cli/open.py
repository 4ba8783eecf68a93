"""gsid open"""

from __future__ import annotations

from collections.abc import Sequence

import click

from gsid.cli.files_in_use import RECORD
from gsid.cli.options import UsageError
from gsid.cli.output import print_json, print_message


@click.command(short_help="Copy files into a study, which is made if there is none.")
@click.argument("files", metavar="[FILES]...", nargs=-1, type=RECORD)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def open(*, files: Sequence[str], as_json: bool) -> None:
    """Copy records and models into the study of `gsid -C DIR`. An empty or a new DIR becomes a study.

    The records become its last experiment, which the verbs take if none is named. Files with the extension
    .json are models.
    """
    folder = click.get_current_context().find_root().params["folder"]
    if folder is None:
        raise UsageError("`gsid open` needs a study", "give -C DIR: gsid -C DIR open FILES...")
    from gsid.cli.in_study import check_kind
    from gsid.models.load import load_model
    from gsid.study.folder import Study

    models = [name for name in files if name.lower().endswith(".json")]
    records = [name for name in files if name not in models]
    for name in models:
        load_model(name)
    for name in records:
        check_kind(name)
    study = Study(folder)
    kept = study.open_files(records) + study.open_files(models, "models")
    for name, place in zip([*records, *models], kept, strict=True):
        print_message(f"opened {name} as {place}")
    if as_json:
        print_json({"study": str(study.folder), "opened": kept, "last_experiment": study.last_experiment})
    elif not files:
        print(study.folder)
