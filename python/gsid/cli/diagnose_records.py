"""gsid diagnose without a model: from the records to the verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from gsid.cli.common import EXIT_GOOD, EXIT_INTERRUPT
from gsid.cli.options import options_as_arguments
from gsid.cli.output import (
    command_line,
    draw,
    print_json,
    print_message,
    print_parameters,
    print_table,
    suggest,
)

if TYPE_CHECKING:
    from gsid.diagnosis.from_records.result import RecordsDiagnosis
    from gsid.diagnosis.torque_residual import TorqueResidual
    from gsid.records.record import Record


def diagnose_without_model(
    records: Sequence[str],
    read: Callable[[Sequence[str]], list[Record]],
    how: dict[str, object],
    *,
    path: str | None,
    curve: str | None,
    picture: str | None,
    as_json: bool,
) -> int:
    """Run `gsid diagnose` without --model.

    Parameters
    ----------
    records : sequence of str
    read : callable
        From paths to records.
    how : dict
        Options of `diagnose_records`.
    path, curve, picture : str or None
        Files to write: the model, the law of the missing torque, and the picture.
    as_json : bool

    Returns
    -------
    int
        Exit code.
    """
    from gsid.diagnosis.from_records.diagnose import diagnose_records

    with options_as_arguments():
        found = diagnose_records(read(records), **how, on_step=lambda text: print_message(f"-- {text}"))
    if path:
        _save(found, path)
    missing = _missing(found, curve)
    draw(found.plot, picture)
    if as_json:
        print_json(found.to_dict() | _law(missing))
    else:
        _print(found, missing)
        _suggest(found, records, path)
    return EXIT_INTERRUPT if found.interrupted else EXIT_GOOD


def _save(found: RecordsDiagnosis, path: str) -> None:
    if found.model is None:
        print_message(f"note: no stack of effects represents the data: {path} was not written")
        return
    found.model.save(path)
    print_message(f"wrote {path}, {'with' if found.named else 'without'} a missing effect")


def _missing(found: RecordsDiagnosis, curve: str | None) -> TorqueResidual | None:
    """The missing torque as a curve, if it was requested or if no law explains it."""
    if found.linear is None or not (curve or found.verdict in ("unknown_effect", "nearest_effect")):
        return None
    missing = found.torque_residual()
    if curve:
        missing.best.save(curve)
        print_message(f"wrote {curve}: torque against {missing.best.name}")
    return missing


def _law(missing: TorqueResidual | None) -> dict[str, object]:
    if missing is None:
        return {}
    best = missing.best
    keys = {"variable": best.name, "unit": best.unit, "explained": best.explained, "std": best.std}
    return {"missing_torque": keys | {"at": best.at, "torque": -best.torque}}


def _print(found: RecordsDiagnosis, missing: TorqueResidual | None) -> None:
    print(found.sentence)
    for text in found.reasons:
        print(f"  {text}")
    if found.ranking:
        print()
        print_table(found.table())
    if found.model is not None:
        print()
        print_parameters(found.model)
    print()
    for text in found.notes[len(found.reasons) :]:
        print(text)
    if missing is not None:
        print(f"\n{missing.sentence}")


def _suggest(found: RecordsDiagnosis, records: Sequence[str], path: str | None) -> None:
    """Suggest the next command: only a new record can judge the effect."""
    if found.verdict == "unknown_effect":
        suggest("--curve CURVE.csv saves the missing torque as a law")
    if not found.effects or found.adequate:
        return
    linear = "LINEAR.json"
    typed = command_line(
        "add", found.effects[0], "--model", linear, "--held-out", "NEW.csv", records=records, output="M2.json"
    )
    suggest(f"{typed} judges it on a new record; `gsid start REC... -o {linear}` writes the linear model")
