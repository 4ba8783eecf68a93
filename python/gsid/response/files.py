"""Write a frequency response as .csv, .npz or .mat, and read it again from .csv."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from gsid.base.errors import InputError
from gsid.base.files import kind_of, write_atomically
from gsid.records.csv import read_columns
from gsid.response.frf import Frf

KINDS = (".csv", ".npz", ".mat")
MARKS = ("f_hz", "g_re", "g_im", "var_g")  # columns that every response has
COUNTS = ("n_periods", "n_realisations", "n_spoiled", "period_samples", "settle_samples")
KEYS = (*COUNTS, "fs_hz", "hold", "u_unit", "y_unit", "n_dof", "method")


def columns_of(response: Frf) -> dict[str, np.ndarray]:
    """Columns of a response, one value per line.

    Parameters
    ----------
    response : Frf

    Returns
    -------
    dict of (F,) ndarrays
        `var_total` and `dof` only if the response has them.
    """
    columns = {
        "line": response.line,
        "f_hz": response.f_hz,
        "g_re": response.g.real,
        "g_im": response.g.imag,
        "var_g": response.var_g,
        "u_re": response.u.real,
        "u_im": response.u.imag,
        "y_re": response.y.real,
        "y_im": response.y.imag,
        "var_u": response.var_u,
        "var_y": response.var_y,
        "cov_yu_re": response.cov_yu.real,
        "cov_yu_im": response.cov_yu.imag,
    }
    optional = {"var_total": response.var_total, "dof": response.dof}
    return columns | {name: value for name, value in optional.items() if value is not None}


def keys_of(response: Frf) -> dict[str, object]:
    """Values of a response that are the same for all lines.

    Parameters
    ----------
    response : Frf
    """
    return {name: getattr(response, name) for name in KEYS}


def write_response(path: str | os.PathLike, response: Frf) -> None:
    """Write a response without loss of precision, by the extension.

    Parameters
    ----------
    path : path_like
        .csv, .npz or .mat; "-" is the standard output, as CSV.
    response : Frf

    Raises
    ------
    ValueError
        The extension is unknown.
    OSError
        The file cannot be written. An existing file is unchanged.
    """
    columns = columns_of(response)
    keys = {key: value for key, value in keys_of(response).items() if value is not None}

    def write_csv(part: Path) -> None:
        head = [f"# {key}: {value}" for key, value in keys.items()] + [",".join(columns)]
        table = np.column_stack(list(columns.values()))
        np.savetxt(part, table, "%.17g", ",", header="\n".join(head), comments="")

    def write_mat(part: Path) -> None:
        from scipy.io import savemat

        savemat(part, columns | keys, oned_as="column")

    writers = {".csv": write_csv, ".npz": lambda part: np.savez(part, **columns, **keys), ".mat": write_mat}
    kind = kind_of(path, stream=".csv")
    if kind not in writers:
        raise ValueError(f"cannot write {Path(path).name}: .csv, .npz or .mat")
    write_atomically(path, writers[kind])


def is_response(path: str | os.PathLike) -> bool:
    """Whether a file is a response as `gsid frf -o FILE.csv` writes it.

    Parameters
    ----------
    path : path_like
    """
    path = Path(path)
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    from gsid.records.csv import csv_columns

    try:
        return set(MARKS) <= set(csv_columns(path))
    except (InputError, OSError):
        return False


def read_response(path: str | os.PathLike) -> Frf:
    """Read a response from CSV.

    Parameters
    ----------
    path : path_like
        As `gsid frf -o FILE.csv` writes it, or with the columns f_hz, g_re, g_im and var_g at least. Without
        `n_dof` the variance is taken as known.

    Returns
    -------
    Frf

    Raises
    ------
    InputError
        The file is not a response, or a value is not valid.
    """
    path = Path(path)
    columns, keys = read_columns(path, MARKS)
    with_number = {name: keys[name] for name in (*COUNTS, "fs_hz", "n_dof") if name in keys}
    numbers = {name: _number(path, name, text) for name, text in with_number.items()}
    g = columns["g_re"] + 1j * columns["g_im"]
    _check(path, columns)
    try:
        plain = Frf.from_arrays(columns["f_hz"], g, columns["var_g"], fs_hz=numbers.get("fs_hz", np.nan))
    except ValueError as error:
        raise InputError("not a valid response", str(path), error, "measure again") from error
    texts = {name: str(keys[name]) for name in ("hold", "u_unit", "y_unit", "method") if name in keys}
    values = {name: int(numbers[name]) for name in COUNTS if name in numbers} | texts
    values["n_dof"] = numbers.get("n_dof", np.inf)
    if texts.get("hold") not in ("zoh", "none"):
        values["hold"] = None
    return _with(plain, path.name, columns, values)


def _with(plain: Frf, name: str, columns: dict[str, np.ndarray], values: dict[str, object]) -> Frf:
    """Fill in the columns that the file has beside those of every response."""
    from dataclasses import replace

    if "line" in columns:
        values["line"] = columns["line"].astype(int)
    for own in ("u", "y", "cov_yu"):
        if f"{own}_re" in columns and f"{own}_im" in columns:
            values[own] = columns[f"{own}_re"] + 1j * columns[f"{own}_im"]
    for own in ("var_u", "var_y", "var_total", "dof"):
        if own in columns:
            values[own] = columns[own]
    return replace(plain, name=name, **values)


def _number(path: Path, name: str, text: object) -> float:
    try:
        number = float(str(text))
    except ValueError:
        number = -1.0
    if not number >= 0 or (name in COUNTS and number % 1):
        raise InputError(f"{name} is not valid", str(path), text, "write the response again")
    return number


def _check(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Refuse values that are not finite, variances below 0, and lines that do not ascend."""
    for name, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values) if name != "dof" else np.isnan(values))
        if name.startswith("var") or name == "dof":
            bad = np.flatnonzero(~(values >= 0))
        if bad.size:
            place = f"{path}, row {bad[0] + 1}, column {name}"
            raise InputError("not a valid value of a response", place, values[bad[0]], "remove the row")
    falls = np.flatnonzero(np.diff(columns["f_hz"]) <= 0)
    if falls.size:
        place = f"{path}, row {falls[0] + 2}"
        raise InputError("the lines do not ascend", place, columns["f_hz"][falls[0] + 1], "sort the rows")
