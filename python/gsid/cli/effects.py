"""gsid effects"""

from __future__ import annotations

import click

from gsid.cli.options import json_option
from gsid.cli.output import print_json, print_table


@click.command(short_help="List the catalogue of physical effects.")
@click.argument("ids", metavar="[EFFECT]...", nargs=-1)
@json_option
def effects(ids: tuple[str, ...], as_json: bool) -> None:
    """List the physical effects that a plant can be made of, or tell all about those named.

    A model file names them, with a value for each of their parameters.
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
        header = ["effect", "stage", "parameters", "what it is"]
        print_table(header, rows, left=header)
