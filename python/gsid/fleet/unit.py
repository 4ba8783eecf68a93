"""One unit: what is run on it, and its result."""

from __future__ import annotations

import importlib
import importlib.metadata
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

from gsid.base.errors import InputError
from gsid.fleet.address import ANSWERS, record_digest

DONE, FAILED, CHANGED = "done", "failed", "changed"
"""Status of a unit. The last: its records were changed after the plan, so that no result is kept."""

Work = Callable[["Job"], dict[str, Any]]


def version() -> str:
    """Version of gsid and of its answers, as the column `version` shows it."""
    return f"{importlib.metadata.version('gsid')}+answers{ANSWERS}"


@dataclass(frozen=True)
class Limits:
    """Limits of one unit.

    Attributes
    ----------
    seconds : float or None
        Longest run time.
    memory_mb : float or None
        Largest address space.
    """

    seconds: float | None = None
    memory_mb: float | None = None


@dataclass(frozen=True)
class Job:
    """What is run on one unit; all of it can be JSON.

    Attributes
    ----------
    key : str
        Address of the result.
    work : str
        "module:function" that receives the job and returns the answer.
    unit : str
    records, digests : list of str
        Files, and what they held when the unit was planned.
    arguments : dict
        For the function.
    seed : int or None
        Of the random numbers; it is part of a failure's result.
    """

    key: str
    work: str
    unit: str
    records: list[str] = field(default_factory=list)
    digests: list[str] = field(default_factory=list)
    arguments: dict[str, Any] = field(default_factory=dict)
    seed: int | None = None

    def to_dict(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self)

    def is_changed(self) -> bool:
        """Whether a record is no longer what was planned."""
        return [record_digest(path) for path in self.records] != self.digests


def work_of(name: str) -> Work:
    """Import the function "module:function"."""
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(module), function)


def result_of(job: Job, status: str, **more: object) -> dict[str, Any]:
    """A result with where and with what it was computed."""
    known = {"key": job.key, "status": status, "version": version(), "host": platform.node()}
    return known | {"seed": job.seed, "records": job.records, **more}


def require_same_version(expected: str) -> None:
    """Refuse to run units that another version has planned.

    Raises
    ------
    InputError
        The installed version is another one.
    """
    if version() != expected:
        raise InputError(
            "the worker has another version of gsid than the command",
            platform.node(),
            f"{version()}, not {expected}",
            "install the same version on every machine of the cluster",
        )
