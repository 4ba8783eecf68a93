"""Is the model adequate, and where is it not? Measured mean spectra against the model's, line by line.

At each line the model's output error of every period is E[p] = Y[p] - G U[p]; for a plant, whose answer is
not a product, Y[p] less its periodic answer to the mean input, so that its scatter is that of Y alone. When
the model is right and the noise is Gaussian, T = P |mean E|^2 / s^2, s^2 the sample variance of E over the P
periods, follows F(2, 2 nu), nu = P - 1, exactly: P(T > t) = (1 + t/nu)^-nu. (A wandering output scatters more
from period to period than its mean; where the input repeats, s^2 is taken from what lies between the lines:
`gsid.spectra.variance_between_lines`.) So q = nu ln(1 + T/nu) is
exponential with mean 1 for any P >= 2, and twice the sum of q over n lines is chi-square with 2 n degrees of
freedom (CMP-1). The line at 0, which counts for plants when the band begins there, is real: T follows
F(1, nu), and q = -ln P(T > t). The test therefore keeps its false-alarm rate with few periods, where one that
takes s^2 for the true variance would not. Each parameter fitted to these very records takes a degree of
freedom, which only the caller can know (`fitted`). The uncertainty of a model fitted elsewhere is left out:
it is judged a little severely.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from gsid._callable import callable_as
from gsid.bands import in_band
from gsid.plant import PlantModel
from gsid.sampling import at_rate_of
from gsid.spectra import Spectra, spectra_of
from gsid.units import check_units
from gsid.weights import UNSETTLED, lines_used

if TYPE_CHECKING:
    import matplotlib.figure

    from gsid.model import RationalModel
    from gsid.piecewise import PiecewiseModel
    from gsid.record import Record

_log = logging.getLogger(__name__)

KINDS = ("excited", "odd", "even")

# Neighbouring bands are shown as one when their mean excess per line differs by no more than this factor.
ALIKE = 10.0


@dataclass(eq=False, repr=False)
class Comparison:
    """What :func:`compare` found.

    Parameters
    ----------
    adequate : bool
        The test of the whole band does not reject at level `alpha`.
    p_value : float
        Probability of a misfit this large or larger when the model is right.
    alpha : float
        False-alarm rate of the test.
    cost_per_dof : float
        Mean of T over its mean when only noise is left: 1 for a right model.
    rms_error, noise_floor_rms : float
        Rms of the mean output's error in the band and what noise alone leaves of it, in the output's unit.
    where : list of dict
        Bands in which the model fails, largest share of the excess first: f_lo_hz, f_hi_hz, lines
        ("excited", "odd", "even"), share (of the excess cost), p_value (within the band, corrected for the
        number of bands), db (error over response of the whole band).
    line, f_hz, kind : (k,) ndarrays
        Line number, Hz, and what the line is: "excited", or a detection line, "odd" or "even".
    error, y : (k,) complex ndarrays
        Mean output minus model output, and mean output; of several records, of that which moves most.
    sigma : (k,) ndarray
        Standard deviation of that error when the model is right.
    n_dof : int
        Degrees of freedom of sigma^2: good periods of that record less one.
    cost : (k,) ndarray
        T averaged over the records.
    n_periods, n_records : int
        Good periods in all, and records.
    """

    adequate: bool
    p_value: float
    alpha: float
    cost_per_dof: float
    rms_error: float
    noise_floor_rms: float
    where: list[dict[str, Any]]
    line: np.ndarray
    f_hz: np.ndarray
    kind: np.ndarray
    error: np.ndarray
    y: np.ndarray
    sigma: np.ndarray
    n_dof: int
    cost: np.ndarray
    n_periods: int
    n_records: int
    y_unit: str = ""
    names: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        """One sentence for people."""
        floor = f"{self.noise_floor_rms:.3g} {self.y_unit}".rstrip()
        size = f"rms error {self.rms_error:.3g} where noise alone leaves {floor}"
        if self.adequate:
            rate = f"p = {self.p_value:.2g} at a false-alarm rate of {self.alpha:g}"
            return f"Adequate: what is left is noise ({size}; {rate})."
        if not self.where:
            return (
                f"Not adequate: {size}; the excess is spread thinly over the band (p = {self.p_value:.2g})."
            )
        worst = self.where[0]
        lines = "excited lines" if worst["lines"] == "excited" else f"{worst['lines']} detection lines"
        band = f"{worst['f_lo_hz']:.3g} to {worst['f_hi_hz']:.3g} Hz"
        share = f"{100 * worst['share']:.0f} % of the excess lies at {band} on {lines}"
        return f"Not adequate: {size}; {share} (cost {self.cost_per_dof:.3g} times that of noise)."

    def to_dict(self) -> dict[str, Any]:
        """The numbers of `gsid compare --json`."""
        keys = (
            "adequate",
            "p_value",
            "alpha",
            "cost_per_dof",
            "rms_error",
            "noise_floor_rms",
            "where",
            "n_periods",
        )
        return {key: getattr(self, key) for key in keys} | {"n_realisations": self.n_records}

    def plot(self) -> matplotlib.figure.Figure:
        """Error at the output against noise, with the bands where the model fails."""
        from gsid import plots

        return plots.comparison(self)

    def __repr__(self) -> str:
        lines = [self.verdict]
        for band in self.where:
            lines.append(
                f"  {band['f_lo_hz']:8.4g} to {band['f_hi_hz']:8.4g} Hz  {band['lines']:8}  "
                f"{100 * band['share']:5.1f} % of the excess  {band['db']:6.1f} dB of the response"
            )
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        import html

        rows = "".join(
            f"<tr><td>{band['f_lo_hz']:.4g} to {band['f_hi_hz']:.4g}</td><td>{band['lines']}</td>"
            f"<td>{100 * band['share']:.1f}</td><td>{band['db']:.1f}</td></tr>"
            for band in self.where
        )
        titles = ("band [Hz]", "lines", "share of excess [%]", "error / response [dB]")
        head = "<tr>" + "".join(f"<th>{title}</th>" for title in titles) + "</tr>"
        table = f"<table>{head}{rows}</table>" if rows else ""
        return f"<p>{html.escape(self.verdict)}</p>{table}"


@dataclass
class _Lines:
    """One record's lines in the band."""

    line: np.ndarray
    f_hz: np.ndarray
    kind: np.ndarray
    error: np.ndarray
    y: np.ndarray
    var_mean: np.ndarray  # of the mean error
    dof: int

    @property
    def t(self) -> np.ndarray:
        return np.abs(self.error) ** 2 / np.maximum(self.var_mean, np.finfo(float).tiny)

    @property
    def q(self) -> np.ndarray:
        q = self.dof * np.log1p(self.t / self.dof)
        real = self.line == 0
        if np.any(real):
            q[real] = -np.log(np.maximum(stats.f.sf(self.t[real], 1, self.dof), np.finfo(float).tiny))
        return q

    @property
    def power(self) -> np.ndarray:
        """Factor from a line's |amplitude|^2 to its share of the mean square."""
        return np.where(self.line == 0, 1.0, 0.5)


