"""Types of options and arguments: what a word of the command line has to look like."""

from __future__ import annotations

import math
import re

import click


class Band(click.ParamType):
    """LO:HI in Hz."""

    name = "LO:HI"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        if isinstance(value, tuple):
            return value
        try:
            lo, hi = (float(part) for part in str(value).split(":"))
        except ValueError:
            self.fail(f"{value} is not LO:HI in Hz, for example 1:250", param, ctx)
        if not 0 <= lo < hi < math.inf:
            self.fail(f"{value}: LO must be at least 0 and below HI", param, ctx)
        return lo, hi


class Order(click.ParamType):
    """POLES/ZEROS, or auto if allowed."""

    def __init__(self, *, may_be_auto: bool = False) -> None:
        self.may_be_auto = may_be_auto
        self.name = "POLES/ZEROS|auto" if may_be_auto else "POLES/ZEROS"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if not re.fullmatch(r"\d+/\d+", value) and not (self.may_be_auto and value == "auto"):
            self.fail(f"{value} is not POLES/ZEROS, for example 4/3", param, ctx)
        return value


class Value(click.ParamType):
    """NAME=VALUE."""

    name = "NAME=VALUE"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        if isinstance(value, tuple):
            return value
        name, equals, number = str(value).partition("=")
        try:
            if equals:
                return name.strip(), float(number)
        except ValueError:
            pass
        self.fail(f"{value} is not NAME=VALUE, for example level=2", param, ctx)


class UnitOf(click.ParamType):
    """NAME=UNIT."""

    name = "NAME=UNIT"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, str]:
        if isinstance(value, tuple):
            return value
        name, equals, unit = str(value).rpartition("=")
        if not equals or not name.strip() or not unit.strip():
            self.fail(f"{value} is not NAME=UNIT, for example y=deg/s", param, ctx)
        return name.strip(), unit.strip()


class FiniteRange(click.FloatRange):
    """A range without infinity, which no limit is."""

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        found = super().convert(value, param, ctx)
        if not math.isfinite(found):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return found


class Ends(click.ParamType):
    """LO:HI around 0, of which one may be empty; D stands for -D:D where one number may."""

    def __init__(self, *, may_be_one: bool = False) -> None:
        self.may_be_one = may_be_one
        self.name = "D|LO:HI" if may_be_one else "LO:HI"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        if isinstance(value, tuple):
            return value
        low, colon, high = str(value).partition(":")
        if not colon and self.may_be_one:
            low, colon, high = f"-{low}", ":", low
        try:
            ends = (float(low or -math.inf), float(high or math.inf)) if colon else (0.0, 0.0)
        except ValueError:
            ends = 0.0, 0.0
        if not ends[0] < 0 < ends[1] or ends == (-math.inf, math.inf):
            examples = "2, -135:50, -135: or :50" if self.may_be_one else "-135:50, -135: or :50"
            self.fail(f"{value} is not like {examples}, with 0 between the ends", param, ctx)
        return ends


class Scale(click.ParamType):
    """A number on the line and what it is in a unit."""

    name = "N=XUNIT"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, str]:
        if isinstance(value, tuple):
            return value
        number, _, rest = str(value).partition("=")
        found = re.fullmatch(r"([-+.\deE]*\d\.?)\s*([^\d\s.+-]\S*)", rest)
        try:
            scale = float(number) / float(found[1]) if found else math.nan
        except (ValueError, ZeroDivisionError):
            scale = math.nan
        if found is None or not (math.isfinite(scale) and scale):
            self.fail(f"{value} is not like 179=10V: a number on the line, and what it is", param, ctx)
        return scale, found[2]
