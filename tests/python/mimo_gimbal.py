"""A gimbal of four axes with cross-coupling, in physical coordinates; shares no code with the models.

    M q'' + C q' + K q = u(t - delay of the input),   y = q' + what each gyro sees of the others

The responses are solved for line by line with numpy, records are made of exact steady state and noise that is
correlated from output to output.
"""

import numpy as np

from gsid.records.mimo import MimoRecord

FS_HZ, N, TOP_HZ = 2000.0, 2000, 240
INERTIA = np.array(
    [[1.0, 0.12, 0.0, 0.05], [0.12, 1.4, 0.2, 0.0], [0.0, 0.2, 0.8, 0.1], [0.05, 0.0, 0.1, 1.1]]
)
STIFFNESS = (2 * np.pi) ** 2 * np.array(
    [[900.0, -60.0, 0, 0], [-60, 5600, -700, 0], [0, -700, 9000, -900], [0, 0, -900, 31000]]
)
GYROS = np.eye(4) + 0.03 * np.array([[0, 1, -1, 0], [1, 0, 0, 2], [0, -1, 0, 1], [2, 0, 1, 0]])
DELAY_S = np.array([1.3e-3, 2.1e-3, 1.6e-3, 2.45e-3])  # of each input
SIGNS = np.array([[1, 1, 1, 1], [1, -1, 1, -1], [1, 1, -1, -1], [1, -1, -1, 1]])
NOISE = np.linalg.cholesky(np.eye(4) + 0.5 * (np.ones((4, 4)) - np.eye(4)))


def damping():
    """Viscous, and a little of the stiffness: every mode has a damping of its own."""
    return 4.0 * np.eye(4) + 1.2e-4 * STIFFNESS


def true_poles() -> np.ndarray:
    """Of the state matrix, rad/s."""
    inverse = np.linalg.inv(INERTIA)
    a = np.block([[np.zeros((4, 4)), np.eye(4)], [-inverse @ STIFFNESS, -inverse @ damping()]])
    return np.linalg.eigvals(a)


def true_response(f_hz) -> np.ndarray:
    """(F, 4, 4)."""
    s = 2j * np.pi * np.asarray(f_hz)[:, None, None]
    g = GYROS @ np.linalg.inv(s**2 * INERTIA + s * damping() + STIFFNESS) * s
    return g * np.exp(-s * DELAY_S)


def experiments(seed: int, n_periods: int = 5, noise: float = 0.02, n_repeats: int = 1) -> list[MimoRecord]:
    """Four records of orthogonal multisines, or several times four."""
    rng = np.random.default_rng(seed)
    line = np.arange(1, TOP_HZ + 1)
    g = true_response(line * FS_HZ / N)
    level = noise * np.sqrt(np.mean(np.abs(g) ** 2))
    records = []
    for _ in range(n_repeats):
        phase = np.exp(2j * np.pi * rng.random((len(line), 4)))
        for signs in SIGNS:
            u = phase * signs
            y = np.einsum("kij,kj->ki", g, u)
            white = rng.standard_normal((n_periods, len(line), 4, 2)) @ [1, 1j] / np.sqrt(2)
            noisy = y + level * white @ NOISE.T
            records.append(
                MimoRecord(
                    np.tile(samples(u[None]), (n_periods, 1)),
                    samples(noisy),
                    FS_HZ,
                    period_samples=N,
                    settle_samples=0,
                )
            )
    return records


def samples(lines: np.ndarray) -> np.ndarray:
    """Lines 1 .. K of each period, (P, K, channels), as samples, (P N, channels)."""
    whole = np.zeros((len(lines), N // 2 + 1, lines.shape[2]), complex)
    whole[:, 1 : lines.shape[1] + 1] = lines * (N / 2)
    return np.fft.irfft(whole, N, axis=1).reshape(-1, lines.shape[2])
