"""Comparison of models of several outputs: the law of the scores, dense algebra, `compare`, wrong models."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from gsid.base.errors import InputError
from gsid.comparison import compare
from gsid.comparison_mimo import compare_mimo
from gsid.excitation.orthogonal import orthogonal_multisines
from gsid.models.mimo import MimoModel
from gsid.models.mimo_misfit import MimoErrors, mimo_misfit
from gsid.records.mimo import MimoRecord

FS_HZ, N, P = 100.0, 200, 4
SEED = 20261123


def model(n_y=2, n_u=2, **changes):
    """One pair of poles at 4 Hz, damping 0.1."""
    w = 2 * np.pi * 4.0
    rng = np.random.default_rng(3)
    num = rng.uniform(50, 100, (n_y, n_u, 2)) * [1.0, 0.3]
    return MimoModel(np.array([w**2, 0.2 * w]), num, np.zeros((n_y, n_u)), **changes)


def measured(truth, seed, noise=0.5, n_realisations=1, correlation=0.7):
    rng = np.random.default_rng(seed)
    how = {"n_realisations": n_realisations, "seed": seed}
    u = orthogonal_multisines(FS_HZ, N, (1.0, 20.0), [1.0] * truth.n_u, **how).periods
    f = np.arange(1, N // 2 + 1) * FS_HZ / N
    lines = np.zeros((len(u), N // 2 + 1, truth.n_y), complex)
    lines[:, 1:] = np.einsum("kij,ekj->eki", truth.response(f), np.fft.rfft(u, axis=1)[:, 1:])
    y = np.tile(np.fft.irfft(lines, N, axis=1), (1, P, 1))
    mix = correlation + (1 - correlation) * np.eye(truth.n_y)
    y = y + noise * rng.standard_normal(y.shape) @ np.linalg.cholesky(mix).T
    how = {"period_samples": N, "settle_samples": 0, "hold": "none"}
    return [MimoRecord(*one, FS_HZ, **how) for one in zip(np.tile(u, (1, P, 1)), y, strict=True)]


def noise_errors(n_lines, n_y, n_e, dof, seed=SEED):
    rng = np.random.default_rng(seed)
    mix = rng.standard_normal((n_y, n_y)) + 1j * rng.standard_normal((n_y, n_y))
    white = (rng.standard_normal((n_lines, n_y, n_e + dof, 2)) @ [1, 1j]) / np.sqrt(2)
    x = mix @ white
    scatter = x[..., n_e:] @ x[..., n_e:].conj().swapaxes(1, 2)
    return MimoErrors(x[..., :n_e], scatter, dof, np.zeros((n_lines, n_y, n_e, 0)))


@pytest.mark.parametrize(("n_y", "n_e", "dof"), [(1, 1, 1), (4, 1, 4), (3, 5, 3), (4, 8, 20)])
def test_scores_are_exponential_and_independent_for_any_covariance(n_y, n_e, dof):
    q = noise_errors(3000, n_y, n_e, dof).scores.reshape(3000, -1)
    p = stats.kstest(q.ravel(), "expon").pvalue
    correlation = np.corrcoef(q, rowvar=False) if q.shape[1] > 1 else np.eye(1)
    largest = np.max(np.abs(correlation - np.eye(len(correlation))))
    print(f"seed {SEED}: p = {p:.3g}, largest correlation {largest:.3f}")
    assert p > 1e-3
    assert largest < 5 / np.sqrt(3000)


def test_the_scores_add_up_to_wilks_determinant():
    errors = noise_errors(5, 3, 4, 6)
    order = errors.dof + np.arange(4) - np.arange(3)[:, None]
    total = errors.scatter + errors.error @ errors.error.conj().swapaxes(1, 2)
    log_ratio = np.linalg.slogdet(total)[1] - np.linalg.slogdet(errors.scatter)[1]
    np.testing.assert_allclose(np.sum(errors.scores / order, axis=(1, 2)), log_ratio, rtol=1e-10)


def test_with_a_known_covariance_the_misfit_is_that_of_dense_algebra():
    """e' (S + A A')^-1 e of all lines, outputs and experiments, with S of 1e7 degrees of freedom."""
    rng = np.random.default_rng(SEED)
    k, n_y, n_e, r, dof = 6, 3, 2, 4, 10**7
    draw = lambda *shape: rng.standard_normal((*shape, 2)) @ [1, 1j]  # noqa: E731
    half = draw(n_y, n_y)
    covariance = half @ half.conj().T
    error, by_model = draw(k, n_y, n_e), draw(k, n_y, n_e, r)
    errors = MimoErrors(error, np.broadcast_to(covariance * dof, (k, n_y, n_y)), dof, by_model)

    def real(x):  # complex normal numbers as pairs of real ones
        return np.concatenate([x.real, x.imag])

    def ordered(x):  # line, experiment, output
        return x.swapaxes(1, 2).reshape(k * n_e * n_y, -1)

    block = np.kron(np.eye(k * n_e), covariance) / 2
    whole = np.block([[block.real, -block.imag], [block.imag, block.real]])
    a, e = real(ordered(by_model)), real(ordered(error[..., None])).ravel()
    expected = e @ np.linalg.solve(whole + a @ a.T, e)
    assert mimo_misfit(errors).total.chi2 == pytest.approx(
        expected, rel=1e-5
    )  # 1/dof, times the number of lines


def test_one_input_and_output_is_gsid_compare():
    truth = model(1, 1)
    (record,) = measured(truth, 4)
    expected = compare(truth.channel(0, 0), record.pair(0, 0))
    found = compare_mimo(truth, [record])
    assert found.p_value == pytest.approx(expected.p_value, rel=1e-9)
    assert found.outputs[0].rms_error == pytest.approx(expected.rms_error, rel=1e-9)
    assert found.outputs[0].noise_floor_rms == pytest.approx(expected.noise_floor_rms, rel=1e-9)


def test_a_wrong_channel_is_found_at_its_output_only():
    truth = model(3, 3)
    wrong = replace(truth, num=truth.num * np.where(np.arange(9).reshape(3, 3, 1) == 5, 1.1, 1.0))
    result = compare_mimo(wrong, measured(truth, 1, n_realisations=2))
    assert not result.adequate
    assert [one.p_value < 0.001 for one in result.outputs] == [False, True, False]
    assert {band["output"] for band in result.where} == {"y2"}
    assert result.where[0]["f_lo_hz"] <= 4 <= result.where[0]["f_hi_hz"]
    assert "output y2" in result.verdict


def test_a_correct_model_is_adequate_and_says_how_it_was_judged():
    truth = model(2, 2)
    result = compare_mimo(truth, measured(truth, 2))
    assert result.adequate
    assert result.model_uncertainty == "none"
    assert "no covariance" in result.verdict
    assert result.cost_per_dof == pytest.approx(1, abs=0.2)
    assert result.to_dict()["outputs"][1]["name"] == "y2"


def test_a_hold_that_is_not_stated_is_that_of_the_larger_p_value():
    truth = model(2, 2)
    records = [replace(record, hold=None) for record in measured(truth, 2, noise=0.05)]
    result = compare_mimo(replace(truth, fs_hz=FS_HZ), records)
    assert (result.hold, result.hold_assumed, result.adequate) == ("none", True, True)


def test_a_measured_input_is_used_as_measured():
    """Noise of the input changes from period to period: the scatter is that of Y - G U."""
    truth = model(2, 2)
    records = measured(truth, 8)
    noisy = [replace(r, u=r.u + 1e-6 * np.random.default_rng(1).standard_normal(r.u.shape)) for r in records]
    found = [compare_mimo(truth, each).p_value for each in (records, noisy)]
    assert found[1] > 0.01
    assert found[0] != found[1]  # the other estimate of the noise


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: replace(r, inputs=["a", "b"]), "inputs differ"),
        (lambda r: replace(r, y_units=["rad/s", "deg/s"]), "y_units differ"),
        (lambda r: replace(r, y=r.y[: 2 * N], u=r.u[: 2 * N]), "too few periods for the joint noise"),
    ],
)
def test_records_that_do_not_fit_the_model_are_refused(change, message):
    truth = model(2, 2, y_units=["deg/s", "deg/s"], u_units=["V", "V"])
    record = replace(measured(truth, 0)[0], u_units=["V", "V"], y_units=["deg/s", "deg/s"])
    with pytest.raises(InputError, match=message):
        compare_mimo(truth, change(record))
    with pytest.raises(ValueError, match="alpha"):
        compare_mimo(truth, record, alpha=2.0)


def test_bug_an_output_that_follows_from_the_others_was_a_fault_of_the_command():
    """Its Cholesky factor does not exist: "Matrix is not positive definite", without where and what to do."""
    truth = model()
    records = [replace(one, y=one.y[:, :1] * [1.0, 2.0]) for one in measured(truth, SEED)]
    with pytest.raises(InputError, match="noise of the outputs is linearly dependent") as caught:
        compare_mimo(truth, records)
    assert caught.value.hint == "leave out an output that is computed from the others"
