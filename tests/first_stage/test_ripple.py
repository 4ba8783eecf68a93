"""The period over the position of what a law leaves, on errors of a known period and share."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import rfft

from gsid.diagnosis.from_records import ripple
from gsid.diagnosis.from_records.ripple import remaining_ripple

N, PERIOD, SHARE = 4096, 0.7, 0.4
TRAVEL = 20.0


def part(amplitude, seed, angle=None):
    """A record of noise of unit power, and of a sine of the angle as its torque."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) / N
    angle = TRAVEL / 2 * np.sin(2 * np.pi * t) + 0.3 * np.cos(6 * np.pi * t) if angle is None else angle
    line = np.arange(1, 700)
    noise = (rng.standard_normal(len(line)) + 1j * rng.standard_normal(len(line))) / np.sqrt(2)
    entry = np.exp(1j * rng.uniform(0, 6, len(line)))
    wave = rfft(np.sin(2 * np.pi * angle / PERIOD + 0.8))[line] * entry
    error = noise + amplitude * wave * np.sqrt(len(line) / np.sum(np.abs(wave) ** 2))
    rate = np.abs(np.gradient(angle))
    return ripple._Part(error, entry, line, angle, rate[rate > 0.01 * rate.max()], 700.0 / N)


def found(monkeypatch, *parts):
    of_record = iter(parts)
    monkeypatch.setattr(ripple._Part, "of", staticmethod(lambda *_: next(of_record)))
    return remaining_ripple(SimpleNamespace(angle_unit="deg"), parts, None)


def test_the_period_and_its_share_are_those_of_the_error(monkeypatch):
    """The share s of a power s / (1 - s) beside noise of unit power: within three standard deviations."""
    amplitude = np.sqrt(SHARE / (1 - SHARE))
    answer = found(monkeypatch, part(amplitude, 1), part(amplitude, 2))
    assert answer.period == pytest.approx(PERIOD, rel=2e-3)
    assert answer.unit == "deg"
    n = 2 * 2 * 699
    assert answer.share == pytest.approx(SHARE, abs=3 * np.sqrt(2 * SHARE / n) + 2 / n)


def test_noise_has_no_period(monkeypatch):
    assert all(found(monkeypatch, part(0.0, seed)) is None for seed in range(8))


def test_where_no_period_fits_in_the_lines_none_is_tried(monkeypatch):
    """Two lines over a steady turn: the finest period is half of the travel, where a spring would do it."""
    steady = part(1.0, 3, angle=np.linspace(0.0, TRAVEL, N))
    assert found(monkeypatch, replace(steady, highest_hz=2.0 / N)) is None


def test_one_of_many_periods_does_not_stand_out(monkeypatch):
    """A torque that depends on the position at random, the same in both records, has all periods."""
    torque = np.random.default_rng(11).standard_normal(1400)
    at = np.linspace(-0.55 * TRAVEL, 0.55 * TRAVEL, len(torque))
    parts = [part(0.0, seed) for seed in (1, 2)]
    parts = [
        replace(one, error=one.error + rfft(np.interp(one.angle, at, torque))[one.line] * one.entry)
        for one in parts
    ]
    assert found(monkeypatch, *parts) is None
    monkeypatch.setattr(ripple, "STANDS_OUT", 0.0)
    assert found(monkeypatch, *parts) is not None  # more than noise would have
