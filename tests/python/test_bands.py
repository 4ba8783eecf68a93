"""Edges of a band that are on a line: 0.3 Hz is line 3 of 0.1 Hz, though 3 * 0.1 is 0.30000000000000004."""

import numpy as np
import pytest

from gsid.base.bands import in_band, within
from gsid.comparison import compare
from gsid.models.rational import RationalModel
from gsid.records.record import Record
from gsid.response.closed_loop import closed_loop_frf
from gsid.response.estimate import frf
from gsid.response.estimate_distortion import distortion

FS_HZ, N = 1000.0, 10000
EDGES = (0.1, 0.3)


def record(lines, seed=8, amplitude=1.0):
    """Four periods of a multisine, y is u and noise; u is the column r too."""
    rng = np.random.default_rng(seed)
    sines = np.cos(2 * np.pi * np.outer(np.arange(N), lines) / N + rng.uniform(0, 6, len(lines)))
    u = np.tile((amplitude * sines).sum(axis=1), 4)
    y = u + 1e-3 * rng.standard_normal(len(u))
    return Record(u, y, FS_HZ, N, 0, name="rig", columns={"r": u})


def test_a_response_has_the_lines_at_the_edges():
    """Bug: frf(band=(0.1, 0.3)) gave lines 1 and 2, where the fit of that response took line 3 too."""
    assert frf(record([1, 2, 3, 4]), band=EDGES).line.tolist() == [1, 2, 3]


def test_a_rejected_line_at_an_edge_is_named():
    found = frf(record([1, 2, 3, 4], amplitude=np.array([1, 1, 0.2, 1])), band=EDGES, min_input=0.5)
    np.testing.assert_allclose(found.rejected_hz, [0.3])


def test_a_closed_loop_has_the_lines_at_the_edges():
    assert closed_loop_frf(record([1, 2, 3, 4]), "r", band=EDGES).line.tolist() == [1, 2, 3]


def test_windows_have_the_lines_at_the_edges():
    rng = np.random.default_rng(9)
    u = rng.standard_normal(4 * N)
    noise = Record(u, u + 0.1 * rng.standard_normal(4 * N), FS_HZ, name="noise")
    assert frf(noise, window=N, band=(0.2, 0.3)).line.tolist() == [2, 3]


def test_distortion_is_looked_for_at_the_edges():
    found = distortion([record([1, 2, 4, 5], seed) for seed in (1, 2)], band=EDGES)
    assert (found.line.tolist(), found.free_line.tolist()) == ([1, 2], [3])


def test_a_comparison_has_the_lines_at_the_edges():
    assert compare(RationalModel([1], [1]), record([1, 2, 3, 4]), band=EDGES).line.tolist() == [1, 2, 3]


@pytest.mark.parametrize("fs_hz", [1e-6, 1.0, 3e7])
def test_an_edge_is_as_near_to_a_line_at_every_rate(fs_hz):
    """Bug: 1e-9 Hz took in a slow process's neighbours, and is below the rounding of a fast one's line."""
    n = 70000
    f_hz = np.arange(n // 2) * (fs_hz / n)
    k = np.arange(1, n // 2, 7)
    for edge in (k / n * fs_hz, k * fs_hz / n):
        found = [int(np.count_nonzero(within(f_hz, (0.0, hi)))) for hi in edge[:500]]
        assert found == (k[:500] + 1).tolist()
    between = (k[-1] + 0.01) * fs_hz / n
    assert np.count_nonzero(within(f_hz, (0.0, between))) == k[-1] + 1
    between = (k[-1] - 0.01) * fs_hz / n
    assert np.count_nonzero(within(f_hz, (0.0, between))) == k[-1]


def test_one_line_and_none():
    assert within(np.array([0.1 + 0.2]), (0.1, 0.3)).tolist() == [True]
    assert within(np.array([]), (0.1, 0.3)).tolist() == []
    assert within(np.array([1.0, 2.0]), None).tolist() == [True, True]
    with pytest.raises(ValueError, match=r"no line lies in 3:4 Hz; there are lines in 1:2 Hz"):
        in_band(np.array([1.0, 2.0]), (3, 4))
