"""Piecewise models: one low-order model per band, with breaks between the bands (thesis, section 8.3).

Some responses, such as that of an axis with friction, need a very high order if one model describes them. A
piecewise model divides the band into adjoining bands with a low-order model in each. The breaks are optimised
together. For each number of pieces, dynamic programming over a grid of candidates finds the least sum of the
costs of eq. 7.28. The breaks are then refined line by line. The number of pieces N has the least MDL,

    sum of V + (N p + N - 1)/2 ln(2 F)  (ORD-3)

A piecewise model has a frequency response, but no time response. It is not continuous at its breaks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gsid._lib import version
from gsid.base.errors import InputError
from gsid.base.files import write_atomically
from gsid.base.model_file import FORMAT, read_model_file, write_model_file
from gsid.base.plottable import Plottable
from gsid.base.tables import Table
from gsid.models.rational import RationalModel

if TYPE_CHECKING:
    import matplotlib.figure

    from gsid.response.frf import Frf

PIECES_MAX = 6


@dataclass(frozen=True)
class Jump:
    """Change of the response at a break, from the lower to the upper piece.

    Attributes
    ----------
    f_hz : float
        Frequency of the break [Hz].
    gain_db, phase_deg : float
        Change of gain [dB] and phase [deg].
    sigmas : float
        Size of the jump over its standard deviation.
    """

    f_hz: float
    gain_db: float
    phase_deg: float
    sigmas: float


@dataclass(frozen=True)
class Cut:
    """Best division for one number of pieces.

    Attributes
    ----------
    n_pieces : int
    cost, cost_expected : float
        Sums over the pieces of V and of its value expected from noise alone.
    mdl : float
        ORD-3.
    """

    n_pieces: int
    cost: float
    cost_expected: float
    mdl: float


@dataclass(frozen=True, repr=False)
class PiecewiseModel(Plottable):
    """Models of low order in adjoining bands.

    Attributes
    ----------
    pieces : tuple of RationalModel
        Pieces in order of frequency; `band_hz` of each is the band of its fit.
    breaks_hz : tuple of float
        Breaks between the pieces [Hz]. The upper piece applies from its break on.
    tried : tuple of Cut
        Results for each number of pieces tried; empty for a set read from a file.

    Raises
    ------
    ValueError
        The breaks do not ascend, their number is not one less than that of the pieces, or a piece was not
        fitted.
    """

    pieces: tuple[RationalModel, ...]
    breaks_hz: tuple[float, ...]
    tried: tuple[Cut, ...] = ()

    def __post_init__(self) -> None:
        if len(self.breaks_hz) != len(self.pieces) - 1 or np.any(np.diff(self.breaks_hz) <= 0):
            raise ValueError(f"{len(self.pieces)} pieces need {len(self.pieces) - 1} ascending breaks")
        if not self.pieces or any(piece.band_hz is None for piece in self.pieces):
            raise ValueError("every piece needs the band of its fit")

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest line fitted [Hz]."""
        return (self.pieces[0].band_hz[0], self.pieces[-1].band_hz[1])

    @property
    def fs_hz(self) -> float | None:
        """Sample rate of a held input [Hz]; None for a model of an input that is not held."""
        return self.pieces[0].fs_hz

    @property
    def n_parameters(self) -> int:
        """Number of parameters of all pieces, without the breaks."""
        return sum(piece.n_parameters for piece in self.pieces)

    @property
    def n_lines(self) -> int:
        """Number of lines of all pieces."""
        return sum(piece.n_lines or 0 for piece in self.pieces)

    @property
    def cost(self) -> float:
        """Sum of V of eq. 7.28 over the pieces."""
        return float(sum(piece.cost or 0 for piece in self.pieces))

    @property
    def cost_expected(self) -> float:
        """Cost expected from noise alone."""
        return float(sum(piece.cost_expected or 0 for piece in self.pieces))

    @property
    def stable(self) -> bool:
        """Whether all pieces are stable."""
        return all(piece.stable for piece in self.pieces)

    @property
    def converged(self) -> bool:
        """Whether the fits of all pieces have converged."""
        return all(bool(piece.converged) for piece in self.pieces)

    @property
    def u_unit(self) -> str:
        """Unit of the input."""
        return self.pieces[0].u_unit

    @property
    def y_unit(self) -> str:
        """Unit of the output."""
        return self.pieces[0].y_unit

    def piece_at(self, f_hz: np.ndarray | float) -> np.ndarray:
        """Index of the piece that applies at each frequency [Hz], from 0."""
        return np.searchsorted(self.breaks_hz, f_hz, side="right")

    def response(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """Response at each frequency, of the piece that applies there. The outer pieces are extrapolated.

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
        """Standard deviation of the complex response, (k,), from the covariance of the piece."""
        return self._by_piece(f_hz, RationalModel.response_std, float)

    def deviations(self, f_hz: np.ndarray | list[float]) -> np.ndarray:
        """As `RationalModel.deviations`, (k, r) complex, with the directions of all pieces."""
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
        """Changes of the response at the breaks."""
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

            from gsid.models.convert import mat_values

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
        """Bode diagram with the breaks, over the measured response if one is given."""
        return self._figure(frf)

    def table(self) -> Table:
        """Return a row for each piece."""
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
        return Table(head, rows, left=["jump"])

    def __repr__(self) -> str:
        return f"{self._title()}\n{self.table().text()}"

    def _repr_html_(self) -> str:
        return replace(self.table(), title=self._title()).html()

    def _title(self) -> str:
        cost = f"cost {self.cost:.5g} over {self.n_lines} lines, {self.cost_expected:.5g} expected"
        return f"PiecewiseModel of {len(self.pieces)} pieces, {cost}"
