"""Period, settling and cutting of records, on signals whose answers are known."""

import numpy as np
import pytest

from gsid.base.errors import InputError
from gsid.records.periods import find_period, find_settling, split_periods
from gsid.records.record import Record
from measured import BENCH, needs_bench


def multisine(n_period: int, lines: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One period, rms 1."""
    spectrum = np.zeros(n_period // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    u = np.fft.irfft(spectrum, n_period)
    return u / np.sqrt(np.mean(u**2))


def repeated(one: np.ndarray, n: int) -> np.ndarray:
    return one[np.arange(n) % len(one)]


# ---------------------------------------------------------------- the period


@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.03])
@pytest.mark.parametrize("n_periods", [2, 2.5, 3, 7.3, 20])
@pytest.mark.parametrize("n_period", [360, 997, 1000, 1024])
def test_period_is_found(n_period, n_periods, noise):
    rng = np.random.default_rng([n_period, int(10 * n_periods)])
    n = int(n_period * n_periods)
    u = repeated(multisine(n_period, np.arange(1, n_period // 6), rng), n)
    assert find_period(u + noise * rng.standard_normal(n)) == n_period


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_smallest_period_not_a_multiple(noise):
    """Lines that are all multiples of 6 repeat 6 times in the designed period."""
    rng = np.random.default_rng(1)
    u = repeated(multisine(1200, np.arange(6, 300, 6), rng), 12000)
    assert find_period(u + noise * rng.standard_normal(len(u))) == 200


@pytest.mark.parametrize("level", [1e-5, 1e-2])
def test_weak_odd_lines_keep_the_long_period(level):
    """One odd line far below the even ones, but above the noise, makes the period twice as long."""
    rng = np.random.default_rng(2)
    one = multisine(1000, np.arange(2, 200, 2), rng) + level * multisine(1000, np.array([7]), rng)
    u = repeated(one, 8000) + 1e-2 * level * rng.standard_normal(8000)
    assert find_period(u) == 1000


def test_prbs_period():
    """A maximum-length sequence of 127 chips, four samples each: exactly repeating, flat spectrum."""
    register, chips = [1] * 7, []
    for _ in range(127):
        chips.append(register[-1])
        register = [register[6] ^ register[5], *register[:-1]]
    u = np.repeat(np.where(chips, 1.0, -1.0), 4)
    assert find_period(repeated(u, 508 * 5 + 77)) == 508


@pytest.mark.parametrize("rest", [1, 137, 1900])
def test_rest_at_the_start(rest):
    rng = np.random.default_rng(3)
    u = np.concatenate([np.zeros(rest), repeated(multisine(500, np.arange(1, 80), rng), 4000)])
    assert find_period(u) == 500


def test_transient_of_a_measured_input():
    rng = np.random.default_rng(4)
    n = np.arange(6000)
    u = repeated(multisine(600, np.arange(5, 60), rng), 6000) + 2 * np.exp(-n / 250) * np.cos(n / 20)
    assert find_period(u + 0.02 * rng.standard_normal(6000)) == 600


def test_lost_samples_do_not_hide_the_period():
    rng = np.random.default_rng(5)
    u = repeated(multisine(600, np.arange(1, 100), rng), 9000)
    valid = rng.random(9000) > 1e-3
    u[~valid] = 50.0
    assert find_period(u, valid=valid) == 600


NOT_PERIODIC = {
    "white noise": lambda rng: rng.standard_normal(5000),
    "random walk": lambda rng: np.cumsum(rng.standard_normal(5000)),
    "low-pass noise": lambda rng: np.convolve(rng.standard_normal(9000), np.ones(50), "same"),
    "ramp": lambda rng: np.arange(5000.0),
    "sweep": lambda rng: np.sin(np.linspace(0, 1, 8000) ** 2 * 3000),
    "step": lambda rng: np.repeat([0.0, 1.0], [100, 4900]),
    "constant": lambda rng: np.full(1000, 3.0),
    "three samples": lambda rng: np.array([1.0, 2.0, 3.0]),
}


@pytest.mark.parametrize("kind", NOT_PERIODIC)
def test_non_periodic_is_refused(kind):
    with pytest.raises(InputError) as caught:
        find_period(NOT_PERIODIC[kind](np.random.default_rng(6)), name="rec.csv")
    assert caught.value.hint
    assert caught.value.where == "rec.csv"


@pytest.mark.parametrize("kind", ["white noise", "random walk", "low-pass noise"])
def test_noise_never_passes_for_periodic(kind):
    """60 realisations each: none has a lag at which three quarters of its power repeat."""
    for seed in range(60):
        with pytest.raises(InputError):
            find_period(NOT_PERIODIC[kind](np.random.default_rng(seed)))


def test_less_than_two_periods_is_reported():
    u = repeated(multisine(1000, np.arange(1, 100), np.random.default_rng(7)), 1700)
    with pytest.raises(InputError, match=r"fewer than two periods.*1000 of 1700"):
        find_period(u)


def test_a_smooth_or_noisy_input_must_be_stated():
    """Three slow lines in noise a third of their size: N and N + 1 explain them as well as each other."""
    found, refused = [], 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        u = repeated(multisine(2000, np.arange(1, 4), rng), 6000) + 0.3 * rng.standard_normal(6000)
        try:
            found.append(find_period(u))
        except InputError as error:
            refused += "--period" in error.hint
    assert all(period == 2000 for period in found)
    assert len(found) + refused == 30


# ---------------------------------------------------------------- the settling


def steady(n_periods: int, rng: np.random.Generator, noise: float = 0.01, n_period: int = 500) -> Record:
    u = repeated(multisine(n_period, np.arange(1, 100), rng), n_periods * n_period)
    return Record(u, np.roll(u, 3) + noise * rng.standard_normal(len(u)), 1000.0)


@pytest.mark.parametrize("n_periods", [2, 3, 4, 8, 20])
def test_steady_records_keep_their_periods(n_periods):
    """False alarms: 1e-4 per band of lines, so about 3e-3 a record; 3 of 60 has a chance below 2e-3."""
    alarms = sum(find_settling(steady(n_periods, np.random.default_rng(s)), 500) > 0 for s in range(60))
    assert alarms < 3


@pytest.mark.parametrize(("n_periods", "tau", "expected"), [(3, 60, 500), (8, 60, 500), (8, 250, 1500)])
def test_transient_is_discarded(n_periods, tau, expected):
    """A decay from 1 in noise of 0.01.

    60 samples: exp(-500/60) = 2e-4 is lost in the noise of period 1. 250 samples: period p starts at
    exp(-2 p), 0.0025 and 0.0003 for p = 3 and 4, and drowns in the noise there.
    """
    rng = np.random.default_rng(8)
    record = steady(n_periods, rng)
    record.y = record.y + np.exp(-np.arange(len(record)) / tau)
    settle = find_settling(record, 500)
    assert settle == expected


def test_transient_of_u_alone_counts():
    record = steady(8, np.random.default_rng(9))
    record.u = record.u.copy()
    record.u[:100] = 0
    assert find_settling(record, 500) == 500


def test_settling_is_at_most_half_of_the_periods():
    rng = np.random.default_rng(10)
    record = steady(8, rng)
    record.y = record.y + 0.1 * np.cumsum(rng.standard_normal(len(record)))
    assert find_settling(record, 500) <= 2000


# ---------------------------------------------------------------- cutting


def test_lost_sample_spoils_its_period_only():
    record = steady(8, np.random.default_rng(11))
    record.valid[[1200, 1201, 3999]] = False
    record.y[1200] = 1e9
    periods = split_periods(record)
    assert periods.period_samples == 500
    assert periods.n_spoiled == 2
    assert periods.number.tolist() == [0, 1, 3, 4, 5, 6]
    np.testing.assert_array_equal(periods.u, record.u.reshape(8, 500)[periods.number])
    np.testing.assert_array_equal(periods.y, record.y.reshape(8, 500)[periods.number])


def test_argument_before_record_before_data():
    record = steady(8, np.random.default_rng(12))
    assert split_periods(record).settle_samples == 0
    record.period_samples, record.settle_samples = 1000, 130
    periods = split_periods(record)
    assert (periods.period_samples, periods.settle_samples, len(periods.u)) == (1000, 130, 3)
    periods = split_periods(record, period=500, settle=0)
    assert (periods.period_samples, periods.settle_samples, len(periods.u)) == (500, 0, 8)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"period": 500, "settle": 3001}, "fewer than two good periods"),
        ({"period": 2001, "settle": 0}, "fewer than two good periods"),
        ({"period": 499, "settle": 0}, "does not repeat every 499"),
        ({"period": 2, "settle": 0}, "out of range"),
        ({"period": 500, "settle": -1}, "out of range"),
    ],
)
def test_bad_cuts_are_refused(arguments, words):
    with pytest.raises(InputError, match=words) as caught:
        split_periods(steady(8, np.random.default_rng(13)), **arguments)
    assert caught.value.hint


def test_too_many_spoiled():
    record = steady(3, np.random.default_rng(14))
    record.valid[[0, 600]] = False
    with pytest.raises(InputError, match="2 spoiled"):
        split_periods(record, period=500, settle=0)


# ---------------------------------------------------------------- the record itself


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"y": np.zeros(9)}, "unequal lengths"),
        ({"valid": np.ones(9, bool)}, "unequal lengths"),
        ({"u": np.zeros((10, 2))}, "not one row"),
        ({"y": np.full(10, np.nan)}, "not finite"),
        ({"fs_hz": 0.0}, "sample rate"),
        ({"fs_hz": np.nan}, "sample rate"),
        ({"fs_hz": 1e-320}, "sample rate is out of range"),
        ({"fs_hz": 1e30}, "sample rate is out of range"),
        ({"hold": "foh"}, "hold"),
    ],
)
def test_unsound_record_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        Record(**{"u": np.zeros(10), "y": np.zeros(10), "fs_hz": 100.0, **change})


def test_prints_in_one_line():
    record = steady(4, np.random.default_rng(15))
    record.valid[3] = False
    record.name = "a.csv"
    assert repr(record) == "Record(a.csv: 2000 samples at 1000 Hz, 2 s, 1 lost)"
    assert repr(split_periods(record)) == "Periods(3 of 500 samples, 1 spoiled, after settling 0)"


# ---------------------------------------------------------------- a real bench


@needs_bench
@pytest.mark.parametrize("realisation", ["A", "B"])
@pytest.mark.parametrize("u", ["iq", "iq_ref"])
def test_bench_period_and_settling(realisation, u):
    """iq is a measured current, iq_ref the command; the first period is known to be transient."""
    arrays = np.load(BENCH / f"multisine_{realisation}.npz")
    record = Record(arrays[u], arrays["omega_motor"], 2500.0)
    assert find_period(record.u) == 2500
    assert 2500 <= find_settling(record, 2500) <= 5000


# ---------------------------------------------------------------- pandas


def test_pandas_and_back():
    rng = np.random.default_rng(7)
    valid = np.ones(50, bool)
    valid[3] = False
    record = Record(rng.random(50), rng.random(50), 250.0, valid=valid, columns={"theta_deg": rng.random(50)})
    frame = record.to_pandas()
    assert list(frame.columns) == ["u", "y", "valid", "theta_deg"]
    back = Record.from_pandas(frame, period_samples=25)
    assert back.fs_hz == pytest.approx(250)
    np.testing.assert_array_equal(back.u, record.u)
    np.testing.assert_array_equal(back.valid, valid)
    np.testing.assert_array_equal(back.columns["theta_deg"], record.columns["theta_deg"])
    assert back.period_samples == 25


def test_a_frame_without_the_column_or_with_unequal_times_is_refused():
    frame = Record(np.zeros(5), np.zeros(5), 10.0).to_pandas()
    with pytest.raises(InputError, match="missing"):
        Record.from_pandas(frame, y="gyro")
    with pytest.raises(InputError, match="equally spaced"):
        Record.from_pandas(frame.set_index(np.array([0, 1, 2, 3, 9.0])))


def test_two_periods_are_not_reported_as_settled(caplog):
    """A bug: of a record with a transient, "settling of 0 samples found from the data"."""
    u = repeated(multisine(500, np.arange(1, 80), np.random.default_rng(8)), 1000)
    with caplog.at_level("INFO", "gsid"):
        split_periods(Record(u, u + np.exp(-np.arange(1000) / 100), 100.0, 500))
    assert "fewer than three periods: settling cannot be checked" in caplog.text
    assert "found" not in caplog.text


def test_a_constant_output_is_reported(caplog):
    """A bug: a gyro that was not connected had a response of -inf dB, and nothing was said."""
    u = repeated(multisine(500, np.arange(1, 80), np.random.default_rng(8)), 2000)
    split_periods(Record(u, np.full(2000, 0.1), 100.0, 500, 0))
    assert "y is constant: nothing was measured" in caplog.text