def compare(
    model: RationalModel | PiecewiseModel | PlantModel,
    records: Record | Spectra | Sequence[Record | Spectra],
    *,
    period: int | None = None,
    settle: int | None = None,
    band: tuple[float, float] | None = None,
    alpha: float = 0.05,
    fitted: bool = False,
) -> Comparison:
    """Test a model against measurements and show where it fails (CMP-1, CMP-2).

    Parameters
    ----------
    model : RationalModel, PiecewiseModel or PlantModel
    records : Record or Spectra, or a sequence of them
        One or more realisations, each with at least two good periods.
    period, settle : int, optional
        Samples in a period and samples thrown away first; default what the record says or shows.
    band : (lo, hi), optional
        Hz; default from the first to the last excited line, for a plant as in `gsid.greybox.fit_plant`.
    alpha : float
        False-alarm rate of the test.
    fitted : bool
        Whether the free parameters were fitted to these very records in this band. The test of the whole band
        allows for them; where the misfit is, is still told mildly.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError
        No line in the band, or alpha not between 0 and 1.
    TypeError
        No model, or no record.
    InputError
        A record has less than two good periods, or no period, or its units are not the model's, or a
        model in z has another sample rate.
    GsidError
        The plant cannot be simulated.
    """
    if not 0 < alpha < 1:
        raise ValueError(f"alpha must be between 0 and 1, got {alpha}")
    measured = spectra_of(records, period=period, settle=settle)
    if not isinstance(model, PlantModel) and not hasattr(model, "response"):
        raise TypeError(f"a model is needed, as load_model reads it, got {type(model).__name__}")
    parts = [_lines(model, s, band) for s in measured]

    n = sum(len(part.line) for part in parts)
    q_sum = sum(float(np.sum(part.q)) for part in parts)
    left = max(2 * n - (_n_parameters(model) if fitted else 0), 1)
    p_value = float(stats.chi2.sf(2 * q_sum, left))
    shown = max(parts, key=lambda part: float(np.sum(np.abs(part.y) ** 2)))
    return Comparison(
        adequate=p_value >= alpha,
        p_value=p_value,
        alpha=alpha,
        cost_per_dof=_cost_per_dof(parts) * 2 * n / left,
        rms_error=float(np.sqrt(np.mean([np.sum(part.power * np.abs(part.error) ** 2) for part in parts]))),
        noise_floor_rms=float(np.sqrt(np.mean([np.sum(part.power * part.var_mean) for part in parts]))),
        where=_where(parts, alpha),
        line=shown.line,
        f_hz=shown.f_hz,
        kind=shown.kind,
        error=shown.error,
        y=shown.y,
        sigma=np.sqrt(shown.var_mean),
        n_dof=shown.dof,
        cost=np.mean([part.t for part in parts], axis=0) if _same_lines(parts) else shown.t,
        n_periods=sum(s.n_periods for s in measured),
        n_records=len(parts),
        y_unit=measured[0].y_unit,
        names=[s.name for s in measured],
    )


