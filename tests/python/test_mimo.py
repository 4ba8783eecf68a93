"""Matrices of responses with common poles: measured, fitted, and how far their intervals go."""

from dataclasses import replace

import mimo_coverage as coverage
import mimo_gimbal as gimbal
import numpy as np
import pytest
from scipy import signal

import gsid
from gsid.base.errors import GsidError, InputError
from gsid.cli.main import main
from gsid.fitting.mimo import fit_mimo
from gsid.models.mimo import MimoModel
from gsid.records.mimo import MimoRecord
from gsid.response.mimo import MimoFrf, frf_mimo


def nearest(poles, true):
    """Each true pole's neighbour, upper half plane."""
    true = true[true.imag > 0]
    return np.array([np.argmin(np.abs(poles - p)) for p in true]), true


@pytest.fixture(scope="module")
def exact():
    """The gimbal's responses without noise, on the lines of a record."""
    f = np.arange(1.0, 241.0)
    g = gimbal.true_response(f)
    return MimoFrf.from_arrays(f, g, np.full((len(f), 4), 1e-8), fs_hz=gimbal.FS_HZ)


@pytest.fixture(scope="module")
def model(exact):
    return fit_mimo(exact, "8/7")


def test_exact_responses_give_the_exact_model(exact, model):
    assert model.converged
    assert model.stable
    where, true = nearest(model.poles, gimbal.true_poles())
    np.testing.assert_allclose(model.poles[where], true, rtol=1e-6)
    np.testing.assert_allclose(model.delay_s, np.tile(gimbal.DELAY_S, (4, 1)), atol=1e-8)
    assert not model.ill_determined_delays.any()
    np.testing.assert_allclose(model.response(exact.f_hz), exact.g, rtol=0, atol=1e-7 * np.abs(exact.g).max())


def test_the_matrix_of_responses_is_measured():
    """Errors of 3840 numbers over their sample variance: 16/15 on average, sd about 0.03."""
    measured = frf_mimo(gimbal.experiments(7))
    assert (measured.source, measured.dof) == ("periods", 16)
    error = np.abs(measured.g - gimbal.true_response(measured.f_hz)) ** 2 / measured.var_g
    assert np.mean(error) == pytest.approx(16 / 15, abs=0.1)


def test_more_experiments_than_inputs_measure_their_own_scatter():
    """Sixteen experiments: 12 degrees of freedom, errors over their sample variance 12/11 on average."""
    measured = frf_mimo(gimbal.experiments(8, n_periods=2, n_repeats=4))
    assert (measured.source, measured.dof, measured.n_experiments) == ("experiments", 12, 16)
    error = np.abs(measured.g - gimbal.true_response(measured.f_hz)) ** 2 / measured.var_g
    assert np.mean(error) == pytest.approx(12 / 11, abs=0.1)


def test_a_lost_sample_spoils_its_period_only():
    experiments = gimbal.experiments(7)
    second = experiments[1]
    second.valid = np.arange(len(second.u)) != 2 * gimbal.N + 17
    second.y[~second.valid] = 1e6
    measured = frf_mimo(experiments)
    assert (measured.n_periods, measured.dof) == (19, 15)
    error = np.abs(measured.g - gimbal.true_response(measured.f_hz)) ** 2 / measured.var_g
    assert np.mean(error) == pytest.approx(15 / 14, abs=0.1)


