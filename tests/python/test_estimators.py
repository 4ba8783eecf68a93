"""The table of all estimators, on a response with known truth."""

import numpy as np
import pytest

from gsid import plots
from gsid.fitting.estimators import Estimators, fit_all
from gsid.fitting.rational import METHODS
from gsid.models.rational import RationalModel
from gsid.report import Report
from gsid.response.frf import Frf

SEED = 20260303
F = np.arange(1, 121) * 1.0
TRUTH = RationalModel([40.0, 900.0], [1.0, 30.0, 2000.0], 0.0042)


@pytest.fixture(scope="module")
def response() -> Frf:
    rng = np.random.default_rng(SEED)
    g = TRUTH.response(F)
    sigma = 0.01 * np.abs(g) * (1 + 4 * (F < 10))
    error = sigma / np.sqrt(2) * (rng.standard_normal(len(F)) + 1j * rng.standard_normal(len(F)))
    return Frf.from_arrays(F, g + error, sigma**2, fs_hz=3000.0)


@pytest.fixture(scope="module")
def found(response) -> Estimators:
    return fit_all(response, "2/1")


def test_every_method_has_a_row_and_ml_costs_least(found):
    assert [row.method for row in found.rows] == list(METHODS)
    for row in found.rows:
        assert not row.note, row
        assert row.cost >= found["ml"].cost * (1 - 1e-6)
        assert row.seconds > 0
    assert found.best().method == "ml"
    assert found["ml-io"].cost == pytest.approx(found["ml"].cost, rel=1e-6)
    assert found.cost_expected == pytest.approx(len(F) - 5 / 2)
    assert "ml-io" in repr(found)


def test_errors_are_those_of_numpy(found, response):
    ratio = found["nls"].model.response(F) / response.g

    def rms(x):
        return np.sqrt(np.mean(x**2))

    assert found["nls"].amplitude_db == pytest.approx(rms(20 * np.log10(abs(ratio))))
    assert found["nls"].phase_deg == pytest.approx(rms(np.angle(ratio, deg=True)))
    assert found["nls"].error_db == pytest.approx(20 * np.log10(rms(abs(ratio - 1))))


def test_errors_from_a_truth_and_in_a_band(response):
    use = F <= 60
    found = fit_all(response, "2/1", methods=["ml"], reference=TRUTH.response(F[use]), band=(1, 60))
    assert found.n_lines == 60
    assert found["ml"].error_db < -45  # the fit averages over the lines: below the 1 % of each
    with pytest.raises(ValueError, match="reference"):
        fit_all(response, "2/1", reference=TRUTH.response(F[use]))
    with pytest.raises(KeyError):
        found["nls"]


def test_an_unstable_answer_is_shown_and_noted():
    unstable = RationalModel([100.0], [1.0, -5.0], 0.001)
    g = unstable.response(F)
    found = fit_all(Frf.from_arrays(F, g, 1e-8 * abs(g) ** 2, fs_hz=3000.0), "1/0", methods=["iwls"])
    assert found["iwls"].note == "UNSTABLE"
    np.testing.assert_allclose(found["iwls"].model.poles, [5.0], rtol=1e-2)
    with pytest.raises(ValueError, match="no estimator"):
        found.best()


def test_picture_and_page(found, response, tmp_path):
    figure = plots.estimators(found, response)
    assert len(figure.axes) == 3
    page = Report("Estimators", command="none").add_estimators("All", response, found).html()
    assert "8 of 8 estimators converged" in page
    for method in METHODS:
        assert f">{method}<" in page