def _n_parameters(model: RationalModel | PiecewiseModel | PlantModel) -> int:
    return len(model.free_names) if isinstance(model, PlantModel) else model.n_parameters


def _same_lines(parts: list[_Lines]) -> bool:
    return all(np.array_equal(part.line, parts[0].line) for part in parts)


def _lines(
    model: RationalModel | PiecewiseModel | PlantModel, s: Spectra, band: tuple[float, float] | None
) -> _Lines:
    check_units(model, s)
    if isinstance(model, PlantModel):
        use = lines_used(model, s, band)
    else:
        model = at_rate_of(model, s)
        f_excited = s.f_hz[s.excited]
        inside = (s.line > 0) & (2 * s.line < s.period_samples)
        use = inside.copy()
        use[inside] = in_band(s.f_hz[inside], band if band is not None else (f_excited[0], f_excited[-1]))
    known_input = isinstance(model, PlantModel) or not np.any(s.U - s.U[0])
    errors = s.Y[:, use] - _answer(model, s, use)
    kind = np.where(s.excited[use], "excited", np.where(s.line[use] % 2 == 1, "odd", "even"))
    return _Lines(
        line=s.line[use],
        f_hz=s.f_hz[use],
        kind=kind,
        error=errors.mean(axis=0),
        y=s.Y[:, use].mean(axis=0),
        var_mean=(s.noise_y[use] if known_input else np.var(errors, axis=0, ddof=1)) / s.n_periods,
        dof=s.n_periods - 1,
    )


def _answer(model: RationalModel | PiecewiseModel | PlantModel, s: Spectra, use: np.ndarray) -> np.ndarray:
    """The model's output lines, of every period or of all alike."""
    if isinstance(model, PlantModel):
        answer = model.predict(s)
        noise_rms = np.sqrt(np.sum(s.var_y[use]) / (2 * s.n_periods))
        if not answer.settled and answer.residual > UNSETTLED * noise_rms:
            _log.warning("no steady state was found for %s: the comparison is not to be trusted", s.name)
        return answer.Y[use]
    return model.response(s.f_hz[use]) * s.U[:, use]


