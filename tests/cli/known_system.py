"""The system of the records that the command is tested on."""

import numpy as np

N_PERIOD, N_PERIODS, FS_HZ = 400, 6, 1000.0
LINES = np.arange(2, 80)


def response(f_hz):
    """Second order at 60 Hz, damping 0.1, gain 3, with a delay of 1.5 ms."""
    s, w0 = 2j * np.pi * f_hz, 2 * np.pi * 60
    return 3 * w0**2 / (s**2 + 0.2 * w0 * s + w0**2) * np.exp(-s * 1.5e-3)
