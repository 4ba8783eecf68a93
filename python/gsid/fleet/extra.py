"""Packages of the extra gsid[fleet], which the base installation does not have."""

from __future__ import annotations

import importlib.util

from gsid.base.errors import InputError


def require(*packages: str) -> None:
    """Check that packages are installed.

    Raises
    ------
    InputError
        One of them is not.
    """
    absent = [name for name in packages if importlib.util.find_spec(name) is None]
    if absent:
        hint = (
            "pip install 'gsid[fleet]'; --shard I/N runs units without Dask, `gsid fleet merge` needs pyarrow"
        )
        raise InputError("a package is not installed", "gsid fleet", ", ".join(absent), hint)
