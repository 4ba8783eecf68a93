"""Pictures of a report: their selection, their captions, and their inline SVG."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
from markupsafe import Markup, escape

from gsid import plots
from gsid.diagnosis.ladder import ladder
from gsid.excitation.limits import travel_unit
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gsid.response.frf import Frf
    from gsid.spectrum.spectra import Spectra


@dataclass(frozen=True)
class Picture:
    """A drawing of the page, with title and caption."""

    title: str
    caption: str  # how to read it, one sentence
    svg: Markup


CAPTIONS = {
    "Estimators": "If only noise remains, the errors stay below the bound. Linear least squares is "
    "inaccurate at low frequencies. Maximum likelihood has its largest errors where the noise is largest.",
    "Excitation": "One period in time and its lines. A crest factor near 1.4 gives the most power within a "
    "limited command. With a model, the predicted travel is shown too. With several records, this is the one "
    "with the largest input.",
    "Noise": "The part of the output that does not repeat with the period: its spectral density, and "
    "periodic disturbances such as a fan.",
    "Periods": "Settled periods repeat, and their differences from the mean are noise. The transient must "
    "decay to this level before the first period used.",
    "Frequency response": "The response and, in the same dB, the standard deviation of its noise: the "
    "distance between the two is the signal-to-noise ratio of each line.",
    "Measured and fitted": "A correct model passes through the measured points. Bars and band are 95 % "
    "intervals, point by point.",
    "Complex residual": "The distance between measurement and model in the complex plane. If only noise "
    "remains, 5 % of the points lie above the bound, spread evenly.",
    "Poles and zeros": "Dotted rays are equal damping, circles equal frequency; each close-up shows the "
    "region in which the root lies with 95 % confidence.",
    "Error before an effect is added": "The error after a fit of the free parameters, against the noise, for "
    "excited lines and for other lines.",
    "Missing torque": "The error of the output, converted to torque by the inverse of the model and averaged "
    "over samples of similar rate, angle, command or time. Positive torque drives forwards. A curve that "
    "leaves its band of ±2 σ indicates the form of the missing law.",
    "With the effects found": "Same plot after adding the effects found. If they are right, only noise "
    "remains.",
    "Ladder": "Each step is fitted to some of the data and validated on the rest. A true effect reduces the "
    "error on the validation data to the noise; a wrong effect does not reduce it. If the search used the "
    "validation data too, the error on new data may be larger.",
    "Comparison at the output": "The error of the model against the noise. An excess at lines that were not "
    "excited can only be nonlinear; at excited lines it is nonlinear or due to a missing linear effect.",
    "Noise and distortion": "Top: the response with its uncertainty from noise alone, which averaging "
    "reduces, and from noise and distortion together. Bottom: the output at excited and at other lines.",
}


def pictures_of(
    record, all_spectra, frf, model, comparison, multisine, *, noise=None, limits=None
) -> list[tuple[str, Callable[[], Figure]]]:
    """Title and drawing of each picture for which there are data, in the order of the page."""
    spectra = all_spectra[0] if all_spectra else None
    u_unit = next((s.u_unit for s in (frf, spectra) if s is not None), "")
    has_fit = frf is not None and model is not None and not isinstance(model, PlantModel)
    of_plant = _plant_pictures(model, all_spectra, frf) if isinstance(model, PlantModel) else []
    has_roots = isinstance(model, RationalModel) and len(model.poles) + len(model.zeros) > 0

    strongest = max(all_spectra, key=lambda s: np.linalg.norm(s.u)) if all_spectra else None

    def excite() -> Figure:
        turns = isinstance(model, RationalModel | PlantModel) and travel_unit(model) in ("deg", "m")
        return plots.excitation(multisine or strongest, u_unit, model=model if turns else None, limits=limits)

    pictures = [
        ("Excitation", multisine or strongest, excite),
        ("Periods", record and spectra, lambda: plots.periods(record, spectra)),
        ("Noise", noise, lambda: plots.noise(noise)),
        ("Frequency response", frf, lambda: plots.frf(frf)),
        ("Measured and fitted", has_fit, lambda: model.plot(frf)),
        ("Complex residual", has_fit, lambda: plots.residual(model, frf)),
        *((title, True, draw) for title, draw in of_plant),
        ("Poles and zeros", has_roots, lambda: plots.pole_zero(model)),
        ("Comparison at the output", comparison, lambda: plots.comparison(comparison)),
    ]
    return [(title, draw) for title, needed, draw in pictures if needed]


def _plant_pictures(
    model: PlantModel, measured: Sequence[Spectra], frf: Frf | None
) -> list[tuple[str, Callable[[], Figure]]]:
    pictures = []
    if frf is not None and measured:
        g = np.mean([model.predict(s).Y[frf.line] / s.u[frf.line] for s in measured], axis=0)
        pictures.append(("Measured and fitted", lambda: plots.bode_of_plant(frf, g)))
        pictures.append(("Complex residual", lambda: plots.residual_of_plant(frf, g)))
    steps = ladder(model)
    if steps.rungs:
        pictures.append(("Ladder", lambda: plots.ladder(steps)))
    return pictures


_LONG_NUMBER = re.compile(r"(\d\.\d\d)\d+")  # a hundredth of a point is below any printer's resolution


def inline_svg(figure: Figure, prefix: str, title: str) -> Markup:
    """SVG element for an HTML page: no prologue, no fixed size, and ids that are unique on the page."""
    text = io.StringIO()
    with matplotlib.rc_context(plots.STYLE):
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{prefix}", svg)
    svg = re.sub(r'\b(?:d|x|y)="[^"]*"', lambda found: _LONG_NUMBER.sub(r"\1", found[0]), svg)
    svg = re.sub(r'(<svg\b[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg\b[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    return Markup(
        svg.replace("<svg", f'<svg role="img" aria-label="{escape(title)}. {escape(CAPTIONS[title])}"', 1)
    )
