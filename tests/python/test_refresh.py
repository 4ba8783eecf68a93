"""Rate of a sensor that is read more often than it is refreshed, and the images in its response."""

import logging

import numpy as np
import pytest

import gsid
from gsid.records.refresh import refresh_rate_hz

FS_HZ, N, P, SEED = 3000.0, 3000, 4, 20261125


def multisine(rng, lines):
    """One period of lines of equal amplitude and random phases, on a grid of 1/64 sample."""
    spectrum = np.zeros(32 * N + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    return np.fft.irfft(spectrum, 64 * N) * 32 * N


def read_as(values, refresh):
    """Samples read by a controller, of a sensor that takes its values at these times [samples]."""
    at = np.concatenate([[-1.0], refresh])
    return values(at)[np.searchsorted(at, np.arange(N * P) + 1e-9, side="right") - 1]


def record_of(rng, hold, *, jitter=0.0, noise=0.02, top=250, resolution=0.0):
    """u, and y = u delayed by no time at all, through a sensor that is refreshed every `hold` samples."""
    fine = multisine(rng, np.arange(1, top + 1))
    refresh = rng.random() * hold + np.arange(int(N * P / hold) + 1) * hold
    refresh = refresh + jitter * rng.random(len(refresh))

    def values(at):
        y = fine[np.round(at * 64).astype(int) % len(fine)] + noise * rng.standard_normal(len(at))
        return np.round(y / resolution) * resolution if resolution else y

    return gsid.Record(np.tile(fine[::64], P), read_as(values, refresh), FS_HZ, N, 0)


@pytest.mark.parametrize("hold", [1.5, 2.0, 7.0, 7.5, 3000 / 400.02, 29.7])
@pytest.mark.parametrize("kind", [{}, {"jitter": 0.4}, {"resolution": 0.3}])
def test_the_rate_of_a_sensor_is_found(hold, kind):
    """To the error that rounding up to samples leaves of a straight line through the times of the changes."""
    print("seed", SEED)
    record = record_of(np.random.default_rng(SEED), hold, **kind)
    assert refresh_rate_hz(record) == pytest.approx(FS_HZ / hold, rel=1e-4)


def test_the_rate_is_found_beside_lost_samples_spikes_and_rest():
    record = record_of(np.random.default_rng(SEED), 7.5)
    record.y[5000:5300] = record.y[5000]  # at rest
    record.y[[700, 2000, 9000]] += 50.0
    record.valid[3000:3100] = False
    record.y[3000:3100] = 0.0
    assert refresh_rate_hz(record) == pytest.approx(400, rel=1e-4)


def test_no_refresh_is_seen_in_outputs_that_are_read_at_their_rate():
    """Noise, coarse outputs, an encoder at a steady speed, and values that repeat at random times."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    t = np.arange(N * P)
    for _ in range(50):
        record = record_of(rng, 1.0, noise=rng.choice([0.0, 0.02, 1.0]))
        speed, step = rng.uniform(0.02, 0.9), rng.uniform(0.1, 20)
        outputs = {
            "as it is": record.y,
            "coarse": np.round(record.y / step) * step,
            "slow and coarse": np.round(10 * np.sin(2 * np.pi * rng.uniform(1, 9) * t / N) / step) * step,
            "encoder": np.floor(speed * t + rng.random()),
            "at random": record.y[np.maximum.accumulate(np.where(rng.random(len(t)) < speed, t, 0))],
            "constant": np.zeros(len(t)),
        }
        for name, y in outputs.items():
            assert refresh_rate_hz(gsid.Record(record.u, y, FS_HZ)) is None, (name, speed, step)


def warnings_of(caplog, record, **options):
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        response = gsid.frf(record, **options)
    return response, [r.getMessage() for r in caplog.records if "refreshed" in r.getMessage()]


def test_lines_with_images_are_reported_and_no_others(caplog):
    """y = u: without images G is 1 behind the sensor, whose mean hold is a sinc with half a hold of delay."""
    record = record_of(np.random.default_rng(SEED), 7.5, noise=0.002)
    response, (text,) = warnings_of(caplog, record)
    assert "refreshed at 400 Hz" in text
    assert "101 lines from 150 to 250 Hz (50 of them above 200 Hz)" in text
    assert "band 1:149" in text
    x = response.f_hz / 400
    error = np.abs(response.g / (np.sinc(x) * np.exp(-1j * np.pi * x)) - 1)
    shown = response.f_hz >= 150
    assert np.median(error[shown]) > 0.5
    assert np.median(error[~shown]) < 0.1  # uneven holds of 7 and 8 samples: images from 200 - f
    assert not warnings_of(caplog, record, band=(1, 149))[1]
    assert warnings_of(caplog, record, band=(1, 150))[1]
    assert warnings_of(caplog, record, lpm=True)[1]


def test_no_warning_where_there_is_no_image(caplog):
    rng = np.random.default_rng(SEED)
    assert not warnings_of(caplog, record_of(rng, 1.0))[1]
    assert not warnings_of(caplog, record_of(rng, 7.5, top=190))[1]
    record = record_of(rng, 7.5)
    assert not warnings_of(caplog, gsid.Record(record.u, record.y, FS_HZ), window=1000)[1]


def test_a_closed_loop_is_warned_of_its_images(caplog):
    record = record_of(np.random.default_rng(SEED), 7.5)
    record.columns["r"] = record.u.copy()
    assert "of them above 200 Hz" in warnings_of(caplog, record, reference="r")[1][0]
