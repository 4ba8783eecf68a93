"""RationalModel against scipy.signal, python-control and Monte Carlo, none of which share code with it."""

import json

import control
import numpy as np
import pytest
from scipy import signal

from gsid.base.errors import GsidError, InputError
from gsid.base.zero_order_hold import hold_factor
from gsid.models.rational import RationalModel

SEED = 20260301
NUM, DEN, DELAY = [8510.0, 2.6e5, 9.36e9, 0.0], [1.0, 1045.0, 1.31e6, 1.28e9, 1.41e10, 2.15e11], 0.0054
F = np.linspace(0.5, 250, 60)


def axis(**changes):
    return RationalModel(NUM, DEN, DELAY, **changes)


def test_response_is_that_of_scipy_times_the_delay():
    w = 2 * np.pi * F
    expected = signal.freqs(NUM, DEN, w)[1] * np.exp(-1j * w * DELAY)
    np.testing.assert_allclose(axis().response(F), expected, rtol=1e-10)  # powers of s reach 1e27


def test_response_in_z_is_that_of_scipy():
    b, a = signal.butter(3, 0.2)
    expected = signal.freqz(b, a, F, fs=3000)[1] * np.exp(-2j * np.pi * F * 1e-3)
    model = RationalModel(b, a, 1e-3, "z", 3000.0)
    np.testing.assert_allclose(model.response(F), expected, rtol=1e-12)


@pytest.mark.parametrize("samples", [0, 3, 16])
def test_held_response_is_that_of_scipys_zero_order_hold(samples):
    b, a, _ = signal.cont2discrete((NUM, DEN), 1 / 3000, "zoh")
    expected = signal.freqz(b.ravel(), a, F, fs=3000)[1] * np.exp(-2j * np.pi * F * samples / 3000)
    model = RationalModel(NUM, DEN, samples / 3000, fs_hz=3000.0, hold="zoh")
    np.testing.assert_allclose(
        model.response(F), expected, rtol=1e-7
    )  # scipy's own rounding through its matrices


def test_gradient_is_that_of_finite_differences():
    model = axis(free_delay=True)
    theta = np.concatenate([model.den[1:], model.num, [model.delay_s]])
    n = model.n_poles

    def response(t):
        return RationalModel(t[n:-1], np.concatenate([[1.0], t[:n]]), t[-1]).response(F)

    gradient = model.gradient(F)
    for i in range(len(theta)):
        step = 1e-6 * max(abs(theta[i]), abs(theta[n:-1]).max() * 1e-3 if i == len(theta) - 2 else 0)
        up, down = theta.copy(), theta.copy()
        up[i] += step
        down[i] -= step
        numeric = (response(up) - response(down)) / (up[i] - down[i])
        assert np.max(np.abs(numeric - gradient[:, i])) < 1e-5 * np.max(np.abs(gradient[:, i])), i


@pytest.mark.parametrize("domain", ["s", "z"])
def test_derivatives_are_those_of_the_formula(domain):
    """dG/da = -G v^i / A, dG/db = e v^i / A, dG/dtau = -j w G, for random models of every order."""
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    worst = 0.0
    for n_poles in range(17):
        fs_hz, n_zeros, f = 1000.0, int(rng.integers(17)), np.sort(rng.uniform(0.1, 400, 30))
        w, delay_s = 2 * np.pi * f, float(rng.uniform(0, 0.01))
        size = 600.0 ** np.arange(17)
        num, den = rng.standard_normal((2, 17))
        if domain == "s":
            num, den = (num * size)[: n_zeros + 1], (den * size)[: n_poles + 1]
            v = (1j * w)[:, None] ** np.arange(17)
            num_terms, den_terms = v[:, : n_zeros + 1][:, ::-1], v[:, : n_poles + 1][:, ::-1]
        else:
            num, den = num[: n_zeros + 1], den[: n_poles + 1]
            v = np.exp(-1j * w / fs_hz)[:, None] ** np.arange(17)
            num_terms, den_terms = v[:, : n_zeros + 1], v[:, : n_poles + 1]
        model = RationalModel(num, den, delay_s, domain, fs_hz, free_delay=True)
        a = den_terms @ model.den
        by_num = np.exp(-1j * w * delay_s)[:, None] * num_terms / a[:, None]
        g = by_num @ model.num
        by_den = -g[:, None] * den_terms[:, 1:] / a[:, None]
        expected = np.column_stack([by_den, by_num, -1j * w * g])
        # Cancellation inside A and B grows the rounding of both formulas.
        lost = np.abs(den_terms) @ np.abs(model.den) / np.abs(a)
        lost += np.abs(num_terms) @ np.abs(model.num) / np.abs(num_terms @ model.num)
        error = np.abs(model.gradient(f) - expected) / np.abs(expected) / lost[:, None]
        worst = max(worst, float(error.max()))
    print("largest relative difference over the cancellation", worst)
    assert worst < 1e-14


