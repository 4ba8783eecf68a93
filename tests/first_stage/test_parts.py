"""The realisations or thirds that are left out of a fit, one after the other."""

from types import SimpleNamespace

import numpy as np
import pytest

from gsid.diagnosis.from_records import confirm
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.missing_torque import kept_out


def test_where_a_model_error_is_left_each_line_is_in_one_third():
    """Line 1, 4, 7 and so on, with real and imaginary part."""
    record = SimpleNamespace(line=np.arange(1, 8))
    rows = np.arange(14.0)
    problem = SimpleNamespace(records=[record], has_model_error=True)
    parts = kept_out._parts(problem, rows, rows[:, None])
    assert [list(error) for _, error in parts] == [
        [0, 3, 6, 7, 10, 13],
        [1, 4, 8, 11],
        [2, 5, 9, 12],
    ]
    assert all(np.array_equal(jacobian[:, 0], error) for jacobian, error in parts)


@pytest.mark.parametrize("more", [-1, 0])
def test_thirds_are_of_the_periods_if_there_are_enough(more):
    """The mean of a third of the periods has three times the variance: its weight is the root of 1 / 3."""
    n_periods = DEFAULTS.periods_least + more
    periods = np.arange(n_periods, dtype=complex)[:, None] * np.ones(3)
    spectra = SimpleNamespace(n_periods=n_periods, Y=periods, y=periods.mean(axis=0))
    record = SimpleNamespace(
        spectra=spectra,
        line=np.arange(1, 4),
        jacobian=np.ones((6, 1)),
        residual=np.zeros(6),
        whitened=lambda change: np.concatenate([change.real, change.imag]),
    )
    parts = confirm._parts(SimpleNamespace(records=[record]), DEFAULTS, None)
    assert len(parts) == 3
    assert [len(residual) for _, residual in parts] == [6 if more == 0 else 2] * 3
    if more == 0:
        first = np.array_split(np.arange(n_periods), 3)[0]
        weight = np.sqrt(len(first) / n_periods)
        assert parts[0][1][0] == pytest.approx(weight * (first.mean() - (n_periods - 1) / 2))
