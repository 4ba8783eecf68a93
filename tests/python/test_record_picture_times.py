"""The time axes of the picture of a record."""

import numpy as np

import gsid
from gsid.plots.record import records
from gsid.records.record import Record


def test_bug_the_position_made_the_time_begin_before_the_record():
    t = np.arange(800) / 100
    u = np.sin(2 * np.pi * t) + np.sin(4 * np.pi * t)
    y = u + 0.01 * np.random.default_rng(5).normal(size=len(u))
    record = Record(u, y, 100.0, 100, 0, y_unit="deg/s")
    figure = records([(record, gsid.spectra(record))])
    signals = figure.axes[:3]  # input, output, position
    assert "position" in signals[2].get_ylabel()
    for ax in signals:
        np.testing.assert_allclose(ax.get_xlim(), (0, t[-1]))
