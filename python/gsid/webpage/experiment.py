"""The form of an experiment: its fields, and the commands that they make."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gsid.base.arguments import is_one_line
from gsid.base.errors import InputError
from gsid.rig.axis import HIDDEN
from gsid.rig.axis_file import axis_parameters
from gsid.rig.samples import check_length
from gsid.study.folder import Study
from gsid.webpage.actions import inside
from gsid.webpage.body import number_of

TEXT_MOST = 200  # characters
LARGE = 300_000  # samples above which a record is written in binary form
LINES = ("full", "odd", "odd-random", "quasi-log")
SIMULATED = "simulated"


@dataclass(frozen=True)
class Field:
    """A number of the form.

    Attributes
    ----------
    name, title, unit : str
    why : str
        What it is for, in one sentence.
    default : str
        Empty: it has to be filled in.
    simulated : str
        Default on the simulated axis.
    whole : bool
        Whether it is a whole number.
    least : float
        Smallest value; excluded unless `whole`.
    """

    name: str
    title: str
    unit: str
    why: str
    default: str = ""
    simulated: str = ""
    whole: bool = False
    least: float = 0.0


EXCITATION = (
    Field("fs", "Sample rate", "Hz", "The rate of the axis's loop; the axis refuses another.", "3000"),
    Field(
        "period",
        "Period",
        "samples",
        "Lines lie at multiples of the rate over this number.",
        default="6000",
        whole=True,
        least=2,
    ),
    Field("low", "Lowest line", "Hz", "Begin of the band that is excited.", "1"),
    Field("high", "Highest line", "Hz", "End of the band that is excited.", "250"),
    Field("peak", "Peak command", "unit of the command", "Largest magnitude of the command.", "", "20"),
)
LENGTH = (
    Field("periods", "Good periods", "", "More periods give smaller error bars.", "8", whole=True, least=1),
    Field("settle", "Settling", "periods", "Left out until the axis repeats itself.", "2", whole=True),
)
LIMITS = (
    Field(
        "limit_command",
        "Limit of command",
        "unit of the command",
        "The run does not begin if the planned command exceeds what the drive may get.",
        simulated="179",
    ),
    Field(
        "limit_travel_deg",
        "Limit of travel",
        "deg to each side of the start",
        "The run is stopped before the axis reaches a stop or winds up its cable.",
        simulated="20",
    ),
    Field(
        "limit_rate",
        "Limit of rate",
        "deg/s",
        "The run is stopped if the axis runs away.",
        simulated="200",
    ),
)
FIELDS = (*EXCITATION, *LENGTH, *LIMITS)
EFFECTS = ("", *HIDDEN)  # of the simulated axis


@dataclass(frozen=True)
class Experiment:
    """The commands of an experiment, before they have the numbers of their steps.

    Attributes
    ----------
    design : tuple of str
        Words after `gsid` that design the excitation; empty if a file of the study has it.
    file : str
        This file.
    run : tuple of str
        Words after `gsid` that measure, without the files.
    kind : str
        Extension of the record.
    """

    design: tuple[str, ...]
    file: str
    run: tuple[str, ...]
    kind: str

    def design_step(self, number: int) -> tuple[list[str], str]:
        """Words of the design, and the file that it writes.

        Parameters
        ----------
        number : int
            Of the step.
        """
        path = f"excitation/{number}-multisine.csv"
        return [*self.design, "-o", path, "--json"], path

    def run_step(self, number: int, excitation: str) -> tuple[list[str], str]:
        """Words of the run, and the record that it writes.

        Parameters
        ----------
        number : int
            Of the step.
        excitation : str
            File in the study.
        """
        path = f"records/{number}-run{self.kind}"
        return [*self.run, f"--u={excitation}", "-o", path, "--json"], path


def ports() -> list[dict[str, str]]:
    """Serial ports of this computer: `path` and `title` of each."""
    from serial.tools import list_ports

    return [
        {"path": one.device, "title": f"{one.device} {one.description}".removesuffix(" n/a")}
        for one in list_ports.comports()
    ]


def experiment_of(study: Study, form: Mapping[str, Any]) -> Experiment:
    """Read a filled-in form.

    Parameters
    ----------
    study : Study
    form : mapping
        Text of each of `FIELDS`; port: a path, or "simulated" with effect, model (of the study) and
        lock_step; lines; file: path in the study of one period of the command, instead of `EXCITATION`.

    Raises
    ------
    InputError
        A field is empty or not valid, or the run is too long.
    """
    file = form.get("file") or ""
    needed = (*LENGTH, *LIMITS) if file else FIELDS
    values = {field.name: _number(field, form.get(field.name)) for field in needed}
    if not file:
        check_length(values["period"], values["settle"] * values["period"], values["periods"])
    n_samples = values.get("period", LARGE) * (values["settle"] + values["periods"])
    run = (
        "run",
        *_axis(study, form),
        f"--periods={values['periods']}",
        f"--settle={values['settle']}p",
        *(f"--{field.name.replace('_', '-')}={_typed(values[field.name])}" for field in LIMITS),
    )
    return Experiment(
        design=() if file else _design(values, form),
        file=_excitation_file(study, file) if file else "",
        run=run,
        kind=".npz" if n_samples > LARGE else ".csv",
    )


def _design(values: Mapping[str, float], form: Mapping[str, Any]) -> tuple[str, ...]:
    if values["peak"] > values["limit_command"]:
        found = f"{_typed(values['peak'])}, limit {_typed(values['limit_command'])}"
        raise InputError("the peak command exceeds its limit", "", found, "lower the peak command")
    lines = form.get("lines") or LINES[0]
    if lines not in LINES:
        raise InputError("not a valid choice", "lines", str(lines)[:TEXT_MOST], f"one of {', '.join(LINES)}")
    if not values["low"] < values["high"]:
        found = f"{_typed(values['low'])} to {_typed(values['high'])} Hz"
        raise InputError("the band is empty", "", found, "lower the lowest line")
    return (
        "design",
        "multisine",
        f"--fs={_typed(values['fs'])}",
        f"--period={values['period']}",
        f"--band={_typed(values['low'])}:{_typed(values['high'])}",
        f"--lines={lines}",
        f"--peak={_typed(values['peak'])}",
    )


def _typed(value: float) -> str:
    """A number with all its digits: a limit is never rounded upwards."""
    return repr(value).removesuffix(".0")


def _axis(study: Study, form: Mapping[str, Any]) -> list[str]:
    port = form.get("port")
    if port != SIMULATED:
        text = _text("port", port)
        if not text:
            raise InputError("no port is chosen", "", None, "choose a serial port, or the simulated axis")
        return [f"--port={text}"]
    model = form.get("model") or ""
    effect = form.get("effect") or ""
    if effect not in EFFECTS:
        raise InputError(
            "not a valid choice", "effect", str(effect)[:TEXT_MOST], f"one of {', '.join(HIDDEN)}"
        )
    options = ["--paced"] if not form.get("lock_step") else []
    options += ["--axis", shlex.quote(_model_file(study, model))] if model else []
    options += ["--effect", effect] if effect else []
    return [f"--simulate={' '.join(options)}"]


def _model_file(study: Study, name: object) -> str:
    """A model of the study, which the simulated axis can have."""
    path = inside(study, name, "models/")
    axis_parameters(path)  # refused before the axis moves
    return str(name)


def _excitation_file(study: Study, name: object) -> str:
    text = _text("file", name)
    if not text.startswith(("excitation/", "records/")):
        raise InputError("no such file in the study", text, None, "choose one of the list")
    study.path(text)
    return text


def _text(name: str, value: object) -> str:
    if not isinstance(value, str) or len(value) > TEXT_MOST or not is_one_line(value):
        raise InputError("not a valid text", name, str(value)[:TEXT_MOST])
    return value.strip()


def _number(field: Field, value: object) -> float | int:
    if value in (None, ""):
        raise InputError(
            f"{field.title}: no value is given", "", None, f"fill it in [{field.unit}]. {field.why}"
        )
    found = number_of(value)
    is_good = math.isfinite(found) and (found >= field.least if field.whole else found > field.least)
    if not is_good or (field.whole and found != int(found)):
        kind = "a whole number" if field.whole else "a positive number"
        raise InputError(
            f"{field.title}: not {kind}", "", str(value)[:TEXT_MOST], f"[{field.unit}] {field.why}"
        )
    return int(found) if field.whole else found
