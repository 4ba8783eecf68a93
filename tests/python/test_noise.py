"""Noise of a record: densities and sines of known size, false alarms counted, errors beside the bound."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import freqz, lfilter, welch
from scipy.stats import binom
from scipy.stats import t as student_t

from gsid.base.errors import InputError
from gsid.excitation.multisine import Multisine
from gsid.records.record import Record
from gsid.response.estimate import frf
from gsid.spectrum.noise import Noise, noise, without_tones
from gsid.spectrum.tones import false_alarm, find_tones

FS_HZ = 1000.0
COLOUR = [1.0], [1.0, -0.9]  # a first-order low pass


def zero_input(y, **facts):
    return Record(np.zeros(len(y)), y, FS_HZ, y_unit="deg/s", **facts)


def white(seed, n, std=1.0):
    return std * np.random.default_rng(seed).standard_normal(n)


def within_binomial(count, n, p, level=0.999):
    low, high = binom.interval(level, n, p)
    return low <= count <= high


def test_density_is_that_of_the_filter_and_lies_in_its_interval():
    n, std = 64000, 0.02
    y = lfilter(*COLOUR, white(1, n + 1000, std))[1000:]
    found = noise(zero_input(y), period=1000)
    true = std**2 / (FS_HZ / 2) * np.abs(freqz(*COLOUR, found.f_hz, fs=FS_HZ)[1]) ** 2
    low, high = found.interval(0.95)
    inside = np.count_nonzero((low < true) & (true < high))
    # neighbouring lines of a Hann window are correlated: about half as many independent ones
    assert within_binomial(inside // 2, len(true) // 2, 0.95)
    assert found.variance_rest == pytest.approx(
        std**2 / (1 - 0.9**2), rel=0.05
    )  # 3 sigma of 64000 / 19 samples
    assert found.tones == []
    assert "No periodic disturbance (at a false-alarm rate of 0.01)" in found.sentence


def test_mean_and_drift_are_covered_by_their_intervals():
    """Student's t of the windows less 2 degrees of freedom, white and coloured noise; seeds 0 to 399."""
    n, slope, mean = 16000, 3e-3, 0.7
    t_s = np.arange(n) / FS_HZ
    limit = student_t.ppf(0.975, 14)
    for colour in (([1.0], [1.0]), COLOUR):
        covered = np.zeros(2, int)
        for seed in range(400):
            y = lfilter(*colour, white(seed, n + 1000))[1000:] + mean + slope * (t_s - t_s.mean())
            found = noise(zero_input(y))
            covered += [
                abs(found.mean - mean) < limit * found.std_mean,
                abs(found.drift - slope) < limit * found.std_drift,
            ]
        assert all(within_binomial(count, 400, 0.95) for count in covered), covered


def test_drift_is_numpys_line_through_the_means_of_windows():
    y = white(3, 16000) + np.linspace(0, 1, 16000)
    record = zero_input(y, valid=np.arange(16000) // 1000 != 4)  # a lost window
    found = noise(record, period=1000)
    keep = np.delete(np.arange(16), 4)
    line, cov = np.polyfit(keep + 0.5, y.reshape(16, 1000)[keep].mean(axis=1), 1, cov=True)
    assert (found.drift, found.std_drift) == pytest.approx((line[0], np.sqrt(cov[0, 0])), rel=1e-9)
    short = noise(zero_input(y[:2000]), period=1000)
    assert np.isnan([short.drift, short.std_drift, short.std_mean]).all()
    assert "drift" not in short.drift_words


def test_a_noise_model_is_read_as_it_was_written(tmp_path):
    y = white(4, 16000) + 0.5 * np.cos(2 * np.pi * 30.9 * np.arange(16000) / FS_HZ)
    for record in (zero_input(y), zero_input(y[:500])):
        found = noise(record, period=250)
        found.save(tmp_path / "noise.json")
        again = Noise.load(tmp_path / "noise.json")
        assert repr(again) == repr(found)
        np.testing.assert_equal(dataclasses.asdict(again), dataclasses.asdict(found))


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"gsid_noise": 2}', '{"gsid_noise": 1, "f_hz": [1]}'])
def test_a_file_that_is_no_noise_model_is_refused(tmp_path, text):
    (tmp_path / "noise.json").write_text(text)
    with pytest.raises(InputError, match="not a noise model"):
        Noise.load(tmp_path / "noise.json")
    with pytest.raises(InputError, match="cannot be read"):
        Noise.load(tmp_path / "missing.json")


