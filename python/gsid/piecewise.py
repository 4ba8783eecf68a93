"""Sets of low-order models, each for a band of its own, with the breaks between them (source, section 8.3).

A response that one model could only follow with a very high order, such as that of an axis with friction, is
cut into adjoining bands with a model of low order in each. Breaks are chosen together: for each number of
pieces, the least sum of the costs of eq. 7.28 over all ways to cut at a grid of candidates (dynamic
programming), then line by line around the breaks. The number of pieces is that of least MDL,

    sum of V + (N p + N - 1)/2 ln(2 F)  (ORD-3)

A set is not a system: it answers at a frequency, not in time, and is not continuous at its breaks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gsid._lib import lib, version
from gsid.bands import in_band
from gsid.errors import GsidError, InputError
from gsid.files import write_atomically
from gsid.fit import fit, parse_order
from gsid.hold import fit_readings, likelier, other_reading
from gsid.model import FORMAT, RationalModel, read_model_file, write_model_file

if TYPE_CHECKING:
    import matplotlib.figure

    from gsid.frf import Frf

PIECES_MAX = 6
INTERVALS = 20  # of the grid of candidates, even in log f
NARROWED_BY = 5  # places looked at between two candidates, then between two of these


@dataclass(frozen=True)
class Jump:
    """What the response does at a break, from the piece below to the piece above.

    Attributes
    ----------
    f_hz : float
    gain_db, phase_deg : float
    sigmas : float
        Size of the jump over its standard deviation by the pieces' covariances.
    """

    f_hz: float
    gain_db: float
    phase_deg: float
    sigmas: float


@dataclass(frozen=True)
class Cut:
    """The best set of one number of pieces.

    Attributes
    ----------
    n_pieces : int
    cost, cost_expected : float
        Sums of V and of what noise alone leaves of it.
    mdl : float
        ORD-3.
    """

    n_pieces: int
    cost: float
    cost_expected: float
    mdl: float


@dataclass(frozen=True, repr=False)
class PiecewiseModel:
    """Models of low order in adjoining bands.

    Attributes
    ----------
    pieces : tuple of RationalModel
        In order of frequency; `band_hz` of each is the band it was fitted in.
    breaks_hz : tuple of float
        Between the pieces [Hz]: below one the lower piece counts, from it on the upper.
    tried : tuple of Cut
        Numbers of pieces that were looked at; empty for a set read from a file.

    Raises
    ------
    ValueError
        Breaks that do not rise, or of which there is not one less than pieces; a piece that was not fitted.
    """

    pieces: tuple[RationalModel, ...]
    breaks_hz: tuple[float, ...]
    tried: tuple[Cut, ...] = ()

    def __post_init__(self) -> None:
        if len(self.breaks_hz) != len(self.pieces) - 1 or np.any(np.diff(self.breaks_hz) <= 0):
            raise ValueError(f"{len(self.pieces)} pieces need as many rising breaks less one")
        if not self.pieces or any(piece.band_hz is None for piece in self.pieces):
            raise ValueError("every piece needs the band it was fitted in")

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest line fitted [Hz]."""
        return (self.pieces[0].band_hz[0], self.pieces[-1].band_hz[1])

    @property
    def fs_hz(self) -> float | None:
        return self.pieces[0].fs_hz

    @property
    def n_parameters(self) -> int:
        """Of all pieces; the breaks come on top."""
        return sum(piece.n_parameters for piece in self.pieces)

    @property
    def n_lines(self) -> int:
        return sum(piece.n_lines or 0 for piece in self.pieces)

    @property
    def cost(self) -> float:
        """Sum of V of eq. 7.28 over the pieces."""
        return float(sum(piece.cost or 0 for piece in self.pieces))

    @property
    def cost_expected(self) -> float:
        """What noise alone leaves of the cost."""
        return float(sum(piece.cost_expected or 0 for piece in self.pieces))

    @property
    def stable(self) -> bool:
        return all(piece.stable for piece in self.pieces)

    @property
    def converged(self) -> bool:
        return all(bool(piece.converged) for piece in self.pieces)

    @property
    def u_unit(self) -> str:
        return self.pieces[0].u_unit

    @property
    def y_unit(self) -> str:
        return self.pieces[0].y_unit

    def piece_at(self, f_hz: np.ndarray | float) -> np.ndarray:
        """Number of the piece that counts at each frequency [Hz], from 0."""
        return np.searchsorted(self.breaks_hz, f_hz, side="right")

    def response(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Response at each frequency, of the piece whose band it is in; outside all bands of the nearest.

        Parameters
        ----------
        f_hz : (k,) array_like
            Hz.

        Returns
        -------
        (k,) complex ndarray
        """
        return self._by_piece(f_hz, RationalModel.response, complex)

    def response_std(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Standard deviation of the complex response by the piece's covariance, (k,)."""
        return self._by_piece(f_hz, RationalModel.response_std, float)

    def deviations(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """As `RationalModel.deviations`: (k, r) complex, the directions of each piece in turn."""
        f = np.atleast_1d(np.asarray(f_hz, dtype=float))
        number = self.piece_at(f)
        each = [piece.deviations(f) * (number == i)[:, None] for i, piece in enumerate(self.pieces)]
        return np.hstack(each)

    def _by_piece(self, f_hz, of, kind: type) -> np.ndarray:
        f = np.atleast_1d(np.asarray(f_hz, dtype=float))
        out, number = np.empty(len(f), kind), self.piece_at(f)
        for i, piece in enumerate(self.pieces):
            if np.any(number == i):
                out[number == i] = of(piece, f[number == i])
        return out

    def jumps(self) -> list[Jump]:
        """What the response does at each break."""
        found = []
        for f, below, above in zip(self.breaks_hz, self.pieces, self.pieces[1:], strict=False):
            a, b = below.response([f])[0], above.response([f])[0]
            std = np.hypot(below.response_std([f])[0], above.response_std([f])[0])
            ratio = b / a
            found.append(
                Jump(
                    f_hz=f,
                    gain_db=float(20 * np.log10(abs(ratio))),
                    phase_deg=float(np.degrees(np.angle(ratio))),
                    sigmas=float(abs(b - a) / std) if std > 0 else float("nan"),
                )
            )
        return found

    def to_dict(self) -> dict[str, Any]:
        """The set as the JSON of a model file."""
        return {
            "gsid_model": FORMAT,
            "made_by": f"gsid {version()}",
            "pieces": [piece.to_dict() for piece in self.pieces],
            "breaks_hz": list(self.breaks_hz),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any], where: str = "") -> PiecewiseModel:
        """Make a set from the JSON of a model file.

        Raises
        ------
        InputError
            Something is missing or has the wrong form.
        """
        hint = "write it again by `gsid fit --piecewise`"
        entries = data["pieces"]
        if not isinstance(entries, list) or len(entries) > PIECES_MAX:
            found = f"{len(entries)}, at most {PIECES_MAX}" if isinstance(entries, list) else "no list"
            raise InputError("the set of models is not usable: pieces", where, found, hint)
        pieces = tuple(RationalModel.from_dict(piece, where) for piece in entries)
        try:
            return cls(pieces, tuple(float(f) for f in data["breaks_hz"]))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the set of models is not usable: {error}", where, None, hint) from error

    def save(self, path: str | Path) -> None:
        """Write a model file (.json), or a MATLAB file (.mat): arrays of structs and `breaks_hz`."""
        if str(path).lower().endswith(".mat"):
            from scipy import io

            from gsid.convert import mat_values

            values = {"pieces": [mat_values(piece) for piece in self.pieces], "breaks_hz": self.breaks_hz}
            write_atomically(path, lambda part: io.savemat(part, values, appendmat=False))
        else:
            write_model_file(path, self.to_dict())

    @classmethod
    def load(cls, path: str | Path) -> PiecewiseModel:
        """Read a model file.

        Raises
        ------
        InputError
            The file cannot be read, is not JSON, or is not a set of models.
        """
        data = read_model_file(path)
        if not isinstance(data, dict) or "pieces" not in data:
            raise InputError("the model file has no pieces", str(path), None, "load_model reads other models")
        return cls.from_dict(data, str(path))

    def plot(self, frf: Frf | None = None) -> matplotlib.figure.Figure:
        """Bode diagram with the breaks, over the measured response when one is given."""
        from gsid import plots

        return plots.piecewise(self, frf)

    def table(self) -> tuple[list[str], list[list[str]]]:
        """Return the head and a row for each piece as text."""
        head = [
            "from [Hz]",
            "to [Hz]",
            "order",
            "lines",
            "cost",
            "noise alone",
            "delay [ms]",
            "sigma",
            "jump",
        ]
        rows = []
        jumps = ["", *(f"{j.gain_db:+.2g} dB, {j.phase_deg:+.2g} deg" for j in self.jumps())]
        for piece, jump in zip(self.pieces, jumps, strict=True):
            rows.append(
                [
                    *(f"{edge:.4g}" for edge in piece.band_hz),
                    f"{piece.n_poles}/{piece.n_zeros}",
                    *(
                        "-" if x is None else f"{x:.5g}"
                        for x in (piece.n_lines, piece.cost, piece.cost_expected)
                    ),
                    f"{1e3 * piece.delay_s:.4g}",
                    f"{1e3 * piece.std_delay_s:.2g}" if piece.free_delay else "given",
                    jump,
                ]
            )
        return head, rows

    def __repr__(self) -> str:
        head, rows = self.table()
        lines = ["  ".join(f"{text:>11}" for text in row) for row in [head, *rows]]
        cost = f"cost {self.cost:.5g} over {self.n_lines} lines, {self.cost_expected:.5g} expected"
        return "\n".join([f"PiecewiseModel of {len(self.pieces)} pieces, {cost}", *lines])


def fit_piecewise(
    frf: Frf,
    order: str | tuple[int, int] = "2/1",
    n_pieces: int | None = None,
    *,
    band: tuple[float, float] | None = None,
    **options: object,
) -> PiecewiseModel:
    """Cut the band into pieces and fit a model of low order in each.

    Parameters
    ----------
    frf : Frf
    order : "POLES/ZEROS" or (poles, zeros)
        Of each piece.
    n_pieces : int, optional
        Default: the number of least MDL, at most `PIECES_MAX`.
    band : (lo, hi), optional
        Lines to use [Hz].
    **options
        Passed to `gsid.fit.fit`; the method is maximum likelihood. A free delay is each piece's own. Where
        nothing states the hold, all pieces have the one of less MDL ("none" within 1).

    Returns
    -------
    PiecewiseModel

    Raises
    ------
    ValueError
        Wrong arguments; too few lines for so many pieces, or no stable model in some band.
    GsidError
        As `gsid.fit.fit`, but for a band without a stable model.
    """
    if n_pieces is not None and not 1 <= n_pieces <= PIECES_MAX:
        raise ValueError(f"n_pieces must be 1 to {PIECES_MAX}, got {n_pieces}")
    if frf.hold is None and options.get("hold") is None and options.get("domain", "s") == "s":
        return _likelier(frf, order, n_pieces, band, {**options, "method": "ml"})
    n_poles, n_zeros = parse_order(order)
    bands = _Bands(frf, (n_poles, n_zeros), band, options)
    limit = PIECES_MAX if n_pieces is None else n_pieces
    cuts = {n: bands.refined(edges) for n, edges in bands.best_cuts(limit).items()}
    wanted = cuts if n_pieces is None else {n: cuts[n] for n in (n_pieces,) if n in cuts}
    if not wanted:
        what = f"no {n_pieces or 1} adjoining bands each have lines enough and a stable model"
        raise ValueError(what) from bands.failure
    judged = {n: bands.judge(edges) for n, edges in cuts.items()}
    chosen = wanted[min(wanted, key=lambda n: judged[n].mdl)]
    pieces = tuple(bands.model(lo, hi) for lo, hi in pairwise(chosen))
    breaks = tuple(float(bands.f_hz[i - 1 : i + 1].mean()) for i in chosen[1:-1])
    return PiecewiseModel(pieces, breaks, tuple(judged[n] for n in sorted(judged)))


def _likelier(
    frf: Frf,
    order: str | tuple[int, int],
    n_pieces: int | None,
    band: tuple[float, float] | None,
    options: dict,
) -> PiecewiseModel:
    """One assumption for all pieces of a response that does not state its hold: that of least MDL."""
    options.pop("hold", None)
    found = fit_readings(
        lambda reading: fit_piecewise(frf, order, n_pieces, band=band, hold=reading, **options)
    )
    mdl = {
        reading: next(cut.mdl for cut in model.tried if cut.n_pieces == len(model.pieces))
        for reading, model in found.items()
    }
    taken = likelier({reading: 2 * value for reading, value in mdl.items()})

    def marked(piece: RationalModel) -> RationalModel:
        try:
            other = fit(frf, order, band=piece.band_hz, hold=other_reading(taken), **options)
        except (GsidError, ValueError):  # more zeros than a held input allows, no stable model
            return replace(piece, hold_assumed=True)
        return replace(piece, hold_assumed=True, other_delay_s=other.delay_s)

    return replace(found[taken], pieces=tuple(map(marked, found[taken].pieces)))


class _Bands:
    """Models of bands of lines, each fitted once; a band is lines lo .. hi - 1 of those in use."""

    def __init__(self, frf: Frf, order: tuple[int, int], band: tuple[float, float] | None, options: dict):
        self.frf, self.order, self.options = frf, order, options
        self.f_hz = frf.f_hz[in_band(frf.f_hz, band)]
        self.n_parameters = sum(order) + 1 + (options.get("delay", "free") == "free")
        self._models: dict[tuple[int, int], RationalModel | None] = {}
        self.failure: GsidError | None = None
        even = np.geomspace(self.f_hz[0], self.f_hz[-1], INTERVALS + 1)[1:-1]
        inner = np.searchsorted(self.f_hz, even)
        self.grid = [int(i) for i in np.unique([0, *inner, len(self.f_hz)])]

    def model(self, lo: int, hi: int) -> RationalModel | None:
        """The model of a band; None where it has too few lines or periods, or no stable model.

        Raises
        ------
        GsidError
            What fails for another reason, which is not the band's.
        """
        if hi - lo < self.n_parameters:  # half as many parameters as numbers
            return None
        if (lo, hi) not in self._models:
            band = (self.f_hz[lo], self.f_hz[hi - 1])
            try:
                model = fit(self.frf, self.order, band=band, quiet=True, **{**self.options, "method": "ml"})
            except GsidError as error:
                if error.code not in (lib.GSID_E_UNSTABLE, lib.GSID_E_SINGULAR):
                    raise
                self.failure, model = error, None
            # Without a cost to expect, as on two lines of two periods, it cannot be weighed against others.
            self._models[lo, hi] = None if model is None or model.cost_expected is None else model
        return self._models[lo, hi]

    def cost(self, lo: int, hi: int) -> float:
        """V of a band, freed of what the scatter of its weights adds; infinite without a model."""
        model = self.model(lo, hi)
        if model is None:
            return np.inf
        return model.cost * (hi - lo - self.n_parameters / 2) / model.cost_expected

    def total(self, edges: Sequence[int]) -> float:
        """Sum of the costs of adjoining bands."""
        return sum(self.cost(lo, hi) for lo, hi in pairwise(edges))

    def best_cuts(self, n_max: int) -> dict[int, list[int]]:
        """Edges of the cut of least cost for each number of pieces, on the grid of candidates."""
        best = {1: {hi: ([0, hi], self.cost(0, hi)) for hi in self.grid[1:]}}
        for k in range(2, n_max + 1):
            best[k] = {}
            for hi in self.grid[1:]:
                ways = [
                    ([*edges, hi], cost + self.cost(lo, hi))
                    for lo, (edges, cost) in best[k - 1].items()
                    if lo < hi and np.isfinite(cost)
                ]
                if ways:
                    best[k][hi] = min(ways, key=lambda way: way[1])
        ends = {k: ways[len(self.f_hz)] for k, ways in best.items() if len(self.f_hz) in ways}
        return {k: edges for k, (edges, cost) in ends.items() if np.isfinite(cost)}

    def refined(self, edges: list[int]) -> list[int]:
        """Each break moved to the line of least cost between its neighbours on the grid, in turn."""
        edges = list(edges)
        for i in range(1, len(edges) - 1):
            at = self.grid.index(edges[i])
            lo, hi, step = self.grid[at - 1], self.grid[at + 1], 0
            while step != 1:
                step = max((hi - lo) // (NARROWED_BY + 1), 1)
                places = {edges[i], *range(lo + step, hi, step)}
                allowed = sorted(p for p in places if edges[i - 1] < p < edges[i + 1])
                edges[i] = min(allowed, key=lambda p: self.total([edges[i - 1], p, edges[i + 1]]))
                lo, hi = edges[i] - step, edges[i] + step
        return edges

    def judge(self, edges: Sequence[int]) -> Cut:
        """Eq: ORD-3"""
        n, models = len(edges) - 1, [self.model(*pair) for pair in pairwise(edges)]
        p = n * self.n_parameters + n - 1
        return Cut(
            n_pieces=n,
            cost=float(sum(model.cost for model in models)),
            cost_expected=float(sum(model.cost_expected for model in models)),
            mdl=float(self.total(edges) + p / 2 * np.log(2 * len(self.f_hz))),
        )
