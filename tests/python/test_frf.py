"""Spectra and frequency responses, against numpy written out and against the truth of made-up records."""

from dataclasses import replace

import numpy as np
import pytest

from gsid.base.errors import GsidError, InputError
from gsid.excitation.multisine import Multisine
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.response.frf import Frf, error_variance, merged, response_of
from gsid.response.streaming import StreamingFrf
from gsid.spectrum.excited import excited_lines
from gsid.spectrum.realisation import spectra
from gsid.spectrum.tones import Tone
from measured import BENCH, needs_bench

FS_HZ, N, PERIODS = 1000.0, 500, 12


def true_response(f_hz):
    s = 2j * np.pi * f_hz
    return 30 * np.exp(-0.003 * s) / (s + 20)


def make_record(
    seed, *, settle=0, noise_u=0.0, noise_y=0.01, phases="random", valid=None, name="made", **keys
):
    """A record in steady state with white noise on output and input."""
    rng = np.random.default_rng(seed)
    m = Multisine.design(FS_HZ, N, (2, 100), phases=phases, seed=seed)
    lines = np.zeros(N // 2 + 1, complex)
    lines[m.line] = m.spectrum() * true_response(m.f_hz) * (N / 2)
    n = settle + PERIODS * N
    u = np.resize(m.table(), n) + noise_u * rng.standard_normal(n)
    y = np.resize(np.fft.irfft(lines, N), n) + noise_y * rng.standard_normal(n)
    return Record(u, y, FS_HZ, N, settle, valid, name=name, **keys)


def by_numpy(record, settle, line, rows=slice(None)):
    """Mean response and its variance (eq. 7.29 over P), written out with numpy's FFT."""
    N = record.period_samples
    n_periods = (len(record) - settle) // N
    U, Y = (
        np.fft.rfft(x[settle : settle + n_periods * N].reshape(n_periods, N)[rows])[:, line] * 2 / N
        for x in (record.u, record.y)
    )
    P = len(U)
    u, y = U.mean(axis=0), Y.mean(axis=0)
    var_u = (np.abs(U - u) ** 2).sum(axis=0) / (P - 1)
    var_y = (np.abs(Y - y) ** 2).sum(axis=0) / (P - 1)
    cov_yu = ((Y - y) * (U - u).conj()).sum(axis=0) / (P - 1)
    g = y / u
    var_g = np.abs(g) ** 2 * (
        var_y / np.abs(y) ** 2 + var_u / np.abs(u) ** 2 - 2 * np.real(cov_yu / (y * u.conj()))
    )
    return g, var_g / P


@needs_bench
@pytest.mark.parametrize("letter", ["A", "B"])
def test_motor_bench_agrees_with_a_plain_fft_at_every_line(letter):
    data = np.load(BENCH / f"multisine_{letter}.npz")
    record = Record(data["iq"], data["omega_motor"], 2500.0, 2500, 2500)
    response = frf(record)
    # the excitation as its makers describe it
    expected = np.arange(11, 251) if letter == "A" else np.arange(13, 250, 4)
    np.testing.assert_array_equal(response.line, expected)
    np.testing.assert_array_equal(response.f_hz, expected)
    g, var_g = by_numpy(record, 2500, expected)
    np.testing.assert_allclose(response.g, g, rtol=1e-9)
    np.testing.assert_allclose(response.var_g, var_g, rtol=1e-6)
    assert response.n_periods == 19
    np.testing.assert_array_equal(
        frf(Record(data["iq_ref"], data["omega_motor"], 2500.0, 2500, 2500)).line, expected
    )


def test_lost_samples_are_left_out_and_counted():
    valid = np.ones(PERIODS * N, bool)
    valid[[0, 3 * N + 7, 3 * N + 8, 5 * N - 1]] = False
    record = make_record(1, noise_u=0.02, valid=valid)
    response = frf(record)
    assert (response.n_periods, response.n_spoiled) == (PERIODS - 3, 3)
    good = [p for p in range(PERIODS) if p not in (0, 3, 4)]
    g, var_g = by_numpy(record, 0, response.line, good)
    np.testing.assert_allclose(response.g, g, rtol=1e-11)
    np.testing.assert_allclose(response.var_g, var_g, rtol=1e-9)


def test_settling_of_any_length_keeps_the_phases_of_the_first_sample():
    record = make_record(2, settle=173, noise_y=0.0)
    m = Multisine.design(FS_HZ, N, (2, 100), phases="random", seed=2)
    s = spectra(record)
    np.testing.assert_array_equal(s.line[s.excited], m.line)
    np.testing.assert_allclose(s.u[s.excited], m.spectrum(), atol=1e-12)
    np.testing.assert_allclose(frf(s).g, true_response(m.f_hz), rtol=1e-11)


@pytest.mark.parametrize("n_realisations", [1, 6])
def test_error_bars_hold(n_realisations):
    """|g - truth|^2 / var_g is an F(2, 2m) variable at every line; its mean over the lines is looked at."""
    records = [make_record(10 + m, noise_u=0.05, noise_y=0.05) for m in range(n_realisations)]
    response = frf(records)
    assert response.n_periods == PERIODS * n_realisations
    assert response.n_realisations == n_realisations
    ratio = np.abs(response.g - true_response(response.f_hz)) ** 2 / response.var_g
    m = n_realisations * (PERIODS - 1)
    expected = m / (m - 1)
    # standard deviation of F(2, 2m) below 1.3 for m >= 11; four of them, the seeds being fixed
    assert abs(ratio.mean() - expected) < 4 * 1.3 / np.sqrt(len(ratio))


def test_realisations_are_averaged_as_the_source_says():
    records = [make_record(20 + m, noise_u=0.05) for m in range(3)]
    each, all_three = [frf(r) for r in records], frf(records)
    np.testing.assert_allclose(all_three.g, sum(one.g for one in each) / 3)
    np.testing.assert_allclose(all_three.var_g, sum(one.var_g for one in each) / 9)
    np.testing.assert_allclose(all_three.u, sum(np.abs(one.u) for one in each) / 3, atol=1e-12)
    # random phases do not average the output away
    np.testing.assert_allclose(all_three.y / all_three.u, all_three.g, rtol=0.1)
    np.testing.assert_allclose(all_three.var_y, sum(one.var_y for one in each) / 3)


def test_a_current_loops_own_harmonics_are_not_excitation():
    rng = np.random.default_rng(3)
    mean = np.zeros(251, complex)
    mean[11:101] = np.exp(2j * np.pi * rng.random(90)) * np.linspace(1, 0.8, 90)
    mean[101:200] = 0.15 * rng.random(99)  # repeats in every period: no noise test can tell
    mean[0] = 5
    scatter = 1e-4 * (rng.standard_normal((8, 251)) + 1j * rng.standard_normal((8, 251)))
    np.testing.assert_array_equal(np.flatnonzero(excited_lines(mean + scatter, 500)), np.arange(11, 101))


def test_a_sloping_spectrum_is_excited_down_to_one_percent():
    k = np.arange(251)
    mean = np.where((k >= 1) & (k <= 200), 1 / np.maximum(k, 1) ** 0.5, 0) + 0j
    rows = np.tile(mean, (4, 1)) + 1e-6 * np.random.default_rng(1).standard_normal((4, 251))
    np.testing.assert_array_equal(np.flatnonzero(excited_lines(rows, 500)), np.arange(1, 201))


@pytest.mark.parametrize("slope", [-20.0, -30.0, 20.0])
@pytest.mark.parametrize("grid", ["full", "odd", "odd-random", "quasi-log"])
def test_every_line_of_a_steep_design_is_measured(grid, slope):
    # lines 1 and 3 of a spectrum that falls as 1/f are 3 apart: that step was taken for its end, unsaid
    design = Multisine.design(1000, 2000, (0.5, 120), grid=grid, shape_db_per_decade=slope, rms=20)
    u = np.tile(design.table(), 4)
    np.testing.assert_array_equal(frf(Record(u, u, 1000)).line, design.line)
    # the noise of a measured input hides the weakest lines of the steepest spectrum only
    noisy = frf(Record(u + np.random.default_rng(1).normal(0, 0.005, len(u)), u, 1000))
    assert set(noisy.line) <= set(design.line)
    assert len(noisy.line) + len(noisy.rejected_hz) == len(design.line)
    assert len(noisy.line) >= 0.9 * len(design.line)


def test_harmonics_beside_a_sloping_spectrum_are_not_excitation():
    rng = np.random.default_rng(4)
    k = np.arange(501)
    excited = (k % 2 == 1) & (k <= 239)
    mean = np.where(excited, 1 / np.maximum(k, 1), 0.05 * rng.random(501) / np.maximum(k, 1)) + 0j
    rows = mean + 1e-6 * rng.standard_normal((4, 501))
    np.testing.assert_array_equal(np.flatnonzero(excited_lines(rows, 1000)), np.flatnonzero(excited))


def test_a_measured_input_that_falls_into_its_noise_keeps_its_first_lines():
    # nothing parts such a spectrum from what lies beneath; line 3 is 3 times weaker than line 1 all the same
    rng = np.random.default_rng(5)
    k = np.arange(501)
    mean = np.where((k % 2 == 1) & (k <= 239), 1 / np.maximum(k, 1), 0) + 0j
    rows = mean + 0.02 * (rng.standard_normal((20, 501)) + 1j * rng.standard_normal((20, 501)))
    lines = np.flatnonzero(excited_lines(rows, 1000))
    assert set(lines) <= set(np.arange(1, 240, 2))
    assert set(lines) >= set(np.arange(1, 20, 2))  # 8 sigma of the mean and more, 4 are asked for


def test_lines_in_their_own_noise_are_not_excited():
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((10, 251)) + 1j * rng.standard_normal((10, 251))
    assert not excited_lines(rows, 500).any()
    assert not excited_lines(np.zeros((3, 251), complex), 500).any()
    # the last line of an odd period is below fs/2, that of an even one is not
    rows = np.zeros((3, 4), complex)
    rows[:, 3] = 1
    assert excited_lines(rows, 7)[3]
    assert not excited_lines(rows, 6).any()


def test_band_and_refusals():
    record = make_record(4)
    banded = frf(record, band=(10, 20))
    np.testing.assert_allclose(banded.f_hz, np.arange(10, 21, 2))
    with pytest.raises(InputError, match="no line within 300:400 Hz") as caught:
        frf(record, band=(300, 400))
    assert "2 .. 100 Hz" in caught.value.hint
    with pytest.raises(ValueError, match="no record"):
        frf([])
    with pytest.raises(InputError, match="differ in y_unit"):
        frf([record, make_record(5, y_unit="deg/s")])
    other = make_record(6)
    other.fs_hz = 2000.0
    with pytest.raises(InputError, match="differ in fs_hz"):
        frf([record, other])


def test_control_and_pandas_there_and_back():
    response = frf(make_record(7))
    frd = response.to_control()
    np.testing.assert_allclose(frd.omega, 2 * np.pi * response.f_hz)
    back = Frf.from_control(frd, var_g=response.var_g)
    np.testing.assert_array_equal(back.g, response.g)
    np.testing.assert_allclose(back.f_hz, response.f_hz)
    np.testing.assert_array_equal(back.var_g, response.var_g)
    assert np.isnan(Frf.from_control(frd).var_g).all()
    with pytest.raises(ValueError, match="shapes"):
        Frf.from_control(frd, var_g=[1.0])
    table = response.to_pandas()
    np.testing.assert_array_equal(table["g_re"] + 1j * table["g_im"], response.g)
    np.testing.assert_allclose(10 ** (table["gain_db"] / 20), np.abs(response.g))
    assert len(table) == len(response.f_hz)


def test_prints_a_summary_and_not_every_line():
    response = frf(make_record(8, y_unit="deg/s", u_unit="V", name="<axis>"))
    assert "50, 2 .. 100 Hz" in repr(response)
    assert "12 good, 0 spoiled" in repr(response)
    assert "deg/s/V" in repr(response)
    assert len(repr(response).splitlines()) < 12
    html = response._repr_html_()
    assert html.startswith("<table>")
    assert "&lt;axis&gt;" in html
    assert "50 excited lines 2 .. 100 Hz" in repr(spectra(make_record(8)))


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("settle", [0, 173])
def test_streaming_is_the_batch_to_rounding(precision, settle):
    valid = np.ones(settle + PERIODS * N, bool)
    valid[settle + 2 * N + 5] = False
    record = make_record(9, settle=settle, noise_u=0.05, noise_y=0.05, valid=valid)
    batch = frf(record)
    streaming = StreamingFrf(FS_HZ, N, batch.line, settle_samples=settle, precision=precision)
    for start in range(0, len(record), 777):
        part = slice(start, start + 777)
        streaming.step(record.u[part], record.y[part], record.valid[part])
    result = streaming.result()
    # sums of 500 samples of rms 5 round to a few hundred epsilon, and 1/|U|^2 of the variance is near 1
    tolerance = 1e-12 if precision == "double" else 2e-5
    np.testing.assert_allclose(result.u, batch.u, atol=tolerance)
    np.testing.assert_allclose(result.g, batch.g, atol=tolerance)
    for name in ("var_g", "var_u", "var_y", "cov_yu"):
        np.testing.assert_allclose(
            getattr(result, name), getattr(batch, name), rtol=100 * tolerance, atol=tolerance**2
        )
    assert (result.n_periods, result.n_spoiled) == (batch.n_periods, batch.n_spoiled)
    assert result.settle_samples == settle


def test_streaming_with_known_input():
    record = make_record(10)
    m = Multisine.design(FS_HZ, N, (2, 100), phases="random", seed=10)
    streaming = StreamingFrf(FS_HZ, N, m.line, u_known=m.spectrum())
    assert streaming.step(np.full(len(record), np.nan), record.y) == PERIODS  # u is not looked at
    result = streaming.result()
    np.testing.assert_allclose(result.g, frf(record).g, rtol=1e-11)
    np.testing.assert_allclose(result.var_g, frf(record).var_g, rtol=1e-9)
    assert (result.var_u == 0).all()


def test_excited_lines_are_found_in_the_mean_period_as_in_all():
    measured = spectra(make_record(12, settle=41, noise_u=0.3))
    np.testing.assert_array_equal(measured.excited, excited_lines(measured.U, N))


def test_an_input_that_repeats_to_the_bit_has_no_variance():
    """It is transformed once, and the output at the excited lines only: the answer is that of all lines."""
    record = make_record(10, settle=37)
    once, all_lines = frf(record), frf(spectra(record))
    assert (once.var_u == 0).all()
    np.testing.assert_array_equal(once.line, all_lines.line)
    for name in ("g", "var_g", "var_y"):
        np.testing.assert_allclose(getattr(once, name), getattr(all_lines, name), rtol=1e-12)


@pytest.mark.parametrize("precision", ["double", "single"])
def test_streaming_refuses(precision):
    streaming = StreamingFrf(FS_HZ, N, [1, 2, 3], precision=precision)
    with pytest.raises(GsidError, match="not finite"):
        streaming.step([1.0, np.nan], [1.0, 2.0])
    with pytest.raises(ValueError, match="the same length"):
        streaming.step([1.0], [1.0, 2.0])
    with pytest.raises(GsidError, match="too few"):
        streaming.result()
    with pytest.raises(GsidError, match="out of its range"):
        StreamingFrf(FS_HZ, N, [N // 2], precision=precision)
    with pytest.raises(ValueError, match="u_known has shape"):
        StreamingFrf(FS_HZ, N, [1, 2], u_known=[1.0], precision=precision)
    with pytest.raises(ValueError, match="precision must be"):
        StreamingFrf(FS_HZ, N, [1], precision="half")
    assert "3 lines, 0 good periods" in repr(streaming)


@pytest.mark.parametrize("precision", ["double", "single"])
def test_the_engines_agree_with_the_transform_of_numpy(precision):
    period, line = 600, np.arange(1, 101)
    rng = np.random.default_rng(11)
    y = rng.standard_normal((4, period))
    lines = np.fft.rfft(y)[:, line] * (2 / period)
    # sums of 600 products, each rounded (direct): 600 roundings at most
    tolerance = 600 * np.finfo(np.float64 if precision == "double" else np.float32).eps
    for engine in ("direct", "spread"):
        streaming = StreamingFrf(
            FS_HZ, period, line, u_known=np.ones(100), precision=precision, engine=engine
        )
        for block in np.split(y.ravel(), [1, 17, 1000, 1001]):
            streaming.step(np.zeros(len(block)), block)
        result = streaming.result()
        np.testing.assert_allclose(result.y, lines.mean(axis=0), atol=tolerance)
        scatter = np.abs(lines - lines.mean(axis=0)) ** 2
        np.testing.assert_allclose(result.var_y, scatter.sum(axis=0) / 3, atol=tolerance)


def test_the_engine_is_chosen_by_length_and_number_of_lines():
    assert StreamingFrf(FS_HZ, 600, np.arange(1, 101)).engine == "spread"
    assert StreamingFrf(FS_HZ, 600, [1, 2, 3]).engine == "direct"
    assert StreamingFrf(FS_HZ, 601, np.arange(1, 101)).engine == "direct"
    with pytest.raises(GsidError, match="out of its range"):
        StreamingFrf(FS_HZ, 601, [1], engine="spread")
    with pytest.raises(ValueError, match="engine must be"):
        StreamingFrf(FS_HZ, 600, [1], engine="quick")


def test_weak_lines_are_left_out_and_reported(caplog):
    """Never silently: lines below a threshold, lost in the input's noise, or not in every record."""
    record = make_record(30)
    assert len(frf(record).rejected_hz) == 0
    weak = np.fft.rfft(record.u.reshape(PERIODS, N), axis=1)
    weak[:, 20] *= 0.2
    record.u = np.fft.irfft(weak, N, axis=1).ravel()
    level = np.abs(spectra(record).u[20])
    response = frf(record, min_input=1.01 * level)
    np.testing.assert_allclose(response.rejected_hz, [40])
    assert 40 not in response.f_hz
    assert "left out because their input is too weak: 1 (40 Hz)" in caplog.text
    assert 40 in frf(record, min_input=0.99 * level).f_hz
    assert len(frf(record, min_input=1.01 * level, band=(50, 100)).rejected_hz) == 0
    with pytest.raises(InputError, match="no line reaches the minimum input amplitude") as caught:
        frf(record, min_input=1e3)
    assert "the largest is" in caught.value.hint

    noisy = make_record(31)
    rows = np.fft.rfft(noisy.u.reshape(PERIODS, N), axis=1)
    rows[:, 30] *= 1 + 1.5 * (-1.0) ** np.arange(PERIODS)  # as large on average, but no period like the next
    noisy.u = np.fft.irfft(rows, N, axis=1).ravel()
    response = frf(noisy)
    np.testing.assert_allclose(response.rejected_hz, [60])
    assert 60 not in response.f_hz


def test_lines_of_one_record_only_are_reported(caplog):
    first, second = make_record(32), make_record(33)
    lines = np.fft.rfft(second.u.reshape(PERIODS, N), axis=1)
    lines[:, 10] = 0
    second.u = np.fft.irfft(lines, N, axis=1).ravel()
    response = frf([first, second])
    np.testing.assert_allclose(response.rejected_hz, [20])
    assert "1 (20 Hz)" in caplog.text


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("engine", ["direct", "spread"])
def test_parts_measured_apart_are_the_whole(precision, engine):
    """FRF-4, streaming: in any order, on another engine, one of them still empty."""
    rng = np.random.default_rng(34)
    u, y = 1 + rng.standard_normal((2, PERIODS * N))
    line = np.arange(1, 60)

    def measured(periods, engine=engine):
        part = StreamingFrf(FS_HZ, N, line, precision=precision, engine=engine)
        part.step(u[periods[0] * N : periods[1] * N], y[periods[0] * N : periods[1] * N])
        return part

    whole = measured((0, PERIODS)).result()
    parts = measured((0, 5))
    for other in (measured((7, PERIODS), "direct"), measured((0, 0)), measured((5, 7))):
        parts.merge(other)
    assert parts.n_periods == PERIODS
    result = parts.result()
    # a few roundings of sums of 12 terms of size 1
    tolerance = 1e-14 if precision == "double" else 1e-5
    for name in ("u", "y", "var_u", "var_y", "cov_yu"):
        np.testing.assert_allclose(getattr(result, name), getattr(whole, name), rtol=0, atol=tolerance)
    with pytest.raises(GsidError):
        parts.merge(StreamingFrf(FS_HZ, N, line + 1, precision=precision))
    other = "single" if precision == "double" else "double"
    with pytest.raises(ValueError, match="precision"):
        parts.merge(StreamingFrf(FS_HZ, N, line, precision=other))


def test_records_of_one_realisation_are_merged_to_the_whole():
    whole = make_record(35, noise_u=0.05, noise_y=0.05)

    def part(first, last):
        return Record(whole.u[first * N : last * N], whole.y[first * N : last * N], FS_HZ, N, 0)

    expected = frf(whole)
    result = frf([part(0, 2), part(2, 9), part(9, PERIODS)], merge=True)
    for name in ("g", "var_g", "u", "y", "var_u", "var_y", "cov_yu"):
        np.testing.assert_allclose(getattr(result, name), getattr(expected, name), rtol=1e-10, atol=1e-16)
    assert (result.n_periods, result.n_realisations, result.n_dof) == (PERIODS, 1, PERIODS - 1)
    with pytest.raises(InputError, match="inputs of the parts differ") as caught:
        frf([whole, make_record(36)], merge=True)
    assert "omit --merge" in caught.value.hint
    with pytest.raises(ValueError, match="one realisation"):
        merged([frf([whole, make_record(36)])])
    with pytest.raises(ValueError, match="different lines"):
        merged([frf(whole), frf(whole, band=(2, 50))])


def test_response_variance_and_merged_means_are_those_of_the_formula():
    """FRF-2 and FRF-4 written out in numpy, for random means over random numbers of periods."""
    seed = 20260801
    print("seed", seed)
    rng = np.random.default_rng(seed)
    n, worst = 50, dict.fromkeys(("g", "var_g", "var_u", "var_y", "cov_yu"), 0.0)
    for _ in range(50):
        u0, y0 = rng.standard_normal((2, n)) + 1j * rng.standard_normal((2, n))
        size = 10.0 ** rng.uniform(-5, -1)
        U, Y = [], []
        for n_periods in rng.integers(2, 20, 2):
            noise = rng.standard_normal((4, n_periods, n)) * size
            U.append(u0 + noise[0] + 1j * noise[1])
            Y.append(y0 + noise[2] + 1j * noise[3] + 0.5 * noise[0])
        means = [(u.mean(0), y.mean(0), *moments(u, y), len(u)) for u, y in zip(U, Y, strict=True)]
        parts = [part_of(response_of(*each), each[-1]) for each in means]
        u, y = np.concatenate(U), np.concatenate(Y)
        var_u, var_y, cov_yu = moments(u, y)
        g = y.mean(0) / u.mean(0)
        error = var_y + np.abs(g) ** 2 * var_u - 2 * (cov_yu * g.conj()).real
        found = merged(parts)
        expected = {"g": g, "var_u": var_u, "var_y": var_y, "cov_yu": cov_yu}
        expected["var_g"] = error / np.abs(u.mean(0)) ** 2 / len(u)
        scale = {name: np.abs(value) for name, value in expected.items()}
        scale["cov_yu"] = np.sqrt(var_u * var_y)
        scale["var_g"] *= (var_y + np.abs(g) ** 2 * var_u) / error
        for name in worst:
            difference = np.abs(getattr(found, name) - expected[name]) / scale[name]
            worst[name] = max(worst[name], float(difference.max()))
        np.testing.assert_allclose(error_variance(var_u, var_y, cov_yu, g), error, rtol=1e-10)
    print("largest relative differences", worst)
    assert max(worst.values()) < 1e-9  # the deviations are small beside the means: 1e-16 / 1e-5


def test_bug_arrays_of_other_lengths_were_read_beyond_their_end():
    """The C library reads all arrays of a response to the same length."""
    g = np.full(200, 2.0 + 1.0j)
    full = error_variance(np.full(200, 0.5), np.full(200, 3.0), np.full(200, 0.25j), g)
    np.testing.assert_array_equal(
        error_variance(np.array([0.5]), np.array([3.0]), np.array([0.25j]), g), full
    )
    with pytest.raises(ValueError, match="shape"):
        error_variance(np.full(3, 0.5), np.full(200, 3.0), np.full(200, 0.25j), g)


def moments(u, y):
    """Sample variances and covariance over periods (eq. 4.11)."""
    du, dy = u - u.mean(0), y - y.mean(0)
    dof = len(u) - 1
    return (np.abs(du) ** 2).sum(0) / dof, (np.abs(dy) ** 2).sum(0) / dof, (dy * du.conj()).sum(0) / dof


def part_of(arrays, n_periods):
    n = len(arrays["g"])
    facts = {"n_realisations": 1, "n_spoiled": 0, "settle_samples": 0, "period_samples": N, "fs_hz": FS_HZ}
    return Frf(np.arange(1, n + 1), np.arange(1.0, n + 1), **arrays, n_periods=int(n_periods), **facts)


def test_a_line_without_input_is_unknown():
    """Its response was not a number, and so was its variance."""
    one, zero = np.ones(1), np.zeros(1, complex)
    found = response_of(zero, one + 0j, one, one, zero, 3)
    assert found["g"] == 0
    assert np.isinf(found["var_g"])


def test_merged_parts_must_be_of_one_experiment_and_forget_nothing():
    """Only their lines were compared, and what was taken off or left out of all but the first was lost."""
    one = frf(make_record(35, y_unit="rad/s"))
    others = {"fs_hz": 2 * FS_HZ, "y_unit": "m", "hold": "zoh", "period_samples": 2 * N}
    for name, value in others.items():
        with pytest.raises(InputError, match=f"differ in {name}"):
            merged([one, replace(one, **{name: value})])
    sines = [Tone(f_hz, 0.01, 1, 0.1, 0, 1e-9) for f_hz in (30.9, 31.1)]
    first = replace(one, rejected_hz=np.array([1.0, 2.0]), removed=(sines[0],))
    both = merged([first, replace(one, rejected_hz=np.array([2.0, 3.0]), removed=(sines[1],))])
    np.testing.assert_array_equal(both.rejected_hz, [1, 2, 3])
    assert both.removed == tuple(sines)


def test_coherence_of_periods_is_that_of_their_sums():
    """Eq. 5.3 with the powers summed over the periods."""
    record = make_record(37, noise_u=0.1, noise_y=0.2)
    s, response = spectra(record), frf(record)
    U, Y = s.U[:, response.line], s.Y[:, response.line]
    cross = np.abs((Y * U.conj()).sum(axis=0)) ** 2
    expected = cross / (np.abs(U) ** 2).sum(axis=0) / (np.abs(Y) ** 2).sum(axis=0)
    # noise of the input counts twice in the sums, once in the response: second order of 1/SNR
    np.testing.assert_allclose(response.coherence, expected, atol=2e-2)


def test_coherence_of_a_known_variance_is_not_one():
    """It was, whatever the variance, which counted as of no degree of freedom."""
    known = Frf.from_arrays([1, 2, 3], [2, 2j, -2], [0, 1, 4])
    np.testing.assert_allclose(known.coherence, [1, 4 / 5, 1 / 2])  # |G|^2 / (|G|^2 + var)
    assert np.isnan(Frf.from_arrays([1], [2]).coherence).all()
    with pytest.raises(ValueError, match="estimated from periods"):
        merged([known, known])