def _cost_per_dof(parts: list[_Lines]) -> float:
    """Mean of T over its expectation nu / (nu - 1). It has none with nu = 1: all variances stand in."""
    total = 0.0
    for part in parts:
        if part.dof > 1:
            total += float(np.mean(part.t)) * (part.dof - 1) / part.dof
        else:
            total += float(np.sum(np.abs(part.error) ** 2) / max(np.sum(part.var_mean), np.finfo(float).tiny))
    return total / len(parts)


def _third_octaves(f_lo: float, f_hi: float) -> np.ndarray:
    """Edges of third-octave bands that cover f_lo to f_hi."""
    n = int(np.ceil(3 * np.log2(f_hi / f_lo) + 1e-9))
    return f_lo * 2 ** (np.arange(n + 2) / 3) * 2 ** (-1 / 6)


def _where(parts: list[_Lines], alpha: float) -> list[dict[str, Any]]:
    """Third-octave bands, of each kind of line, that fail at level alpha all together (Holm)."""
    join = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("f_hz", "kind", "q", "error", "y")
    }
    excess = np.concatenate([part.t - (part.dof / (part.dof - 1) if part.dof > 1 else 1.0) for part in parts])
    edges = _third_octaves(join["f_hz"][join["f_hz"] > 0].min(), join["f_hz"].max())
    edges = np.insert(edges, 0, 0.0)  # the line at 0, where it counts, is a band of its own
    cells = []
    for kind in KINDS:
        for lo, hi in itertools.pairwise(edges):
            cell = (join["kind"] == kind) & (join["f_hz"] >= lo) & (join["f_hz"] < hi)
            if np.any(cell):
                p = float(stats.chi2.sf(2 * np.sum(join["q"][cell]), 2 * np.sum(cell)))
                density = max(float(np.mean(excess[cell])), np.finfo(float).tiny)
                cells.append({"kind": kind, "index": len(cells), "lines": cell, "p": p, "density": density})
    failing = _holm(cells, alpha)
    total = float(sum(max(np.sum(excess[cell["lines"]]), 0.0) for cell in cells))
    bands = [_band(group, join, excess, total) for group in _joined(failing)]
    return sorted(bands, key=lambda band: -band["share"])


def _holm(cells: list[dict[str, Any]], alpha: float) -> list[dict[str, Any]]:
    """Cells rejected by Holm's step-down procedure, each with its corrected p; in the order given."""
    corrected = 0.0
    for rank, cell in enumerate(sorted(cells, key=lambda cell: cell["p"])):
        corrected = max(corrected, min(1.0, cell["p"] * (len(cells) - rank)))
        cell["p_corrected"] = corrected
    return [cell for cell in cells if cell["p_corrected"] < alpha]


def _joined(cells: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Neighbouring cells of one kind that fail about equally badly, as one group."""
    groups: list[list[dict[str, Any]]] = []
    for cell in cells:
        group = groups[-1] if groups else None
        if group and group[-1]["kind"] == cell["kind"] and group[-1]["index"] + 1 == cell["index"]:
            densities = [member["density"] for member in group] + [cell["density"]]
            if max(densities) <= ALIKE * min(densities):
                group.append(cell)
                continue
        groups.append([cell])
    return groups


def _band(
    group: list[dict[str, Any]], join: dict[str, np.ndarray], excess: np.ndarray, total: float
) -> dict[str, Any]:
    lines = np.any([cell["lines"] for cell in group], axis=0)
    f = join["f_hz"][lines]
    nearby = (join["f_hz"] >= f.min()) & (join["f_hz"] <= f.max())
    response = float(np.sum(np.abs(join["y"][nearby]) ** 2))
    error = float(np.sum(np.abs(join["error"][lines]) ** 2))
    return {
        "f_lo_hz": float(f.min()),
        "f_hi_hz": float(f.max()),
        "lines": group[0]["kind"],
        "share": float(np.sum(excess[lines])) / total if total > 0 else 0.0,
        "p_value": min(cell["p_corrected"] for cell in group),
        "db": 10 * float(np.log10(max(error, 1e-300) / max(response, 1e-300))),
    }


callable_as(compare)
