"""Distortion of several inputs and outputs: null rates, a closed form, and the gimbal with one rough axis.

Seeds are printed with the figures that depend on them.
"""

import numpy as np
import pytest
from scipy import stats

from gsid.base.errors import InputError
from gsid.excitation.orthogonal import orthogonal_multisines
from gsid.records.mimo import MimoRecord
from gsid.response.mimo import frf_mimo
from gsid.response.mimo_distortion import distortion_mimo
from gsid.rig.gimbal import Gimbal

pytestmark = pytest.mark.xdist_group("gimbal")

FS_HZ, N, P = 100.0, 200, 3
MIX = np.array([[1.0, 0.4, 0.0], [-0.3, 0.8, 0.2], [0.1, 0.0, 1.2]])  # y = MIX torque
CHOLESKY = np.linalg.cholesky(np.eye(3) + 0.6 * (np.ones((3, 3)) - np.eye(3)))  # of noise, between outputs


def excitation(seed, n_realisations=2, **options):
    how = {"n_realisations": n_realisations, "seed": seed} | options
    return orthogonal_multisines(FS_HZ, N, (1.0, 20.0), (1.0, 0.5, 2.0), **how).periods


def measured(u, torque, seed, noise=1.0):
    """Records of P periods of MIX times the torque, with noise that is correlated between the outputs."""
    rng = np.random.default_rng(seed)
    records = []
    for one, own in zip(u, torque, strict=True):
        y = np.tile(own @ MIX.T, (P, 1)) + noise * rng.standard_normal((P * N, 3)) @ CHOLESKY.T
        how = {"period_samples": N, "settle_samples": 0, "hold": "zoh"}
        records.append(MimoRecord(np.tile(one, (P, 1)), y, FS_HZ, **how))
    return records


def test_a_linear_plant_is_flagged_in_at_most_one_case_of_a_hundred():
    seeds = range(400, 480)
    flagged = 0
    for seed in seeds:
        u = excitation(seed)
        d = distortion_mimo(measured(u, u, seed))
        flagged += bool(d.distorted_inputs or d.distorted_outputs)
    print(
        f"seeds {seeds}: {flagged} of {len(seeds)} flagged; the stated rate is 1 % of all channels together"
    )
    assert flagged <= stats.binom.ppf(1 - 1e-4, len(seeds), 0.01)


def test_the_ratio_of_total_and_noise_is_fisher_s_at_every_line_of_every_channel():
    """Exact for any inputs: 2 (M - 1) n_u and 2 M n_u (P - 1) degrees of freedom."""
    ratios = []
    for seed in range(25):
        u = excitation(seed)
        records = measured(u, u, seed)
        d = distortion_mimo(records)
        noise = np.array([one.level_noise**2 for one in d.outputs])
        total = np.array([one.level**2 for one in d.outputs])
        ratios.append(total[total > 0] / noise[total > 0] + 1)
    ratios = np.concatenate(ratios)
    law = stats.f(2 * 3, 2 * 6 * (P - 1))
    above = (law.cdf(ratios) - law.cdf(1)) / law.sf(1)  # a ratio below 1 is the level 0
    p = stats.kstest(above, "uniform").pvalue
    print(f"seeds 0 .. 24: {len(ratios)} ratios, p = {p:.3g}")
    assert p > 1e-3


def test_the_level_of_a_product_of_two_inputs_is_its_closed_form():
    """torque1 = u1 + a u1 u2: line k has a A1 A2 / 2 of each pair of lines with sum or difference k."""
    a, size = 0.05, 0.5 * 0.5
    power = {"level": 0.0, "other": 0.0}
    seeds = range(20)
    for seed in seeds:
        u = excitation(seed)
        torque = u.copy()
        torque[..., 0] += a * u[..., 0] * u[..., 1]
        d = distortion_mimo(measured(u, torque, seed, noise=1e-3))
        power["level"] = power["level"] + d.inputs[0].level ** 2 / len(seeds)
        power["other"] = power["other"] + d.inputs[1].level ** 2 / len(seeds)
    line = np.round(d.f_hz * N / FS_HZ).astype(int)
    first, second = np.meshgrid(line, line)
    pairs = np.array([np.sum(first + second == k) + np.sum(np.abs(first - second) == k) for k in line])
    expected = (a * size) ** 2 * pairs
    ratio = np.mean(power["level"] / expected)
    print(f"seeds {seeds}: level^2 over the closed form {ratio:.4f}")
    assert ratio == pytest.approx(1, abs=0.08)  # 39 lines, 20 seeds, 3 degrees of freedom: 2 %
    assert np.mean(power["other"]) < 0.01 * np.mean(expected)


