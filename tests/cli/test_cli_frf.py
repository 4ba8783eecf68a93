"""gsid frf beyond settled periods: short records with their transient."""

import json

import numpy as np
import pytest
from scipy.signal import freqz, lfilter

from gsid.excitation import Multisine
from gsid.io import write_record
from gsid.record import Record

FS_HZ, N = 1000.0, 1000
B, A = [0, 0.5], [1, -0.95]


@pytest.fixture
def short_csv(tmp_path):
    """One period of a slow axis from rest."""
    m = Multisine.design(FS_HZ, N, (1, 100), phases="random", seed=1)
    y = lfilter(B, A, m.table()) + 0.01 * np.random.default_rng(1).standard_normal(N)
    write_record(tmp_path / "short.csv", Record(m.table(), y, FS_HZ))
    return "short.csv"


def test_one_period_from_rest(gsid, short_csv):
    result = gsid("frf", short_csv, "--lpm", "--period", N, "--json")
    assert result.code == 0
    values = json.loads(result.out)
    assert (values["method"], values["n_dof"], values["n_periods"]) == ("lpm", 9, 1)
    g = np.array(values["g_re"]) + 1j * np.array(values["g_im"])
    error = np.abs(g - freqz(B, A, values["f_hz"], fs=FS_HZ)[1])
    assert np.mean(error**2 / np.array(values["var_g"])) == pytest.approx(9 / 8, abs=0.5)
    without = gsid("frf", short_csv, "--period", N)
    assert without.code == 3
    assert "less than two good periods" in without.err
    said = gsid("frf", short_csv, "--lpm", "--period", N).err
    assert "1 period of 1000 samples" in said
    assert "transient by local polynomials (9 degrees of freedom)" in said