def test_standard_deviations_of_response_and_poles_are_those_of_drawn_parameters():
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    mean = np.array([20.0, 900.0, 50.0, 3000.0, 2e-3])  # den[1:], num, delay
    spread = np.diag(1e-3 * np.abs(mean))
    mix = np.eye(5) + 0.5 * rng.standard_normal((5, 5))
    cov = spread @ mix @ mix.T @ spread
    model = RationalModel(mean[2:4], [1.0, *mean[:2]], mean[4], cov=cov, free_delay=True)
    f = np.array([1.0, 4.0, 20.0])
    draws = rng.multivariate_normal(mean, cov, 4000)
    models = [RationalModel(d[2:4], [1.0, *d[:2]], d[4]) for d in draws]
    std = np.std([m.response(f) for m in models], axis=0)
    # 4000 draws give a standard deviation to 1/sqrt(2 * 4000) = 1.1 %; 5 % also allows for the curvature.
    np.testing.assert_allclose(model.response_std(f), std, rtol=0.05)
    above = np.array([m.poles[np.argmax(m.poles.imag)] for m in models])
    expected = np.cov(above.real, above.imag)
    index = int(np.argmax(model.poles.imag))
    np.testing.assert_allclose(model.pole_cov[index], expected, rtol=0.1, atol=0.05 * expected.max())
    assert model.std_delay_s == pytest.approx(np.sqrt(cov[4, 4]))
    assert model.std_den[0] == 0


@pytest.mark.parametrize("relative_std", [1e-3, 0.1, 10.0, 1000.0])
def test_a_parameter_less_certain_than_its_size_moves_a_held_response_by_the_derivative(relative_std):
    """Far below fs the hold is a factor; a difference over a large part of a parameter is no derivative."""
    f = np.linspace(1.0, 60.0, 30)
    spread = relative_std * np.array([40.0, 2500.0, 50.0, 1e-3])  # den[1:], num, delay
    held = RationalModel(
        [50.0], [1.0, 40.0, 2500.0], 1e-3, fs_hz=3000.0, hold="zoh", cov=np.diag(spread**2), free_delay=True
    )
    hold = np.sinc(f / 3000.0) * np.exp(-1j * np.pi * f / 3000.0)
    by_parameter = held.gradient(f) * spread * hold[:, None]
    expected = np.sum(np.abs(by_parameter) ** 2, axis=1)
    found = np.sum(np.abs(held.deviations(f)) ** 2, axis=1)
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_the_factor_of_the_hold_is_its_integral():
    """(1 - exp(-j w T)) / (j w T), which is also a sinc and half a sample of delay."""
    seed = 20261001
    print("seed", seed)
    f, rate_hz = np.random.default_rng(seed).uniform(0, 3000, 1000), 1000.0
    s = 2j * np.pi * f
    factor = hold_factor(f, rate_hz)
    np.testing.assert_allclose(factor, -np.expm1(-s / rate_hz) * rate_hz / s, rtol=0, atol=1e-15)
    expected = np.sinc(f / rate_hz) * np.exp(-1j * np.pi * f / rate_hz)
    np.testing.assert_allclose(factor, expected, rtol=0, atol=1e-15)
    assert hold_factor(np.zeros(1), rate_hz) == 1