@pytest.mark.parametrize("slow", [0, 1])
def test_settling_is_that_of_the_slowest_output(slow):
    """Bug: it was judged on the first output alone, so that the order of the outputs changed the answer.

    One output follows at once, the other by a pole that decays by 0.37 a period: periods 0 to 5 or so stand
    out of noise of 1e-3. One input rests in each experiment.
    """
    rng, n, n_periods = np.random.default_rng(9), 200, 24
    records, pole = [], np.exp(-1 / n)
    for moving in (0, 1):
        u = np.zeros((n_periods * n, 2))
        u[:, moving] = np.tile(rng.standard_normal(n) + 1, n_periods)
        y = np.empty_like(u)
        y[:, 1 - slow] = u @ [1.0, 2.0]
        y[:, slow] = signal.lfilter([1 - pole], [1, -pole], u @ [3.0, 1.0])
        records.append(MimoRecord(u, y + 1e-3 * rng.standard_normal(y.shape), 200.0, period_samples=n))
    measured = frf_mimo(records)
    assert 4 * 2 <= 2 * n_periods - measured.n_periods <= 10 * 2
    z = np.exp(2j * np.pi * measured.f_hz / 200.0)
    true = ((1 - pole) / (1 - pole / z))[:, None] * [3.0, 1.0]
    error = np.abs(measured.g[:, slow] - true) ** 2 / measured.var_g[:, slow]
    assert np.mean(error) == pytest.approx(1, abs=0.3)  # of 198 numbers: sd 0.07


def test_more_parameters_than_the_covariance_is_for(exact):
    with pytest.raises(ValueError, match="16 responses have 1086 parameters"):
        fit_mimo(exact, "62/62", domain="z")


def test_too_few_experiments():
    with pytest.raises(InputError, match="fewer experiments than inputs"):
        frf_mimo(gimbal.experiments(7)[:3])


def same_inputs_at(experiments, line):
    """The experiments, with the inputs and outputs of the second those of the first at these lines."""
    first, second = experiments[:2]
    n = first.period_samples
    changed = []
    for mine, theirs in ((second.u, first.u), (second.y, first.y)):
        spectra = [np.fft.rfft(x.reshape(-1, n, x.shape[1]), axis=1) for x in (mine, theirs)]
        periods = min(len(one) for one in spectra)
        spectra[0][:periods, line] = spectra[1][:periods, line]
        changed.append(np.fft.irfft(spectra[0], n, axis=1).reshape(-1, mine.shape[1]))
    return [first, replace(second, u=changed[0], y=changed[1]), *experiments[2:]]


def test_one_line_that_is_not_separated_is_masked(caplog):
    """A fault: one line of a condition number over 100 refused the whole measurement."""
    whole = frf_mimo(gimbal.experiments(7))
    measured = frf_mimo(same_inputs_at(gimbal.experiments(7), whole.line[[4, 9]]))
    assert measured.masked_hz == pytest.approx(whole.f_hz[[4, 9]])
    assert (measured.n_masked, whole.n_masked) == (2, 0)
    assert np.isfinite(measured.g).all()
    assert np.isfinite(measured.var_g).all()
    kept = np.delete(np.arange(len(whole.line)), [4, 9])
    np.testing.assert_allclose(measured.g, whole.g[kept], rtol=1e-6)
    assert "do not separate the inputs there: 2 (" in caplog.text