def test_density_is_scipys():
    y = white(2, 8000)
    found = noise(zero_input(y), period=500)
    # scipy's takes each window's mean off as well; the record's trend does not matter within a window
    f_hz, psd = welch(y, FS_HZ, "hann", 500, detrend="constant")
    np.testing.assert_allclose(found.f_hz, f_hz[1:-1])
    np.testing.assert_allclose(found.psd, psd[1:-1], rtol=1e-3)


def test_variance_of_a_line_is_that_of_a_measurement():
    """2 fs/N times the density is the variance of a line of one period (thesis, eq. 4.11)."""
    n_period, n_periods = 500, 400
    y = white(3, n_period * n_periods)
    lines = np.fft.rfft(y.reshape(n_periods, n_period))[:, 1:250] * 2 / n_period
    variance = lines.var(axis=0, ddof=1)
    found = noise(zero_input(y), period=n_period)
    # each of 249 lines has 400 values: their mean ratio within 4 / sqrt(249 * 400)
    assert np.mean(found.line_variance(n_period) / variance) == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("alpha", [0.05, 0.01])
def test_white_noise_alarms_at_the_stated_rate(alpha):
    n_records = 3000
    alarms = sum(bool(find_tones(white(s, 1024), FS_HZ, alpha=alpha)[0]) for s in range(n_records))
    print(f"{alarms} false alarms in {n_records} records at {alpha}")
    assert within_binomial(alarms, n_records, alpha)


@pytest.mark.parametrize(
    ("kind", "make", "period"),
    [
        ("low pass", lambda s: lfilter(*COLOUR, white(s, 1524))[500:], 0),
        ("random walk", lambda s: np.cumsum(white(s, 1024)), 0),
        ("excited", lambda s: white(s, 1024) + np.tile(white(7, 128), 8), 128),
    ],
)
def test_other_noise_alarms_no_more_often(kind, make, period):
    n_records, alpha = 600, 0.05
    alarms = sum(bool(find_tones(make(s), FS_HZ, alpha=alpha, period=period)[0]) for s in range(n_records))
    print(f"{kind}: {alarms} false alarms in {n_records} records at {alpha}")
    assert alarms <= binom.ppf(0.999, n_records, alpha)


def test_frequency_and_amplitude_err_as_the_cramer_rao_bound():
    n, amplitude, n_records = 2048, 0.3, 300
    bound_hz = np.sqrt(24 / (amplitude**2 * n**3)) * FS_HZ / (2 * np.pi)  # std 1 of the noise
    bound_amplitude = np.sqrt(2 / n)
    t_s = np.arange(n) / FS_HZ
    error, scaled = [], []
    for seed in range(n_records):
        rng = np.random.default_rng(seed)
        f_hz = 100 + 2 * rng.random()  # anywhere between the bins
        tone = find_tones(
            amplitude * np.cos(2 * np.pi * f_hz * t_s + 6 * rng.random()) + rng.standard_normal(n), FS_HZ
        )[0][0]
        error.append(((tone.f_hz - f_hz) / bound_hz, (tone.amplitude - amplitude) / bound_amplitude))
        scaled.append((tone.f_hz - f_hz) / tone.std_f_hz)
    rms = np.sqrt(np.mean(np.square(error), axis=0))
    print(f"rms errors over their Cramer-Rao bounds: frequency {rms[0]:.3f}, amplitude {rms[1]:.3f}")
    # a standard deviation of 300 values scatters by 4 %: three of that to both sides
    np.testing.assert_allclose(rms, 1, atol=0.12)
    covered = np.count_nonzero(np.abs(scaled) < 1.96)
    assert within_binomial(covered, n_records, 0.95)


