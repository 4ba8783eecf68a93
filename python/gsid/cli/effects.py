"""gsid effects"""

from __future__ import annotations

import click

from gsid.base.tables import Table
from gsid.cli.options import json_option
from gsid.cli.output import print_json, print_table


@click.command(short_help="List the catalogue of physical effects.")
@click.argument("ids", metavar="[EFFECT]...", nargs=-1)
@json_option
def effects(ids: tuple[str, ...], as_json: bool) -> None:
    """List the physical effects of the catalogue, or show all details of the named ones.

    A model file lists effects by these names, with a value for each parameter.
    """
    from gsid.effects.types import catalogue, find

    chosen = [find(one) for one in ids] or list(catalogue().values())
    if as_json:
        print_json({"effects": [effect.to_dict() for effect in chosen]})
    elif ids:
        print("\n\n".join(map(repr, chosen)))
    else:
        rows = [
            [e.id, e.stage, ", ".join(f"{p.name} [{p.unit or '1'}]" for p in e.parameters), e.sentence]
            for e in chosen
        ]
        header = ["effect", "stage", "parameters", "description"]
        print_table(Table(header, rows, left=header))