def test_fewer_than_half_of_the_lines_is_refused():
    whole = frf_mimo(gimbal.experiments(7))
    line = whole.line[: len(whole.line) // 2 + 1]
    with pytest.raises(InputError, match=f"at {len(line)} of {len(whole.line)} lines"):
        frf_mimo(same_inputs_at(gimbal.experiments(7), line))


def test_the_same_experiment_again_has_no_power():
    first = gimbal.experiments(7)[0]
    with pytest.raises(InputError, match="cannot be separated"):
        frf_mimo([first] * 4)


def test_a_model_file_keeps_the_model(exact, model, tmp_path):
    model.save(tmp_path / "m.json")
    again = gsid.load_model(tmp_path / "m.json")
    np.testing.assert_array_equal(again.response(exact.f_hz), model.response(exact.f_hz))
    np.testing.assert_array_equal(again.response_std(exact.f_hz), model.response_std(exact.f_hz))
    assert again.inputs == ["u1", "u2", "u3", "u4"]


def test_a_channel_is_a_rational_model(exact, model):
    for i, j in ((0, 0), (3, 1)):
        one = model.channel(i, j).response(exact.f_hz)
        np.testing.assert_allclose(one, model.response(exact.f_hz)[:, i, j], rtol=1e-7)


SEEDS = range(3)  # the study has many: `make coverage-mimo`


def test_a_gimbal_of_four_axes_is_recovered_within_its_intervals():
    """Of poles, delays and responses of noisy measurements, 95 % lie within their intervals.

    Numbers of one seed depend on each other, so that they count for half as many: the bound is that of a
    binomial of so many trials, at 1e-4 both sides together. `make coverage-mimo` counts each over many seeds.
    """
    print("seeds", SEEDS)
    seeds = [coverage.deviations(seed) for seed in SEEDS]
    held = [coverage.inside(one) for one in seeds]
    for kind in ("poles", "delays", "responses"):
        counts = np.concatenate([one[kind][np.isfinite(one[kind])] for one in held])
        n = counts.size // 2
        low, _ = coverage.bounds(n)
        assert counts.mean() >= low / n, f"{kind}: {counts.mean():.3f} of {counts.size}"
        # No wrong minimum anywhere: of 360 normal numbers the largest is below 5 but once in 4800.
        assert np.nanmax(np.abs([one[kind] for one in seeds])) < 5


def test_the_lowest_minimum_over_a_delay_is_taken():
    """Bug: a minimum lower by less than 1e-3 of the cost was left alone, 20 standard deviations away.

    Seed 64 ended at 3.20 ms, where the true 2.1 ms, put in its place, cost less.
    """
    frf = frf_mimo(gimbal.experiments(64))
    model = fit_mimo(frf, "8/7")
    delay_s = model.delay_s.copy()
    delay_s[3, 1] = gimbal.DELAY_S[1]
    assert model.cost <= fit_mimo(frf, "8/7", delay=delay_s).cost
    assert abs(model.delay_s[3, 1] - gimbal.DELAY_S[1]) < 5 * model.std_delay_s[3, 1]


def test_a_delay_that_the_data_do_not_determine_is_reported(capsys, tmp_path):
    """Bug: seed 15 has its lowest minimum at 3.27 ms, one near the true 2.1 ms, and nothing said so."""
    names = ["u1", "u2", "u3", "u4", "y1", "y2", "y3", "y4"]
    files = [str(tmp_path / f"{e}.npz") for e in range(4)]
    facts = {"fs_hz": gimbal.FS_HZ, "period_samples": gimbal.N, "settle_samples": 0}
    for file, record in zip(files, gimbal.experiments(15), strict=True):
        np.savez(file, **dict(zip(names, np.hstack([record.u, record.y]).T, strict=True)), **facts)
    channels = ("--u", ",".join(names[:4]), "--y", ",".join(names[4:]))
    assert main(["fit", *files, *channels, "--order", "8/7", "-o", str(tmp_path / "m.json")]) == 0
    said = capsys.readouterr()
    model = gsid.load_model(tmp_path / "m.json")
    assert np.argwhere(model.ill_determined_delays).tolist() == [[3, 1]]
    std = model.std_delay_s[3, 1]
    near, far = model.delay_range_s[3, 1]
    assert abs(near - gimbal.DELAY_S[1]) < 5 * std < far - near
    assert (model.delay_s[3, 1], far) == pytest.approx((far, 3.27e-3), abs=0.01e-3)
    low, high = model.delay_interval_s[3, 1]
    assert (low, high) == pytest.approx((near - 1.96 * std, far + 1.96 * std), rel=1e-4)
    assert "note: the delay from u2 to y4 is ill-determined" in said.err
    assert f"{1e3 * low:.3g} .. {1e3 * high:.3g}" in said.out


def modal(f_hz, poles, residues, direct=0.0):
    """Sum of residue matrices over s - p and their conjugates, by its definition."""
    s = 2j * np.pi * np.asarray(f_hz)[:, None, None]
    g = np.zeros((len(f_hz), *np.shape(residues)[1:]), complex) + direct
    for pole, residue in zip(poles, residues, strict=True):
        g = g + residue / (s - pole) + (np.conj(residue) / (s - np.conj(pole)) if pole.imag else 0)
    return g


def exact_frf(f_hz, g):
    return MimoFrf.from_arrays(f_hz, g, np.full(g.shape[:2], 1e-10), fs_hz=1000.0)


F_HZ = np.arange(0.5, 200, 0.5)
RESIDUES = np.random.default_rng(11).standard_normal((3, 2, 3, 2)) @ [1, 1j]


def test_an_odd_number_of_poles_and_a_direct_term():
    poles = np.array([-4 + 90j, -9 + 500j, -30 + 0j])
    residues = [RESIDUES[0], RESIDUES[1], RESIDUES[2].real]
    model = fit_mimo(exact_frf(F_HZ, modal(F_HZ, poles, residues, 0.05)), "5/5", delay="none")
    found = model.poles[model.poles.imag >= 0]
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(poles), rtol=1e-6)
    np.testing.assert_allclose(model.num[:, :, -1], 0.05, rtol=1e-5)