def test_a_fan_is_found_and_named_by_its_frequency():
    """The source's: 50 s of 3 kHz, 30.9 Hz, of which two multiples are there, in noise ten times as large."""
    fs_hz, n, fan_hz = 3000.0, 150000, 30.9012
    t_s = np.arange(n) / fs_hz
    y = white(5, n, 0.015) + 0.4
    for order, amplitude in ((1, 0.0021), (2, 0.0009), (3, 0.0008)):
        y += amplitude * np.cos(2 * np.pi * order * fan_hz * t_s + order)
    found = noise(Record(np.zeros(n), y, fs_hz, y_unit="deg/s"))
    assert [tone.order for tone in found.tones] == [1, 2, 3]
    for order, tone in enumerate(found.tones, 1):
        assert abs(tone.f_hz - order * fan_hz) < 4 * tone.std_f_hz
        assert tone.std_f_hz < 1e-3
    fan = found.tones[0]
    assert fan.name == f"{fan.f_hz:.4f} Hz"
    assert found.tones[1].name.endswith(f"(2 x {fan.f_hz:.4f} Hz)")
    assert f"{fan.name} of {fan.amplitude:.3g} deg/s" in found.sentence
    assert abs(fan.amplitude - 0.0021) < 4 * fan.std_amplitude
    assert found.variance_rest == pytest.approx(0.015**2, rel=0.011)  # 3 sigma of 150000 squares
    assert found.near_tone(np.array([30.0, 30.9, 61.8]), 0.1).tolist() == [False, True, True]


def test_unrelated_sines_are_not_named_by_each_other():
    """Any within half a bin of a multiple was: with a base of few bins that is nearly every one."""
    n, n_records, chance = 4096, 80, 0
    t_s = np.arange(n) / FS_HZ
    for seed in range(n_records):
        rng = np.random.default_rng(seed)
        f_hz = [rng.uniform(2, 3), *rng.uniform(20, 400, 3)]
        y = sum(0.5 * np.cos(2 * np.pi * f * t_s + 6 * rng.random()) for f in f_hz) + rng.standard_normal(n)
        tones = find_tones(y, FS_HZ)[0]
        assert len(tones) >= 4
        chance += sum(tone.order > 1 for tone in tones)
    print(f"{chance} of {4 * n_records} unrelated sines named as multiples")
    assert chance <= binom.ppf(0.999, 6 * n_records, 0.01)  # six pairs, 1 % each at most


def test_multiples_without_noise_are_named():
    """Their standard deviations are next to nothing: what rounding leaves must not take the name away."""
    t_s = np.arange(4000) / FS_HZ
    y = np.cos(2 * np.pi * 30.91 * t_s) + 0.3 * np.cos(2 * np.pi * 92.73 * t_s + 1)
    assert [tone.order for tone in find_tones(y, FS_HZ)[0][:2]] == [1, 3]


def test_strong_sines_close_together_are_resolved():
    """Leakage of the one is no error of the other: both are fitted again when the other is known."""
    n = 4000
    t_s = np.arange(n) / FS_HZ
    true = [(50.0, 1.0), (51.1, 0.5), (200.03, 0.01)]  # bins are 0.25 Hz
    y = sum(a * np.cos(2 * np.pi * f * t_s + f) for f, a in true) + white(6, n, 1e-3)
    found = noise(zero_input(y)).tones
    assert len(found) == len(true)
    for (f_hz, amplitude), tone in zip(true, found, strict=True):
        assert abs(tone.f_hz - f_hz) < 5 * tone.std_f_hz
        assert abs(tone.amplitude - amplitude) < 5 * tone.std_amplitude


def test_a_sine_without_noise_is_one_sine():
    """What the fit leaves of it is rounding, in which there are 32 more."""
    found = noise(zero_input(np.cos(2 * np.pi * 100 * np.arange(4000) / FS_HZ)))
    assert [round(tone.f_hz, 9) for tone in found.tones] == [100]
    assert noise(zero_input(np.full(4000, 3.0))).tones == []


def test_lost_samples_are_left_out():
    n = 20000
    t_s = np.arange(n) / FS_HZ
    y = 0.2 * np.cos(2 * np.pi * 30.91 * t_s + 1) + white(8, n)
    valid = np.ones(n, bool)
    valid[3000:3010] = valid[15000] = False
    y[~valid] = 1e3
    found = noise(zero_input(y, valid=valid))
    assert found.n_lost == 11
    assert [round(tone.f_hz, 1) for tone in found.tones] == [30.9]
    assert found.variance_rest == pytest.approx(1, abs=0.04)  # 4 sigma
    assert found.psd.mean() * FS_HZ / 2 == pytest.approx(1, abs=0.04)


