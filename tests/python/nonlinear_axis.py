"""An axis of known noise and known distortion, simulated by numpy alone: truth for tests of distortion.

A lag, a static polynomial and a lag again, all in the frequency domain: every period is in steady state.
"""

import numpy as np

from gsid.records.record import Record

FS_HZ, N, LINE = 256.0, 256, np.arange(1, 64, 2)  # odd lines: even ones show even distortion


class NonlinearAxis:
    """u -> lag at 20 Hz -> x + even x^2 + cubic x^3 -> lag at 30 Hz -> + white noise of this rms.

    With `scale` the period is as many times longer and there are as many times more lines in the same band.
    """

    def __init__(self, even=0.0, cubic=0.0, noise=0.0, rms=1.0, *, scale=1):
        self.even, self.cubic, self.noise, self.rms = even, cubic, noise, rms
        self.n = scale * N
        self.line = np.arange(1, 64 * scale, 2)
        f_hz = np.arange(self.n // 2 + 1) * FS_HZ / self.n
        self.before, self.after = 1 / (1 + 1j * f_hz / 20), 2 / (1 + 1j * f_hz / 30)

    def inputs(self, rng, m, line=None):
        """m realisations of a flat random-phase multisine, (m, n); its lines are `self.line` unless given."""
        line = self.line if line is None else line
        spectrum = np.zeros((m, self.n // 2 + 1), complex)
        spectrum[:, line] = np.exp(2j * np.pi * rng.random((m, len(line))))
        u = np.fft.irfft(spectrum, self.n)
        return u * (self.rms / np.sqrt(np.mean(u[0] ** 2)))

    def output(self, u):
        """One period of the steady state without noise, (m, n)."""
        x = np.fft.irfft(np.fft.rfft(u) * self.before, self.n)
        return np.fft.irfft(np.fft.rfft(x + self.even * x**2 + self.cubic * x**3) * self.after, self.n)

    def record(self, rng, u, p):
        """p periods of the input u (n,), with noise."""
        y = np.tile(self.output(u[None])[0], p) + self.noise * rng.standard_normal(p * self.n)
        return Record(np.tile(u, p), y, FS_HZ, self.n, 0)

    def records(self, rng, m, p):
        """m records of p periods each, with noise."""
        return [self.record(rng, u, p) for u in self.inputs(rng, m)]

    def responses(self, rng, m, p):
        """Response of each period of each realisation, (m, p, F)."""
        u = self.inputs(rng, m)
        y = self.output(u)[:, None] + self.noise * rng.standard_normal((m, p, self.n))
        return np.fft.rfft(y)[..., self.line] / np.fft.rfft(u)[:, None, self.line]

    def truth(self, m=8000, seed=99):
        """Best linear approximation and standard deviation of a realisation's response, (F,) each."""
        u = self.inputs(np.random.default_rng(seed), m)
        g = np.fft.rfft(self.output(u))[:, self.line] / np.fft.rfft(u)[:, self.line]
        return g.mean(axis=0), np.sqrt(np.mean(np.abs(g - g.mean(axis=0)) ** 2, axis=0))

    def noise_std(self, p):
        """Standard deviation of a realisation's response by noise after p periods, the same at every line."""
        amplitude = self.rms * np.sqrt(2 / len(self.line))
        return self.noise * 2 / np.sqrt(self.n) / amplitude / np.sqrt(p)


def coverage(axis, m, p, repeats, seed):
    """How often the 95 % intervals cover the truth, (F,) each, and the mean of M (s2_BLA - s2_BLA,n)."""
    from gsid.response.estimate_distortion import from_responses

    _, truth_nonlinear = axis.truth()
    truth = {"std_noise": axis.noise_std(p) / np.sqrt(m), "std_nonlinear": truth_nonlinear}
    rng = np.random.default_rng(seed)
    covered = {name: np.zeros(len(axis.line), int) for name in truth}
    variance = np.zeros(len(axis.line))
    for _ in range(repeats):
        d = from_responses(axis.line, axis.responses(rng, m, p))
        variance += m * (d.var_total - d.var_noise) / repeats
        for name, (low, high) in d.intervals().items():
            covered[name] += (low <= truth[name]) & (truth[name] <= high)
    return covered, variance, truth