def test_models_are_stable_unless_they_may_be_unstable():
    poles = np.array([-4 + 90j, 6 + 500j])
    frf = exact_frf(F_HZ, modal(F_HZ, poles, RESIDUES[:2]))
    assert fit_mimo(frf, "4/3", delay="none").stable
    free = fit_mimo(frf, "4/3", delay="none", allow_unstable=True)
    found = free.poles[free.poles.imag > 0]
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(poles), rtol=1e-6)


def test_thirty_poles_are_no_numerical_matter():
    """Fifteen close modes up to 3 kHz, to 1e-6 of their frequencies."""
    rng = np.random.default_rng(5)
    f_modes = np.linspace(150, 2900, 15) * (1 + 0.02 * rng.standard_normal(15))
    poles = 2 * np.pi * f_modes * (-0.01 + 1j)
    residues = 1e3 * rng.standard_normal((15, 2, 2, 2)) @ [1, 1j]
    f = np.arange(2.0, 3000, 2)
    model = fit_mimo(exact_frf(f, modal(f, poles, residues)), "30/29", delay="none")
    found = np.sort_complex(model.poles[model.poles.imag > 0] * 1j)[::-1] / 1j
    np.testing.assert_allclose(np.sort(np.abs(found)), np.sort(np.abs(poles)), rtol=1e-6)


A = np.array([[0, 1, 0, 0], [-9e3, -5, 2e3, 0], [0, 0, 0, 1], [1e3, 0, -2e5, -12]])
B = np.array([[0, 0], [1e3, 50], [0, 0], [-40, 2e3]])
C = np.array([[0, 1.0, 0, 0], [0, 0, 0, 1]])


def held(delay_samples: int):
    """Two held inputs, sampled by scipy, behind whole samples of delay."""
    ad, bd, cd, _, dt = signal.cont2discrete((A, B, C, np.zeros((2, 2))), 1e-3)
    z = np.exp(2j * np.pi * F_HZ * dt)[:, None, None]
    g = cd @ np.linalg.inv(z * np.eye(4) - ad) @ bd * z**-delay_samples
    return replace(exact_frf(F_HZ, g), hold="zoh"), ad


def test_held_inputs_in_z():
    frf, ad = held(0)
    model = fit_mimo(frf, "4/3", domain="z", delay="none")
    poles = np.sort_complex(np.linalg.eigvals(ad))
    np.testing.assert_allclose(np.sort_complex(model.poles), poles, rtol=1e-7)
    rates = np.abs(np.linalg.eigvals(A)) / (2 * np.pi)
    np.testing.assert_allclose([mode[0] for mode in model.modes], np.unique(rates.round(9)), rtol=1e-6)