def excited(seed, tone_hz, n_period=500, n_periods=24, settle=500):
    m = Multisine.design(FS_HZ, n_period, (2, 100), seed=1, phases="random")
    n = settle + n_periods * n_period
    u = np.resize(m.table(), n)
    y = 3 * u + 0.05 * np.cos(2 * np.pi * tone_hz * np.arange(n) / FS_HZ + 0.5) + white(seed, n, 0.05)
    return Record(u, y, FS_HZ, n_period, settle)


def test_a_disturbance_is_subtracted_from_an_excited_record():
    record = excited(9, 30.9)
    found = noise(record)
    assert [round(tone.f_hz, 1) for tone in found.tones] == [30.9]
    assert abs(found.tones[0].phase_rad - 0.5) < 0.2  # from the record's first sample
    assert found.variance_rest == pytest.approx(0.05**2, rel=0.06)  # 4 sigma of 12000 squares
    cleaned, tones = without_tones(record)
    assert tones == found.tones
    with_fan, without = frf(record), frf(record, remove_periodic=True)
    near = np.argmin(np.abs(with_fan.f_hz - 30))
    truth = dataclasses.replace(record, y=record.y - excited(9, 30.9).y + excited(9, 0.0).y)
    floor = np.median(frf(truth).var_g)
    assert with_fan.var_g[near] > 20 * floor
    assert without.var_g[near] < 3 * floor  # a chi-square of 46 over its mean
    np.testing.assert_allclose(without.g, 3, atol=5 * np.sqrt(floor))
    assert [round(tone.f_hz, 1) for tone in without.removed] == [30.9]
    np.testing.assert_array_equal(cleaned.u, record.u)


@pytest.mark.parametrize("n_periods", [2, 3])
def test_a_disturbance_counts_once_in_the_variance(n_periods):
    """It was scaled up with the noise, by the share that the mean period takes: 2 x at two periods."""
    n_period, n = 2000, 2000 * n_periods
    u = np.resize(white(20, n_period), n)
    line = 200.5 if n_periods == 2 else 200 + 1 / 3  # farthest from the lines of the period: a bin
    y = 3 * u + np.cos(2 * np.pi * line * np.arange(n) / n_period) + white(21, n, 0.1)
    found = noise(Record(u, y, FS_HZ, n_period, 0))
    assert len(found.tones) == 1
    # the sine's fit beside two lines errs by 0.1 sqrt(2 / n) x 2 in amplitude: 0.01 is more than 3 sigma
    assert found.variance == pytest.approx(0.51, abs=0.01)
    assert found.variance_rest == pytest.approx(0.01, rel=0.1)  # 3 sigma of 2000 squares


def test_lost_periods_do_not_make_the_noise_smaller():
    """They counted as measured: two of four lost left 2/3 of the variance, and of the density."""
    n_period, n = 2000, 8000
    u = np.resize(white(22, n_period), n)
    valid = np.ones(n, bool)
    valid[n_period : 3 * n_period] = False
    y = np.where(valid, 3 * u + white(23, n, 0.1), 0)
    found = noise(Record(u, y, FS_HZ, n_period, 0, valid=valid))
    assert found.tones == []
    assert found.variance_rest == pytest.approx(0.01, rel=0.1)  # 3 sigma of 2000 squares
    assert found.psd.mean() * FS_HZ / 2 == pytest.approx(0.01, rel=0.15)  # two tapered windows


def test_a_disturbance_at_a_line_of_the_period_stays():
    assert noise(excited(10, 30.0)).tones == []


