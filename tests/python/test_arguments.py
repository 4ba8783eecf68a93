"""Mistakes of a person: refused in words of the caller, or said, where they were a traceback from inside."""

import re
import traceback
from dataclasses import replace

import numpy as np
import pytest

import gsid
from gsid.base.errors import InputError
from gsid.excitation.multisine import Multisine
from gsid.fitting.validation import validate
from gsid.records.files import read_record
from gsid.records.record import Record
from gsid.response.frf import Frf
from gsid.spectrum.excited import slip

FS_HZ, N = 1000.0, 500
COMMAND = Multisine.design(FS_HZ, N, (2, 200), grid="odd", rms=1.0).table()


@pytest.fixture
def record():
    u = np.tile(COMMAND, 6)
    y = np.convolve(u, [0, 0.5, 0.5])[: len(u)] + np.random.default_rng(1).normal(0, 0.01, len(u))
    return Record(u, y, FS_HZ)


def test_a_traceback_shows_the_hint(record):
    # a user of Python saw "the records differ" and no word of what to do about it
    with pytest.raises(InputError) as caught:
        gsid.frf(record, period=N // 2)
    shown = "".join(traceback.format_exception(caught.value))
    assert f"hint: u repeats every {N} samples" in shown
    assert caught.value.hint not in str(caught.value)
    assert not hasattr(InputError("what"), "__notes__")
    with pytest.raises(gsid.GsidError) as caught:
        raise gsid.GsidError(-1, "failed", "try again")
    assert caught.value.__notes__ == ["hint: try again"]


def test_a_period_out_of_a_file_is_a_float(record):
    whole = gsid.frf(record, period=N, settle=0)
    np.testing.assert_array_equal(gsid.frf(record, period=np.float64(N), settle=0.0).g, whole.g)
    stated = Record(
        record.u, record.y, np.float32(FS_HZ), period_samples=float(N), settle_samples=np.array(0.0)
    )
    np.testing.assert_array_equal(gsid.frf(stated).g, whole.g)
    assert isinstance(stated.period_samples, int)
    with pytest.raises(ValueError, match=r"period_samples must be a whole number of samples, got 500\.5"):
        Record(record.u, record.y, FS_HZ, period_samples=500.5)
    with pytest.raises(TypeError, match="settle must be a number"):
        gsid.frf(record, settle="2 s")
    with pytest.raises(ValueError, match="period must be a whole number"):
        gsid.noise(record, period=np.nan)


@pytest.mark.parametrize("u", [np.ones(9) * 1j, ["a", "b"], None])
def test_samples_are_real_numbers(u):
    with pytest.raises(InputError, match=r"u (is complex|does not hold numbers|is not one row)"):
        Record(u, np.ones(9), FS_HZ)


def test_a_sample_rate_is_a_number(tmp_path):
    with pytest.raises(TypeError, match=r"fs_hz must be a number \[Hz\], got '1 kHz'"):
        Record(np.ones(9), np.ones(9), "1 kHz")
    with pytest.raises(TypeError, match="the sample rate must be a number"):
        Multisine.design("1000", N, (2, 200))
    np.savez(tmp_path / "rec.npz", u=np.ones(9), y=np.ones(9))
    with pytest.raises(TypeError, match="fs_hz must be a number"):
        read_record(tmp_path / "rec.npz", fs_hz="1000")


def another(record):
    """A second realisation: its samples are not the same."""
    return replace(record, y=1.01 * record.y)


@pytest.mark.parametrize("band", ["2:200", 200, (2, "200"), (2, 100, 200)])
def test_a_band_is_two_numbers(record, band):
    response = gsid.frf(record)
    for call in (
        lambda: gsid.frf(record, band=band),
        lambda: gsid.frf(record, band=band, window=256),
        lambda: gsid.distortion([record, another(record)], band=band),
        lambda: gsid.fit(response, "1/0", band=band),
        lambda: gsid.compare(gsid.fit(response, "1/0"), record, band=band),
        lambda: Multisine.design(FS_HZ, N, band),
    ):
        with pytest.raises(TypeError, match=r"a band is two frequencies \(lo, hi\) \[Hz\]"):
            call()


def test_a_band_upside_down(record):
    with pytest.raises(ValueError, match="lo below hi, got 200:2"):
        gsid.frf(record, band=(200, 2))
    with pytest.raises(ValueError, match="lo below hi, got 200:2"):
        gsid.fit(gsid.frf(record), "1/0", band=(200, 2))


def test_what_is_no_record_or_no_response(record):
    response = gsid.frf(record)
    model = gsid.fit(response, "1/0")
    for call, told in (
        (lambda: gsid.frf(None), "got NoneType"),
        (lambda: gsid.frf(Multisine.design(FS_HZ, N, (2, 200))), "got Multisine"),
        (lambda: gsid.frf([record.u, record.y]), r"got ndarray; Record\(u, y, fs_hz\) makes one"),
        (lambda: gsid.compare(model, response), "got Frf"),
        (lambda: gsid.compare(record, model), "got RationalModel"),
        (lambda: gsid.fit(record.y, "1/0"), r"an Frf, got ndarray; frf\(record\) estimates it"),
        (lambda: gsid.fit(model, "1/0"), "an Frf, got RationalModel"),
        (lambda: gsid.noise([record]), "one Record at a time, got list"),
    ):
        with pytest.raises(TypeError, match=told):
            call()


def test_a_record_is_fitted_with_the_defaults_of_frf(record):
    for given in (record, [record], [record, another(record)], gsid.spectra(record)):
        model, expected = gsid.fit(given, "1/0"), gsid.fit(gsid.frf(given), "1/0")
        np.testing.assert_array_equal(model.num, expected.num)
        np.testing.assert_array_equal(model.cov, expected.cov)
    with pytest.raises(TypeError, match="an Frf, got list"):
        gsid.fit([record, "b.csv"], "1/0")


def test_a_delay_is_seconds(record, caplog):
    response = gsid.frf(record)
    with pytest.raises(ValueError, match="number of seconds, got True"):
        gsid.fit(response, "1/0", delay=True)
    with pytest.raises(ValueError, match="number of seconds, got nan"):
        gsid.fit(response, "1/0", delay=np.nan)
    assert "delay" not in caplog.text  # what else is noted is not of interest
    gsid.fit(response, "1/0", delay=2.0)  # meant as ms
    assert "the delay of 2 s is not shorter than the period" in caplog.text


def test_random_phases_want_a_whole_seed():
    for seed in (None, 1.5, -1):
        with pytest.raises(ValueError, match=f"the seed must be a whole number within .*, not {seed}"):
            Multisine.design(FS_HZ, N, (2, 200), phases="random", seed=seed)


def test_the_verbs_of_the_command_are_functions(record):
    assert len(gsid.distortion([record, another(record)]).responses) == 2
    assert gsid.select_order(gsid.frf(record), ["1/0", "2/1"]).chosen.order


@pytest.mark.parametrize("period", [N - 1, N + 1, N])
def test_a_period_that_slips_is_reported(caplog, period):
    """Generator and recorder without a common clock, or a period that is off by one: half of the lines went,
    and errors were four times their sigma; nothing was said."""
    # 0.02 samples per period are 40 ppm, the difference of two ordinary quartzes
    slow = 0.02 if period == N else 0.0
    time = np.arange(8 * N) * N / (N + slow)
    lines = np.arange(1, 40, 2)
    u = np.cos(2 * np.pi * np.outer(time, lines) / N + lines**2).sum(axis=1)
    noisy = u + np.random.default_rng(2).normal(0, 0.01, len(u))
    gsid.frf(Record(noisy, u, FS_HZ, name="rig"), period=period)
    (told,) = re.findall(r"rig: u repeats every ([0-9.]+) samples, not (\d+)", caplog.text)
    assert float(told[0]) == pytest.approx(N + slow, abs=0.005)  # a quarter of the slip
    assert int(told[1]) == period
    assert (f"give {N}," in caplog.text) == (period != N)


def test_a_correct_period_is_not_reported_to_slip(caplog):
    lines = np.arange(1, 40, 2)
    clean = np.tile(np.cos(2 * np.pi * np.outer(np.arange(N), lines) / N + lines**2).sum(axis=1), 5)
    for seed in range(200):
        u = clean + np.random.default_rng(seed).normal(0, 1.0, len(clean))
        gsid.spectra(Record(u, clean, FS_HZ), period=N, settle=0)
    # 99.9 % intervals, which the periods that two pairs share make wider: 0.2 alarms of 200 at most
    assert caplog.text.count("u repeats") <= 2


def test_the_slip_of_two_periods_has_no_interval():
    late, half_width = slip(np.ones((2, 9), complex), N)
    assert late == 0
    assert np.isinf(half_width)


def test_stamps_that_jitter_are_even_where_the_rate_is_given(tmp_path, record):
    path = tmp_path / "rec.csv"

    def write(t):
        np.savetxt(
            path, np.column_stack([t, record.u, record.y]), delimiter=",", header="t_s,u,y", comments=""
        )

    t = np.arange(len(record)) / FS_HZ
    write(t + np.random.default_rng(3).uniform(-2e-4, 2e-4, len(t)))
    with pytest.raises(InputError, match="unequal time steps") as caught:
        read_record(path)
    assert "give the rate with --fs" in caught.value.hint
    assert read_record(path, fs_hz=FS_HZ).fs_hz == FS_HZ
    with pytest.raises(InputError, match="does not match the times"):
        read_record(path, fs_hz=2 * FS_HZ)
    write(np.where(t < 0.5, t, t + 1 / FS_HZ))  # a sample is missing
    with pytest.raises(InputError, match="unequal time steps"):
        read_record(path, fs_hz=FS_HZ)


def test_an_imported_response_reports_what_it_lacks(record):
    # each was a status of the core: "a configuration value is out of its range"
    response = gsid.frf(record)

    def given(**facts):
        return Frf.from_arrays(response.f_hz, response.g, response.var_g, **facts)

    for options in ({"domain": "z"}, {"hold": "zoh"}):
        with pytest.raises(ValueError, match=r"needs the sample rate of the response: Frf.from_arrays"):
            gsid.fit(given(), "1/0", **options)
        with pytest.raises(ValueError, match="at 100 Hz needs lines below 50 Hz; the highest is at 198 Hz"):
            gsid.fit(given(fs_hz=100.0), "1/0", **options)
    with pytest.raises(ValueError, match=r"line 1 of the response is \(?nan"):
        Frf.from_arrays([1.0, 2.0], [1.0, np.nan])
    with pytest.raises(ValueError, match=r"line 0 of the response is .* at -1"):
        Frf.from_arrays([-1.0, 2.0], [1.0, 1.0])
    model = gsid.fit(response, "1/0")
    for call in (lambda: model.plot(record), lambda: validate(model, record)):
        with pytest.raises(TypeError, match="an Frf, got Record"):
            call()