def test_held_inputs_in_s():
    """The continuous poles and the delay come out, images and all."""
    frf, _ = held(3)
    model = fit_mimo(frf, "4/3")
    poles = np.sort_complex(np.linalg.eigvals(A))
    np.testing.assert_allclose(np.sort_complex(model.poles), poles, rtol=1e-6)
    np.testing.assert_allclose(model.delay_s, 3e-3, atol=1e-8)
    np.testing.assert_allclose(model.response(F_HZ), frf.g, atol=1e-6 * np.abs(frf.g).max())
    again = MimoModel.from_dict(model.to_dict())
    np.testing.assert_array_equal(again.response(F_HZ), model.response(F_HZ))
    one = model.channel(1, 0).response(F_HZ)  # by the C library's own matrix exponential
    np.testing.assert_allclose(one, model.response(F_HZ)[:, 1, 0], rtol=1e-7)


def test_one_response_is_fitted_as_by_fit():
    """The same minimum by another search, as near as both stop (0.005 of V): 2 % of a sigma."""
    rng = np.random.default_rng(2)
    g = modal(F_HZ, np.array([-4 + 90j, -9 + 500j]), RESIDUES[:2])[:, :1, :1]
    g = g * np.exp(-2j * np.pi * F_HZ * 2e-3)[:, None, None]
    sigma = 1e-2 * np.sqrt(np.mean(np.abs(g) ** 2))
    g = g + sigma * rng.standard_normal((*g.shape, 2)) @ [1, 1j] / np.sqrt(2)
    variance = np.full(len(F_HZ), sigma**2)
    one = gsid.fit(gsid.response.frf.Frf.from_arrays(F_HZ, g[:, 0, 0], variance, fs_hz=1000.0), "4/3")
    many = fit_mimo(MimoFrf.from_arrays(F_HZ, g, variance[:, None], fs_hz=1000.0), "4/3")
    assert many.cost == pytest.approx(one.cost, abs=0.01)
    assert many.cost_expected == pytest.approx(one.cost_expected)
    assert many.delay_s[0, 0] == pytest.approx(one.delay_s, abs=0.02 * one.std_delay_s)
    assert many.std_delay_s[0, 0] == pytest.approx(one.std_delay_s, rel=1e-2)
    np.testing.assert_allclose(many.response_std(F_HZ)[:, 0, 0], one.response_std(F_HZ), rtol=1e-2)


def random_model(rng, n_poles, domain, direct):
    """Stable sections and random numerators, with free delays: two outputs, three inputs."""
    radius, angle = rng.uniform(0.3, 0.95, n_poles), rng.uniform(0.1, 3.0, n_poles)
    sections = np.empty(n_poles)
    if domain == "z":
        sections[0::2] = np.where(np.arange(0, n_poles, 2) + 1 < n_poles, radius[0::2] ** 2, -radius[0::2])
        sections[1::2] = (-2 * radius * np.cos(angle))[1::2]
    else:
        w = 2 * np.pi * rng.uniform(5, 200, n_poles)
        sections[0::2] = np.where(np.arange(0, n_poles, 2) + 1 < n_poles, w[0::2] ** 2, w[0::2])
        sections[1::2] = (0.1 * w)[1::2]
    num = rng.standard_normal((2, 3, n_poles + direct))
    delay_s = rng.uniform(0, 0.01, (2, 3))
    return MimoModel(sections, num, delay_s, domain=domain, fs_hz=500.0, delay_of=np.arange(6).reshape(2, 3))