@pytest.mark.parametrize("bins", [0.3, 0.5, 0.8])
def test_close_to_a_line_it_is_found_and_its_error_is_known(bins):
    """Within a bin of a line most of the sine looks like the response: the fit is less certain, and says so.

    Looked for only three quarters of a bin away, what leaks there of one at half a bin came out as two.
    """
    f_hz = 30 + bins / 12  # 24 periods of 0.5 s
    scaled = []
    for seed in range(25):
        (tone,) = noise(excited(seed, f_hz)).tones
        scaled.append(((tone.f_hz - f_hz) / tone.std_f_hz, (tone.amplitude - 0.05) / tone.std_amplitude))
    covered = np.count_nonzero(np.abs(scaled) < 1.96, axis=0)
    print(f"{bins} bins away: covered {covered} of 25, std of the amplitude {tone.std_amplitude:.2g}")
    assert all(within_binomial(count, 25, 0.95) for count in covered)


@pytest.mark.parametrize("n_period", [0, 500])
def test_where_samples_are_lost_the_error_is_known_too(n_period):
    """They counted as noise of 0: the standard deviations were too small by 1.4 to 1.7."""
    n, amplitude, scaled = 6000, 0.5, []
    valid = np.ones(n, bool)
    valid[500:3500] = False
    for seed in range(60):
        rng = np.random.default_rng(seed)
        u = np.resize(rng.standard_normal(n_period), n) if n_period else np.zeros(n)
        f_hz = 100.9 + 0.2 * rng.random()  # lines of the period 2 Hz apart
        sine = amplitude * np.cos(2 * np.pi * f_hz * np.arange(n) / FS_HZ + 6 * rng.random())
        y = np.where(valid, 3 * u + sine + rng.standard_normal(n), 0)
        tones = noise(Record(u, y, FS_HZ, n_period or None, 0, valid=valid)).tones
        tone = min(tones, key=lambda tone: abs(tone.f_hz - f_hz))
        scaled.append(((tone.f_hz - f_hz) / tone.std_f_hz, (tone.amplitude - amplitude) / tone.std_amplitude))
    rms = np.sqrt(np.mean(np.square(scaled), axis=0))
    print(f"period {n_period}: rms errors over their standard deviations {rms[0]:.2f}, {rms[1]:.2f}")
    np.testing.assert_allclose(rms, 1, atol=0.3)  # 60 values: 9 %; three of that


def test_next_to_a_line_the_fit_does_not_run_away():
    for seed in range(10):
        tones = noise(excited(seed, 30 + 0.1 / 12)).tones
        assert all(tone.amplitude < 0.1 for tone in tones)  # one came out 16 times as large as it was


def test_an_input_that_is_only_noise_counts_as_zero(caplog):
    record = dataclasses.replace(zero_input(white(11, 4000)), u=white(12, 4000))
    assert noise(record).period_samples == 0
    assert "neither zero nor periodic" in caplog.text


def test_false_alarm_probability_is_that_of_the_formula():
    """With ever more bins beside, NOI-1 becomes Rice's K sqrt(pi z / 3) exp(-z)."""
    z = np.array([15.0, 20.0])
    expected = 1e4 * np.sqrt(np.pi * z / 3) * np.exp(-z)
    np.testing.assert_allclose(false_alarm(z, np.full(2, 1e7), 1e4), expected, rtol=1e-4)
    assert false_alarm(np.array([1.0]), np.array([32.0]), 1e4) == 1


def test_refusals():
    with pytest.raises(InputError, match="too few samples") as caught:
        noise(zero_input(white(13, 100)))
    assert "at least 256" in caught.value.hint
    for period in (1, 2, 7):  # ended in an IndexError, and a division by zero
        with pytest.raises(InputError, match="too short for a spectrum"):
            noise(zero_input(white(13, 1000)), period=period)
    assert len(noise(zero_input(white(13, 1000)), period=8).f_hz) == 3
    with pytest.raises(ValueError, match="alpha must be"):
        noise(zero_input(white(13, 1000)), alpha=0)
    with pytest.raises(ValueError, match="level must be"):
        noise(zero_input(white(13, 1000))).interval(1)
    with pytest.raises(InputError, match="does not repeat"):
        noise(excited(9, 30.9), period=490)
    valid = np.arange(4000) % 100 != 0
    with pytest.raises(InputError, match="without lost samples"):
        noise(zero_input(white(14, 4000), valid=valid))
    with pytest.raises(InputError, match="no valid samples"):  # ended in a ValueError of an empty array
        noise(zero_input(white(14, 4000), valid=np.zeros(4000, bool)))
