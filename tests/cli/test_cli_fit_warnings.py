"""`gsid fit` reports a fit that noise biases, on stderr, beside the intervals and in the JSON."""

import json

import numpy as np
import pytest
from known_system import FS_HZ, LINES, N_PERIOD, response

from gsid.records.files import write_record
from gsid.records.record import Record


@pytest.fixture
def noisy_csv(tmp_path):
    rng = np.random.default_rng(11)
    lines = np.zeros(N_PERIOD // 2 + 1, complex)
    lines[LINES] = np.exp(2j * np.pi * rng.uniform(size=len(LINES)))
    u = np.fft.irfft(lines)
    y = np.fft.irfft(lines * response(np.arange(len(lines)) * FS_HZ / N_PERIOD))
    noise = 0.2 * np.std(y) * rng.standard_normal(8 * N_PERIOD)
    record = Record(np.tile(u, 8), np.tile(y, 8) + noise, FS_HZ, N_PERIOD, 0, hold="none")
    write_record(tmp_path / "noisy.csv", record)
    return "noisy.csv"


def test_a_biased_fit_is_reported_and_the_right_one_is_not(gsid, noisy_csv):
    fit = ("fit", noisy_csv, "--order", "2/0", "--method")
    biased = gsid(*fit, "ls")
    assert biased.code == 0
    assert biased.err.count("equation error biases this ls fit by up to") == 1
    assert "intervals leave out a bias of up to" in biased.out
    (warning,) = json.loads(gsid(*fit, "ls", "--json").out)["warnings"]
    assert warning["what"] == "equation_error_bias"
    assert warning["use"] == "ml"
    assert warning["bias_over_std"] > 0.5
    right = gsid(*fit, "ml", "--json")
    assert json.loads(right.out)["warnings"] == []
    assert "biases this" not in right.err


def test_the_table_of_estimators_is_silent_but_for_its_remarks(gsid, noisy_csv):
    result = gsid("fit", noisy_csv, "--order", "2/0", "--method", "all")
    assert "biases this" not in result.err
    assert "use ml" in result.out


def test_bug_a_fit_far_above_the_noise_was_printed_as_converged_without_a_word(gsid, noisy_csv):
    result = gsid("fit", noisy_csv, "--order", "1/0")
    assert result.code == 0
    assert result.err.count("times the squared errors that noise explains") == 1
    for words in ("the order is too low", "a local minimum", "try a higher order", "--delay SECONDS"):
        assert words in " ".join(result.err.split())
    assert "intervals include the errors left, beside those of noise only: cost" in result.out
    (warning,) = json.loads(gsid("fit", noisy_csv, "--order", "1/0", "--json").out)["warnings"]
    assert warning["what"] == "excess_cost"
    assert warning["bias_over_std"] is None
    assert warning["cost_per_dof"] > 2
    assert warning["p_value"] < 0.001
    assert warning["use"] == "another order, start or delay"
    assert "noise explains" in warning["text"]


def test_bug_a_root_without_a_variance_was_known_exactly(gsid, noisy_csv, monkeypatch):
    """+-0 beside zeros whose coefficients were all undetermined, as of swapped input and output."""
    from gsid.models.rational import RationalModel

    none = property(lambda model: np.zeros((len(model.poles), 2, 2)))
    monkeypatch.setattr(RationalModel, "pole_cov", none)
    result = gsid("fit", noisy_csv, "--order", "2/0")
    (row,) = (line for line in result.out.splitlines() if line.startswith("pole"))
    assert row.count("undetermined") == 2
    assert "+-0 " not in row
