"""gsid fit --order auto, of one response or a matrix of them"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gsid.cli.options import options_as_arguments
from gsid.cli.output import print_table, working

if TYPE_CHECKING:
    from gsid.fitting.order import OrderChoice
    from gsid.response.frf import Frf
    from gsid.response.mimo import MimoFrf


def choose_order(frf: Frf | MimoFrf, records: str, **options: object) -> OrderChoice:
    """Choose the order for what was measured from `records`, in words."""
    from gsid.fitting.order import select_order

    with working(f"choosing an order for {records}"), options_as_arguments():
        return select_order(frf, **options)


def orders_as_json(choice: OrderChoice | None) -> dict[str, list[dict]]:
    """The orders tried, without their models; empty if the order was given."""
    if choice is None:
        return {}
    rows = []
    for c in choice.tried:
        row = {name: value for name, value in vars(c).items() if name != "model"}
        row["held_out"] = c.held_out and vars(c.held_out)
        rows.append(row | {"chosen": c is choice.chosen})
    return {"orders": rows}


def print_orders(choice: OrderChoice | None) -> None:
    """Print the table of orders and the cancelled roots."""
    if choice is None:
        return
    print_table(choice.table())
    for text in choice.removed:
        print(text)
    print()