def test_a_product_enters_at_one_input_and_shows_at_the_outputs_that_it_drives():
    u = excitation(5, n_realisations=3)
    torque = u.copy()
    torque[..., 0] += 0.3 * u[..., 0] * u[..., 1]
    d = distortion_mimo(measured(u, torque, 5, noise=0.3))
    assert d.distorted_inputs == ["u1"]
    assert d.distorted_outputs == ["y1", "y2", "y3"]  # MIX[:, 0] has no zero
    assert "It enters at the input u1" in d.verdict


def test_one_realisation_shows_distortion_at_free_lines():
    u = excitation(2, n_realisations=1, grid="odd-random")
    torque = u.copy()
    torque[..., 1] += 0.6 * u[..., 1] ** 2
    d = distortion_mimo(measured(u, torque, 2, noise=0.3))
    assert d.distorted_inputs == ["u2"]
    assert {band.kind for band in d.inputs[1].bands} <= {"even", "noise"}
    assert np.all(np.isnan(d.std_nonlinear))


@pytest.mark.parametrize(
    ("n_records", "n_realisations", "message"),
    [(3, 1, "one realisation does not show distortion"), (4, 2, "not whole realisations")],
)
def test_what_cannot_be_separated_is_refused(n_records, n_realisations, message):
    u = excitation(0, n_realisations)[:n_records]
    with pytest.raises(InputError, match=message):
        distortion_mimo(measured(u, u, 0))


def test_more_outputs_than_inputs_are_not_referred_to_the_inputs():
    records = measured(excitation(3), excitation(3), 3)
    fewer = [MimoRecord(r.u[:, :2], r.y, FS_HZ, period_samples=N, settle_samples=0) for r in records]
    d = distortion_mimo(fewer)
    assert d.inputs == []
    assert d.n_realisations == 3
    assert d.bla.shape[1:] == (3, 2)


# ---- the gimbal of four axes -----------------------------------------------------------------------------

ROUGH, PERIODS = "u2", 3
AMPLITUDE = (0.1, 0.04, 0.008, 0.003)  # about the same acceleration at each axis


@pytest.fixture(scope="module")
def motions():
    """Exact periodic rates without friction, and with friction of the outer elevation; one run of both."""
    u = orthogonal_multisines(250.0, 250, (2.0, 100.0), AMPLITUDE, n_realisations=2, seed=11).periods
    plants = {"smooth": Gimbal(fs_hz=250.0), "rough": Gimbal(fs_hz=250.0, friction_nm=(0, 0.03, 0, 0))}
    found = {name: plant.simulate(np.tile(u, (1, 3, 1)))[0][:, -250:] for name, plant in plants.items()}
    return u, found


def noisy(motions, name, seed):
    u, found = motions
    rng = np.random.default_rng(seed)
    y = np.tile(found[name], (1, PERIODS, 1))
    y = y + 0.05 * rng.standard_normal(y.shape)
    how = {"period_samples": 250, "settle_samples": 0, "hold": "zoh"}
    pairs = zip(np.tile(u, (1, PERIODS, 1)), y, strict=True)
    return [MimoRecord(*pair, 250.0, **how) for pair in pairs]


def test_the_matrix_and_its_cross_coupling_are_within_three_sigma(motions):
    """At least 95 % of the lines of each of the 16 responses; and 95 % circles of Fisher's F hold 95 %."""
    within, circle = [], []
    for seed in range(5):
        found = frf_mimo(noisy(motions, "smooth", seed))
        t = np.abs(found.g - Gimbal(fs_hz=250.0).linear_response(found.f_hz)) ** 2 / found.var_g
        within.append(np.mean(t < 9, axis=0))
        circle.append(np.mean(t < stats.f.ppf(0.95, 2, 2 * found.dof)))
    print(
        f"seeds 0 .. 4: lowest share within 3 sigma {np.min(within):.3f}, within 95 % {np.mean(circle):.4f}"
    )
    assert np.min(within) >= 0.95
    assert np.mean(circle) == pytest.approx(0.95, abs=0.01)  # 16 x 99 x 5 responses: 4 sd are 0.01
    coupled = np.abs(found.g) > 3 * np.sqrt(found.var_g)
    assert np.sum(np.mean(coupled, axis=0) > 0.05) >= 4 + 8  # it measures the coupling too, 8 of 12 at least


def test_only_the_axis_with_friction_is_flagged(motions):
    found = [distortion_mimo(noisy(motions, "rough", seed)) for seed in range(10)]
    print("seeds 0 .. 9:", [one.distorted_inputs for one in found])
    assert [one.distorted_inputs for one in found] == [[ROUGH]] * len(found)
    assert all(len(one.distorted_outputs) > 1 for one in found)  # the coupling takes it to other gyros


def test_no_axis_is_flagged_without_friction(motions):
    found = [distortion_mimo(noisy(motions, "smooth", seed)) for seed in range(10)]
    print("seeds 0 .. 9:", [one.distorted_inputs + one.distorted_outputs for one in found])
    assert sum(bool(one.distorted_inputs or one.distorted_outputs) for one in found) <= 1
