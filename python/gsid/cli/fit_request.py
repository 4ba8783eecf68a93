"""Options of `gsid fit`, declared once for every kind of fit, and their values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from gsid.cli.files_in_use import INPUT, OUTPUT
from gsid.cli.options import add_options, band_option, held_out_option, inertia_option, order_option

if TYPE_CHECKING:
    from gsid.records.mimo import MimoRecord
    from gsid.records.record import Record


class Pieces(click.ParamType):
    """A number of pieces, or auto."""

    name = "N|auto"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> str | int:
        if value == "auto" or isinstance(value, int):
            return value
        if not str(value).isdecimal() or int(value) < 1:
            self.fail(f"{value} is not auto or a number of pieces", param, ctx)
        return int(value)


class Delay(click.ParamType):
    """free, common, none or seconds."""

    name = "free|common|none|SECONDS"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> str | float:
        if value in ("free", "common", "none") or isinstance(value, float):
            return value
        try:
            seconds = float(value)
        except ValueError:
            seconds = -1.0
        if not 0 <= seconds < float("inf"):
            self.fail(f"{value} is not free, common, none or a number of seconds", param, ctx)
        return seconds


FIT_OPTIONS = (
    order_option,
    click.option(
        "--piecewise",
        metavar="N|auto",
        type=Pieces(),
        help="Split the band into N pieces and fit a model of this order in each. auto chooses the number of"
        " least MDL.",
    ),
    held_out_option(),
    click.option(
        "--model",
        "model_path",
        metavar="M.json",
        type=INPUT,
        help="Stack of effects (model file): fit its free parameters instead.",
    ),
    click.option(
        "--delay",
        metavar="free|common|none|SECONDS",
        type=Delay(),
        default="free",
        show_default=True,
        help="Delay: fitted (common: one for all responses), none, or a known value.",
    ),
    click.option(
        "--method",
        type=click.Choice(["ls", "iwls", "ga", "nls-output", "nls", "log", "ml-io", "ml", "all"]),
        default="ml",
        show_default=True,
        help="ls: least squares. iwls: iteratively reweighted. ga: evolutionary start. nls-output, nls: "
        "nonlinear, on the "
        "output or the response. log: logarithmic. ml: maximum likelihood. ml-io: with errors in the input "
        "too. all: a table of all.",
    ),
    band_option("Lines from LO to HI [Hz] only."),
    click.option(
        "--allow-unstable", is_flag=True, help="Accept the model of least cost even if it is unstable."
    ),
    click.option(
        "--domain",
        type=click.Choice(["s", "z"]),
        default="s",
        show_default=True,
        help="Continuous (s) or discrete (z) model.",
    ),
    inertia_option,
    click.option(
        "-o",
        "--output",
        metavar="M.json|M.mat",
        type=OUTPUT,
        help="Write the model with its covariance; .mat is for MATLAB.",
    ),
)
fit_options = add_options(FIT_OPTIONS)


@dataclass(frozen=True)
class FitRequest:
    """Arguments of one `gsid fit`.

    Attributes
    ----------
    records, held_out : sequence of str
        Files to fit and to judge on.
    read : callable
        From files to records, as the reading options state.
    reference : str or None
        Column of the reference of a closed loop.
    order : str or None
        POLES/ZEROS or "auto".
    piecewise : int or "auto" or None
        Number of pieces.
    model_path : str or None
        Stack of effects whose free parameters are fitted.
    delay : str or float
        "free", "common", "none" or seconds.
    method, domain : str
    inertia_kg_m2 : float or None
        Of a stack of effects.
    band : (lo, hi) or None
        Hz.
    allow_unstable : bool
    output, picture : str or None
        Files to write.
    as_json : bool
    """

    records: Sequence[str]
    read: Callable[..., list[Record] | list[MimoRecord]]
    reference: str | None
    order: str | None
    piecewise: str | int | None
    held_out: Sequence[str]
    model_path: str | None
    delay: str | float
    method: str
    band: tuple[float, float] | None
    domain: str
    allow_unstable: bool
    inertia_kg_m2: float | None
    output: str | None
    picture: str | None
    as_json: bool

    @property
    def model_options(self) -> dict[str, Any]:
        """Arguments of every fit of a transfer function."""
        options = {"delay": self.delay, "band": self.band, "domain": self.domain}
        return options | ({"allow_unstable": True} if self.allow_unstable else {})

    def read_held_out(
        self, fitted: Sequence[Record | MimoRecord], *, matrix: bool = False
    ) -> list[Record] | list[MimoRecord]:
        """Records to judge on.

        Raises
        ------
        InputError
            One of them is fitted too.
        """
        from gsid.spectrum.held_out import check_held_out

        held_out = self.read(self.held_out, matrix=matrix)
        check_held_out(fitted, held_out)
        return held_out
