"""gsid_squares_search and gsid_arrow_covariance of the C library, for problems written in Python."""

from dataclasses import dataclass

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.errors import GsidError
from gsid.greybox.problem import SOLVERS
from gsid.greybox.settings import SETTINGS


@dataclass
class Found:
    x: np.ndarray
    cost: float
    is_blocked: list[bool]
    converged: bool
    n_iterations: int


def settings():
    """The settings of the search, copied: a part of a struct does not keep the struct alive."""
    entered = ffi.new("gsid_plant_fit_settings *")
    SETTINGS.to_c(entered)
    return ffi.new("gsid_squares_settings *", entered.search)


def search(problem, solver, n_max):
    """Search from problem.start() within problem.bounds().

    `problem.at(x)` gives cost, triangle R, projection q, and whether a search may come here from elsewhere,
    or raises GsidError. `problem.keep()` hears of the best points.
    """

    def at(_, x, cost, r, q):
        try:
            value, triangle, along, may_come = problem.at(np.frombuffer(ffi.buffer(x, 8 * problem.n)).copy())
        except GsidError as error:
            return error.code
        cost[0] = value
        ffi.memmove(r, np.ascontiguousarray(triangle, float), 8 * problem.n**2)
        ffi.memmove(q, np.ascontiguousarray(along, float), 8 * problem.n)
        return lib.GSID_OK if may_come else lib.GSID_MAX_ITER

    callbacks = (
        ffi.callback("gsid_status(void *, const double *, double *, double *, double *)", at),
        ffi.callback("void(void *)", lambda _: problem.keep()),
    )
    lower, upper = (np.array(bound, float) for bound in problem.bounds())
    c = ffi.new("gsid_squares *")
    c.n, c.at, c.keep = problem.n, *callbacks
    c.lower, c.upper = ffi.from_buffer("double[]", lower), ffi.from_buffer("double[]", upper)
    x, blocked = np.array(problem.start(), float), np.empty(problem.n, np.uint8)
    found, how = ffi.new("gsid_squares_result *"), settings()
    status = lib.gsid_squares_search(
        c,
        how,
        SOLVERS[solver],
        n_max,
        ffi.from_buffer("double[]", x),
        ffi.from_buffer("uint8_t[]", blocked),
        found,
    )
    check(status, "searching")
    return Found(x, found.cost, blocked.astype(bool).tolist(), bool(found.converged), found.n_iterations)


@dataclass
class Covariance:
    of_unknowns: np.ndarray
    is_open: np.ndarray
    n_open: int


def covariance(r):
    """Inverse of R'R without the directions that the data do not determine (GBX-5)."""
    n = len(r)
    r = np.ascontiguousarray(r)
    cov, share, n_open = np.empty((n, n)), np.empty(n), ffi.new("uint32_t *")
    rows = [ffi.from_buffer("double[]", each) for each in (r, cov, share)]
    status = lib.gsid_arrow_covariance(n, n, rows[0], SETTINGS.singular, *rows[1:], n_open)
    check(status, "computing the covariance of a fit")
    return Covariance(cov, share > SETTINGS.involved, n_open[0])
