"""Read and write records as CSV: `# key: value` lines, a header row, rows of numbers."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from gsid.base.arguments import is_one_line
from gsid.base.errors import InputError, choose
from gsid.records.raw import TIME_NAMES, Raw, keys_of
from gsid.records.record import Record

_log = logging.getLogger(__name__)


def read_csv(path: Path, u: str, y: str, fs_hz: float | None) -> Raw:
    def where(column: str, sample: int) -> str:
        return f"{path} line {_line_of_sample(path, sample)}, column {column}"

    try:
        with open(path, encoding="utf-8-sig") as file:
            keys, names, separator = _read_head(path, file)
            missing = [name for name in (u, y) if name not in names]
            if missing:
                raise InputError(
                    f"no column named {missing[0]}", str(path), None, _columns_hint(missing[0], y, names)
                )
            rows = (_with_commas(line, separator) for line in file)
            table, kept = _read_rows(path, rows, names, {u, y, *TIME_NAMES, "valid"})
    except UnicodeDecodeError as error:
        raise InputError("the file is not text", str(path), None, "is it really CSV?") from error
    return Raw(dict(zip(kept, table.T, strict=True)), keys, where, "column")


def read_columns(path: Path, needed: Iterable[str]) -> tuple[dict[str, np.ndarray], dict[str, object]]:
    """Columns and keys of a CSV file of numbers that is not a record.

    Parameters
    ----------
    path : Path
    needed : iterable of str
        Columns that must be present.

    Returns
    -------
    dict of (n,) ndarrays, dict

    Raises
    ------
    InputError
        The file cannot be read, a column is missing, or a value is not a number.
    """
    try:
        with open(path, encoding="utf-8-sig") as file:
            keys, names, separator = _read_head(path, file)
            missing = [name for name in needed if name not in names]
            if missing:
                raise InputError(f"no column named {missing[0]}", str(path), None, choose(missing[0], names))
            rows = (_with_commas(line, separator) for line in file)
            table, kept = _read_rows(path, rows, names, set(needed))
    except UnicodeDecodeError as error:
        raise InputError("the file is not text", str(path), None, "is it really CSV?") from error
    return dict(zip(kept, table.T, strict=True)), keys


def csv_columns(path: Path) -> list[str]:
    """Names in the header of a CSV file."""
    try:
        with open(path, encoding="utf-8-sig") as file:
            return _read_head(path, file)[1]
    except UnicodeDecodeError as error:
        raise InputError("the file is not text", str(path), None, "is it really CSV?") from error


def _columns_hint(missing: str, y: str, names: list[str]) -> str:
    return f"{choose(missing, names)}; select it with {'--y' if missing == y else '--u'}"


def _separator(header: str) -> str:
    """What separates the columns: a comma, a semicolon or a tab."""
    return max(",;\t", key=header.count)


def _with_commas(line: str, separator: str) -> str:
    """A row with commas between the columns. Where another character separates them, a comma is a decimal."""
    return line if separator == "," else line.replace(",", ".").replace(separator, ",")


def _read_head(path: Path, file: Iterable[str]) -> tuple[dict[str, object], list[str], str]:
    """Read the `# key: value` lines, the names of the columns, and what separates them."""
    keys: dict[str, object] = {}
    for line in file:
        if line.startswith("#"):
            key, colon, value = line[1:].partition(":")
            if colon:
                keys[key.strip()] = value.strip()
        elif line.strip():
            separator = _separator(line)
            names = [name.strip().strip('"') for name in line.split(separator)]
            if _is_number(names[0].replace(",", ".")):
                raise InputError(
                    "no header row", str(path), line.strip()[:60], "name the columns first: t_s,u,y"
                )
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise InputError("two columns have the same name", str(path), twice, "rename one of them")
            return keys, names, separator
    raise InputError("there are no samples", str(path), None, "measure again, or check the export")


def _read_rows(
    path: Path, file: Iterable[str], names: list[str], needed: set[str]
) -> tuple[np.ndarray, list[str]]:
    first = next((line for line in file if line.strip()), None)
    if first is None:
        raise InputError("there are no samples", str(path), None, "measure again, or check the export")
    fields = [field.strip() for field in first.split(",")]
    texts = {
        i
        for i, field in enumerate(fields[: len(names)])
        if names[i] not in needed and field and not _is_number(field)
    }
    if texts:
        names_of_texts = ", ".join(names[i] for i in sorted(texts))
        _log.info("%s: columns without numbers are ignored: %s", path.name, names_of_texts)
    columns = [i for i in range(len(names)) if i not in texts]
    try:
        table = np.loadtxt(
            itertools.chain([first], file),
            delimiter=",",
            comments=None,
            ndmin=2,
            usecols=columns if texts else None,
        )
        if table.shape[1] != len(columns):
            raise ValueError
    except UnicodeDecodeError:
        raise
    except ValueError as error:
        fault = _fault_in_rows(path, names, columns)
        if fault is not None:
            raise fault from error
        table = _read_blanks(path, columns)
    return table, [names[i] for i in columns]


def _read_blanks(path: Path, columns: list[int]) -> np.ndarray:
    """Read rows with empty fields, as in the row of a lost sample, as NaN (slow)."""
    rows = (line.split(",") for _, line in _data_lines(path))
    return np.array([[float(row[i].strip() or "nan") for i in columns] for row in rows])


def _data_lines(path: Path) -> Iterable[tuple[int, str]]:
    """Yield line number and text of each row. Like the fast reader, it skips blank lines."""
    with open(path, encoding="utf-8-sig") as file:
        lines = ((number, line) for number, line in enumerate(file, 1) if line.strip())
        rows = itertools.dropwhile(lambda item: item[1].startswith("#"), lines)
        _, header = next(rows)
        separator = _separator(header)
        yield from ((number, _with_commas(line, separator)) for number, line in rows)


def _line_of_sample(path: Path, sample: int) -> int:
    return next(itertools.islice(_data_lines(path), sample, None))[0]


def _fault_in_rows(path: Path, names: list[str], columns: list[int]) -> InputError | None:
    """Find the row that the fast reader refused. An empty field is valid if lost samples are marked."""
    for number, line in _data_lines(path):
        place, fields = f"{path} line {number}", line.rstrip("\r\n").split(",")
        if len(fields) != len(names):
            hint = "repair the row" if line.endswith("\n") else "the file was cut short: delete its last row"
            return InputError(
                f"the row has {len(fields)} columns, the header {len(names)}", place, line.strip(), hint
            )
        for i in columns:
            value = fields[i].strip()
            if not value and "valid" not in names:
                hint = "write a number; if the sample is lost, add a column valid with 0 in this row"
                return InputError(f"empty value in column {names[i]}, line {number}", str(path), None, hint)
            if value and not _is_number(value):
                hint = "write numbers with a decimal point; mark a lost sample with valid = 0"
                return InputError("not a number", f"{place}, column {names[i]}", value, hint)
    return None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def _check_writable(record: Record, keys: dict[str, object]) -> None:
    """Refuse names and texts that a reader would interpret as other lines, columns or keys."""
    hint = "rename it, or write .npz, .mat or .h5"
    for name in record.columns:
        if not is_one_line(name) or name != name.strip().strip('"') or set(name) & set(',"') or not name:
            raise InputError("CSV cannot store the name of a column", record.name, repr(name), hint)
    for key, value in keys.items():
        if not is_one_line(str(value)):
            raise InputError(f"CSV cannot store the value of {key}", record.name, repr(value)[:60], hint)
        if not is_one_line(key) or ":" in key or not key.strip():
            raise InputError("CSV cannot store the name of a key", record.name, repr(key), hint)


def write_csv(path: Path, record: Record) -> None:
    columns = {"t_s": record.t_s, "u": record.u, "y": record.y, **record.columns}
    keys = keys_of(record) | record.meta
    _check_writable(record, keys)
    # repr of a Python float is the shortest text that reads back as the same number
    texts = [map(repr, np.asarray(c, np.float64).tolist()) for c in columns.values()]
    names = list(columns)
    if not record.valid.all():
        names.append("valid")
        texts.append(map(str, record.valid.astype(int).tolist()))
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"# {key}: {value}\n" for key, value in keys.items())
        file.write(",".join(names) + "\n")
        file.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))
