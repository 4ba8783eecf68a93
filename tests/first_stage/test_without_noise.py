"""Records of a simulation without noise: their periods are the same, and their variances zero."""

import warnings

import numpy as np

import gsid
from gsid.excitation.multisine import Multisine

SEED = 20261123
FS_HZ, N, SETTLE = 1000.0, 1000, 2


def position_servo(reference):
    """Command and angle [counts] of a position servo with dry friction, by semi-implicit steps."""
    steps, level = 10, 60.0
    angle = rate = before = 0.0
    command, counts = np.zeros((2, len(reference)))
    for n, wanted in enumerate(reference):
        counts[n] = np.round(angle * 2600)
        command[n] = 3e-3 * (wanted - counts[n]) - 1e-4 * FS_HZ * (counts[n] - before)
        before = counts[n]
        for _ in range(steps):
            torque = 400.0 * command[n] - 3.0 * rate
            if rate == 0.0 and abs(torque) <= level:
                continue
            friction = level * np.sign(rate or torque)
            new = rate + (torque - friction) / (FS_HZ * steps)
            rate = 0.0 if new * rate < 0 else new
            angle += rate / (FS_HZ * steps)
    return command, counts


def test_bug_a_simulated_loop_without_noise_ended_in_infinite_numbers():
    """The weights were 1e154: overflows, and with some loops `array must not contain infs or NaNs`."""
    print("seed", SEED)
    design = Multisine.design(FS_HZ, N, (1, 20), grid="odd", rms=1200.0, phases="random", seed=SEED)
    reference = np.round(np.tile(design.table(), 4 + SETTLE))
    command, counts = position_servo(reference)
    assert np.array_equal(counts[-N:], counts[-2 * N : -N])
    columns = {"r": reference}
    record = gsid.Record(command, counts, FS_HZ, N, SETTLE * N, hold="zoh", columns=columns)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = gsid.diagnose_records(record, output="angle", reference="r", fast=True)
    assert found.verdict != "adequate"