def test_a_file_gives_the_same_model_back(tmp_path):
    cov = np.diag(np.arange(1.0, 11.0))
    model = axis(cov=cov, free_delay=True, fs_hz=3000.0, hold="zoh", method="ml", cost=5.0, n_lines=4)
    model.band_hz, model.converged, model.u_unit = (1.0, 2.0), True, "V"
    model.save(tmp_path / "m.json")
    back = RationalModel.load(tmp_path / "m.json")
    assert back.to_dict() == model.to_dict()
    assert json.loads((tmp_path / "m.json").read_text())["gsid_model"] == 1
    assert [p.name for p in tmp_path.iterdir()] == ["m.json"]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("{", "not JSON"),
        ("[]", "not a model file"),
        ('{"gsid_model": 1, "effects": []}', "no transfer function"),
        ('{"gsid_model": 1, "rational": {"num": [1]}}', "key is missing"),
        ('{"gsid_model": 1, "rational": {"num": [1], "den": [0, 1]}}', "not usable"),
        ('{"gsid_model": 1, "rational": {"num": [1], "den": ["a"]}}', "not usable"),
        (
            '{"gsid_model": 1, "rational": {"num": [1], "den": [1], "delay_s": NaN}}',
            "NaN is not a JSON number",
        ),
        ('{"gsid_model": 1, "rational": {"num": [1], "den": [1]}, "fit": [1]}', "not usable"),
        ('{"gsid_model": 1, "rational": {"num": [1], "den": [1], "covariance": [1, 2]}}', "not usable"),
    ],
)
def test_a_bad_model_file_is_reported_with_fault_and_place(tmp_path, text, what):
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(InputError, match=what) as caught:
        RationalModel.load(path)
    assert "bad.json" in caught.value.where
    assert caught.value.hint


def test_python_control_and_back():
    system = axis().to_control(pade_order=6)
    for f in (2.0, 6 / (2 * np.pi * DELAY)):  # the documented limit of a Pade approximant of order 6
        turn = system(2j * np.pi * f) / axis().response([f])[0]
        assert abs(turn) == pytest.approx(1)
        assert abs(np.degrees(np.angle(turn))) < 0.1
    plain = RationalModel(NUM, DEN)
    back = RationalModel.from_control(plain.to_control())
    np.testing.assert_allclose(back.response(F), plain.response(F), rtol=1e-12)

    discrete = RationalModel([0.1, 0.2], [1.0, -0.5, 0.1], 2 / 3000, "z", 3000.0)
    assert discrete.to_control()(np.exp(2j * np.pi * 10 / 3000)) == pytest.approx(
        discrete.response([10.0])[0]
    )
    back = RationalModel.from_control(control.tf([0.2], [1.0, -0.5], 1e-3))
    assert back.domain == "z"
    assert back.response([50.0])[0] == pytest.approx(0.2 / (np.exp(2j * np.pi * 0.05) - 0.5))
    with pytest.raises(ValueError, match="not causal: 1 zeros, 0 poles"):
        RationalModel.from_control(control.tf([1.0, 0.2], [1.0], 1e-3))
    with pytest.raises(ValueError, match="whole number"):
        RationalModel([1.0], [1.0, 0.5], 0.4e-3, "z", 3000.0).to_control()


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ({"num": [np.nan], "den": [1]}, "finite"),
        ({"num": [1], "den": [0, 1]}, "zero"),
        ({"num": [1], "den": [1], "delay_s": np.inf}, "delay_s"),
        ({"num": [1], "den": np.ones(40)}, "degree"),
        ({"num": [1], "den": [1], "domain": "w"}, "domain"),
        ({"num": [1], "den": [1], "domain": "z"}, "fs_hz"),
        ({"num": [1], "den": [1], "hold": "foh"}, "hold"),
        ({"num": [1], "den": [1], "cov": np.eye(3)}, "shape"),
    ],
)
def test_misuse_is_a_value_error(arguments, what):
    with pytest.raises(ValueError, match=what):
        RationalModel(**arguments)


def test_a_frequency_on_a_pole_is_refused():
    with pytest.raises(GsidError, match="finite"):
        RationalModel([1.0], [1.0, 0.0]).response([0.0])


def test_stability_and_roots():
    model = RationalModel([1.0, 2.0], [1.0, 2.0, 26.0])
    np.testing.assert_allclose(sorted(model.poles.imag), [-5, 5])
    np.testing.assert_allclose(model.zeros, [-2])
    assert model.stable
    assert not RationalModel([1.0], [1.0, -2.0, 26.0]).stable
    assert len(RationalModel([3.0], [1.0]).poles) == 0
    assert "UNSTABLE" in repr(RationalModel([1.0], [1.0, -1.0]))
    assert "<table>" in model._repr_html_()