@pytest.mark.parametrize("domain", ["s", "z"])
def test_response_and_derivatives_are_those_of_the_formula(domain):
    """MIM-1 written out in numpy: e N_k / S_k, -e N_k / S_k^2 by the sections, -j w G by the delay."""
    seed = 20260704
    print("seed", seed)
    rng = np.random.default_rng(seed)
    worst = 0.0
    for n_poles in range(1, 21):
        model = random_model(rng, n_poles, domain, direct=n_poles % 3 == 0)
        f = np.sort(rng.uniform(0.1, 240, 25))
        v = 2j * np.pi * f if domain == "s" else np.exp(2j * np.pi * f / model.fs_hz)
        g = model.response(f)
        for i, j in np.ndindex(2, 3):
            turn, num = np.exp(-2j * np.pi * f * model.delay_s[i, j]), model.num[i, j]
            basis, by_section = [], []
            for first in range(0, n_poles, 2):
                q, b = model.sections[first : first + 2], num[:n_poles][first : first + 2]
                section = v**2 + q[1] * v + q[0] if len(q) == 2 else v + q[0]
                part = turn * sum(b[k] * v**k for k in range(len(q)))
                basis += [turn * v**k / section for k in range(len(q))]
                by_section += [-part * v**k / section**2 for k in range(len(q))]
            basis += [turn] * (len(num) - n_poles)
            terms = np.array(basis) * num[:, None]
            expected = np.column_stack([*basis, *by_section, -2j * np.pi * f * terms.sum(axis=0)])
            scale = np.abs(terms).sum(axis=0)  # a sum that cancels is as exact as its terms
            worst = max(worst, float(np.max(np.abs(g[:, i, j] - terms.sum(axis=0)) / scale)))
            size = np.abs(expected)
            size[:, len(num) : len(num) + n_poles] = np.maximum(
                size[:, len(num) : len(num) + n_poles], 1e-3 * size[:, len(num) : len(num) + n_poles].max()
            )
            size[:, -1] = 2 * np.pi * f * scale
            worst = max(worst, float(np.max(np.abs(model.gradient(f, i, j) - expected) / size)))
    print("largest relative difference", worst)
    assert worst < 1e-12


def test_a_held_response_is_that_of_each_channel_alone():
    """The sum over sections against one state space of all poles, and that against scipy elsewhere."""
    seed = 20260705
    print("seed", seed)
    rng = np.random.default_rng(seed)
    worst = 0.0
    for n_poles in range(1, 10):
        model = replace(random_model(rng, n_poles, "s", direct=False), hold="zoh")
        f = np.sort(rng.uniform(0.1, 240, 25))
        held = model.response(f)
        for i, j in np.ndindex(2, 3):
            alone = model.channel(i, j).response(f)
            worst = max(worst, float(np.max(np.abs(held[:, i, j] - alone)) / np.max(np.abs(alone))))
    print("largest difference over the largest response", worst)
    assert worst < 1e-8


@pytest.mark.parametrize("call", [lambda m: m.response([0.0]), lambda m: m.gradient([0.0], 0, 0)])
def test_a_frequency_on_a_pole_is_refused(call):
    with pytest.raises(GsidError, match="response"):
        call(MimoModel([0.0], [[[1.0]]], [[0.0]]))


def test_derivatives_are_those_of_differences(model):
    """Of a response by its numerator, in which it is linear, by the sections and by the delay."""
    f = np.array([7.0, 61.0, 170.0])
    gradient = model.gradient(f, 2, 1)
    steps = [("num", (2, 1, k), 1e-3 * np.abs(model.num).max()) for k in range(8)]
    steps += [("sections", k, 1e-5 * model.sections[k]) for k in range(8)]
    steps += [("delay_s", (2, 1), 1e-7)]
    for column, (name, where, step) in enumerate(steps):
        sides = []
        for sign in (1, -1):
            values = getattr(model, name).copy()
            values[where] += sign * step
            sides.append(replace(model, cov=None, **{name: values}).response(f)[:, 2, 1])
        difference = (sides[0] - sides[1]) / (2 * step)
        atol = 1e-6 * np.abs(difference).max()
        np.testing.assert_allclose(gradient[:, column], difference, rtol=1e-5, atol=atol)
