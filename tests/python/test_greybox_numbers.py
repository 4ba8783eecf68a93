"""Numbers of the grey-box fit against numbers computed by hand, on problems of a few unknowns."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from plants import FS_HZ, axis_record, plant
from scipy import signal
from squares import covariance, search

import gsid.greybox.fit
import gsid.greybox.problem
from gsid.base.deadline import Deadline, OutOfTime
from gsid.base.errors import GsidError, InputError
from gsid.comparison import compare
from gsid.excitation.multisine import Multisine
from gsid.greybox.fit import fit_plant
from gsid.greybox.linear_start import linear_error, linear_start
from gsid.greybox.problem import Problem
from gsid.greybox.weights import lines_used, pooled_variance
from gsid.plant.periodic import PeriodicPlant
from gsid.records.record import Record
from gsid.spectrum.realisation import spectra
from gsid.spectrum.spectra import Spectra

N, P = 600, 12
AXIS = {
    "rigid_body": {"gain": 900.0},
    "viscous_friction": {"rate": 60.0},
    "cable_spring": {"stiffness": 400.0},
}
MODE = AXIS | {"flexible_mode": {"f_hz": 182.0, "zeta": 0.01, "residue": 0.5}}
BAND = (0.0, FS_HZ / 2)


def measured(noise=0.1, **more):
    """Spectra of an axis without spring, which has a mean rate; line 1 is the first that is excited."""
    u = Multisine.design(FS_HZ, N, (5, 250), amplitude=0.05, phases="random", seed=1).table()
    return spectra(axis_record(u, P, noise, 1, "axis", gain=900.0, viscous_rate=60.0, **more))


FREE_AXIS = {effect: AXIS[effect] for effect in ("rigid_body", "viscous_friction")}


def problem_of(several, *, band=BAND, per_record=(), stack=FREE_AXIS):
    return Problem(plant(stack), several, band, per_record)


def start_of(s):
    """The fit at its start, which is the truth."""
    return fit_plant(plant(FREE_AXIS), s, band=BAND, max_iter=1)


@pytest.mark.parametrize("lag", ["motor_lag", "sensor_lag"])
def test_a_lag_of_a_few_thousandths_of_a_sample_costs_no_work(lag):
    """A bug: a lag that a fit had made nearly zero took 66 times the work beside a friction."""
    s, time_constant_s = measured(), 3e-3 / FS_HZ
    stack = AXIS | {lag: {"time_constant_s": time_constant_s}}
    friction = {"coulomb_friction": {"level": 2.0}}
    with_lag, without = (PeriodicPlant.of(plant(one | friction), s) for one in (stack, AXIS))
    assert with_lag.run().settled
    assert without.run().settled
    assert with_lag.moves < 3 * without.moves
    den = np.polymul([1, 60, 400], [time_constant_s, 1])
    num, den, _ = signal.cont2discrete(([900, 0], den), 1 / FS_HZ, "zoh")
    _, exact = signal.freqz(num[0], den, s.f_hz[s.excited], fs=FS_HZ)
    response = (PeriodicPlant.of(plant(stack), s).run().Y / s.u)[s.excited]
    of_second_order = (np.pi * FS_HZ * time_constant_s) ** 2
    np.testing.assert_allclose(response, exact, rtol=of_second_order)


# ---- weights -----------------------------------------------------------------------------------------------


def test_weights_of_a_record():
    """sqrt(2 P / s^2), and sqrt(P / s^2) of a real line, whose variance is that of its only part."""
    s = measured()
    fit = start_of(s)
    (record,) = fit.records
    ((variance, dof),) = pooled_variance([s])
    k = (N + 1) // 2
    assert record.line.tolist() == list(range(k))
    parts = np.r_[1, np.full(k - 1, 2)]
    np.testing.assert_allclose(record.weight**2, (dof - 1) / dof * parts * P / variance[:k])
    assert fit.n_dof == 2 * k - 1 - len(fit.model.free_names)
    assert record.residual[k] == 0


def test_a_drift_is_a_ramp_without_mean():
    """The sum of n w^n over a period is N / (w - 1) if w^N = 1: line k of n / N is 2 / N / (w - 1)."""
    problem = problem_of([measured()], per_record=("drift",))
    with ThreadPoolExecutor(1) as pool:
        problem.minimise("lm", "ml", 1, pool)
    part = problem.parts[0]
    re, im = np.split(part.rows[:, 0] / np.tile(part.weight, 2), 2)
    assert abs(re[0]) < 1e-12
    w = np.exp(-2j * np.pi * part.line[1:] / N)
    np.testing.assert_allclose(re[1:] + 1j * im[1:], 2 / N / (w - 1), rtol=1e-9)


def small(n_periods, level=1.0, name="short"):
    """Lines 0, 1, 2 of four samples. With a lost period, the variance is that over the periods."""
    Y = np.random.default_rng(n_periods).standard_normal((n_periods, 3)) + 0j
    U = np.tile([0, level + 0j, 0], (n_periods, 1))
    return Spectra(4.0, 4, np.arange(3), U, Y, 1, 0, np.array([False, True, False]), name=name)


def test_a_variance_needs_more_than_two_degrees_of_freedom():
    """Line 1 alone: as many as periods minus one. With 2 the covariance of a fit has no mean."""
    with pytest.raises(InputError, match="too few periods") as refused:
        pooled_variance([small(3)])
    assert (refused.value.where, refused.value.value) == ("short", "2 degrees of freedom")
    ((variance, dof),) = pooled_variance([small(4)])
    assert (variance[1], dof) == (pytest.approx(small(4).var_y[1]), 3)


@pytest.mark.parametrize(("level", "dof"), [(1.04, 11), (1 / 1.04, 11), (1.06, 5), (1 / 1.06, 5)])
def test_records_within_five_per_cent_of_the_level_are_pooled(level, dof):
    assert pooled_variance([small(6), small(7, level)])[0][1] == dof


def test_the_level_of_a_group_is_that_of_its_first_record():
    """4 % and 8 % more: neighbours agree within 5 %, but the third and the first do not."""
    several = [small(6), small(7, 1.04), small(8, 1.08)]
    assert [dof for _, dof in pooled_variance(several)] == [11, 11, 7]


def test_a_record_without_noise_has_the_variance_of_the_resolution_of_a_converter():
    """1e-7 of the largest line."""
    s = measured(noise=0.0)
    (record,) = start_of(s).records
    ((_, dof),) = pooled_variance([s])
    variance = (1e-7 * np.max(np.abs(s.y[record.line]))) ** 2
    np.testing.assert_allclose(record.weight[1:] ** 2, (dof - 1) / dof * 2 * P / variance, rtol=1e-6)


def test_too_few_lines_are_reported_with_the_first_record():
    """Line 1 of two records is four numbers; each record has two unknowns, and both share one."""
    other = measured()
    other.name = "other"
    own = ("viscous_friction.rate", "cable_spring.stiffness")
    with pytest.raises(InputError, match="5 unknowns need more lines") as refused:
        problem_of([measured(), other], band=(4.0, 6.0), per_record=own, stack=AXIS)
    assert (refused.value.where, refused.value.value) == ("axis", "4 numbers")


def test_more_unknowns_than_the_library_takes_are_refused():
    """600 records with a stiffness and a drift of their own; it was called a delay that is too long."""
    with pytest.raises(ValueError, match="1202 unknowns of 600 records are more than 1024"):
        problem_of([measured()] * 600, per_record=("cable_spring.stiffness", "drift"), stack=AXIS)


def test_the_default_band_of_a_loop_of_the_angle_begins_at_0_hz():
    """Reference and angle have a common zero there, and nowhere else."""
    s = measured()
    loop = {"position_velocity_loop": {"kp": 30.0, "kv": 0.1, "limit": 1e3}}
    for stack, output, first in ((loop | AXIS, "angle", 0), (AXIS, "angle", 1), (loop | AXIS, "rate", 1)):
        assert np.flatnonzero(lines_used(plant(stack, output=output), s, None))[0] == first


def test_a_parameter_is_held_if_its_size_changes_less_than_a_thousandth_of_the_noise():
    """The noise is enlarged, the mean of the periods stays: nothing is to be gained from the start."""
    gain = "rigid_body.gain"
    quiet = start_of(measured())
    column = quiet.model.free_names.index(gain)
    effect = np.linalg.norm(quiet.jacobian[:, column]) * quiet.model[gain].value
    for size, is_held in ((2e-3, False), (5e-4, True)):
        noisy = measured()
        noisy.Y = noisy.y + (noisy.Y - noisy.y) * effect / size
        fit = start_of(noisy)
        assert fit.n_iterations == 0
        assert np.isnan(fit.model[gain].std) == is_held


def test_a_response_with_backlash_that_does_not_settle_is_not_simulated_longer():
    """A gear that rattles: the work of one impatient search is enough for the start of a fit."""
    gear = {"gap_deg": 0.02, "stiffness": 1e5, "inertia_ratio": 0.1, "damping": 0.0}
    model = plant(FREE_AXIS | {"gear_backlash": gear})
    s = measured()
    work = {}
    for is_patient in (False, True):
        rattling = PeriodicPlant.of(model, s)
        assert not rattling.run(sensitivities=True, patient=is_patient).settled
        work[is_patient] = rattling.moves
    assert work[True] > 1.5 * work[False]
    fit_plant(model, s, band=BAND, max_iter=1, deadline=Deadline().bounded(work[False] + 1))
    with pytest.raises(OutOfTime):
        fit_plant(model, s, band=BAND, max_iter=1, deadline=Deadline().bounded(work[False] // 2))


# ---- search ------------------------------------------------------------------------------------------------


class OneUnknown:
    """A search along x, whose residual always seems 10 away; the cost of each trial is given.

    Parameters
    ----------
    gains : list of float or None
        Decrease of the cost over the predicted decrease; None for a trial that cannot be simulated.
    """

    n = 1

    def __init__(self, gains, cost=1e6):
        self.gains, self.dampings = list(gains), []
        self.kept = self.last = (np.zeros(1), cost)

    def start(self):
        return np.zeros(1)

    def bounds(self):
        return np.full(1, -np.inf), np.full(1, np.inf)

    def keep(self):
        self.kept = self.last

    def at(self, x):
        before, cost = self.kept
        step = float(x[0] - before[0])
        if step:
            self.dampings.append(10 / step - 1)
            gain = self.gains.pop(0)
            if gain is None:
                raise GsidError(-4, "the plant left the range of numbers")
            cost -= gain * (10**2 - (10 - step) ** 2)
        self.last = (x, cost)
        return cost, np.eye(1), np.array([10.0]), True


def test_the_damping_follows_nielsen():
    """A step of 10 / (1 + d) shows d, which is multiplied by max(1/3, 1 - (2 gain - 1)^3), or by 2, 4, ..."""
    problem = OneUnknown([0.75, None, None, 1.0, 0.1, None, 1.0])
    search(problem, "lm", 4)
    factors = [1, 0.875, 2, 4, 1 / 3, 1 + 0.8**3, 2]
    np.testing.assert_allclose(problem.dampings, 1e-3 * np.cumprod(factors), rtol=1e-9)


@pytest.mark.parametrize(("cost", "is_converged"), [(2e8, True), (5e7, False)])
def test_a_search_that_stalls_has_converged_if_little_of_the_cost_is_left(cost, is_converged):
    """A full step promises 100: less than 1e-6 of the cost, or more. No trial lowers it."""
    problem = OneUnknown([-1.0] * 100, cost)
    found = search(problem, "lm", 10)
    assert (found.n_iterations, found.x[0], found.converged) == (0, 0, is_converged)
    assert problem.dampings[-1] == pytest.approx(
        1e-3 * 2**36, rel=1e-6
    )  # 2 * 4 * ... 2^8; with 2^9, above 1e10


class Linear:
    """Residuals b - R x: the cost is quadratic."""

    def __init__(self, R, b, start, bounds):
        self.R, self.b, self._start, self._bounds = np.array(R), np.array(b), start, bounds
        self.n, self.points = len(b), []

    def start(self):
        return self._start

    def bounds(self):
        return self._bounds

    def keep(self):
        pass

    def at(self, x):
        self.points.append(x)
        q = self.b - self.R @ x
        return q @ q, self.R, q, True


def test_steps_within_bounds():
    """Unit Jacobian: the full step is b. An unknown at a bound is blocked if its step leads out."""
    b = np.array([-1.0, 0.5, 0.0, 1.0, -0.5, 0.0])
    bounds = np.r_[np.zeros(3), np.full(3, -9.0)], np.r_[np.full(3, 9.0), np.zeros(3)]
    problem = Linear(np.eye(6), b, np.zeros(6), bounds)
    found = search(problem, "lm", 10)
    assert found.is_blocked == [True, False, False, True, False, False]
    np.testing.assert_allclose(problem.points[1], np.array([0, 0.5, 0, 0, -0.5, 0]) / (1 + 1e-3), rtol=1e-12)
    np.testing.assert_allclose(found.x, [0, 0.5, 0, 0, -0.5, 0], atol=1e-3)
    assert found.cost == pytest.approx(2, abs=1e-5)  # the blocked unknowns leave 1 + 1


def test_a_direction_that_the_data_do_not_determine_is_held():
    """Two equal columns: the step goes along their sum, whatever the damping."""
    found = search(
        Linear(
            np.array([[1.0, 1.0], [0.0, 1e-9]]), [2.0, 1.0], np.zeros(2), (-np.ones(2) * 9, np.ones(2) * 9)
        ),
        "lm",
        20,
    )
    np.testing.assert_allclose(found.x, [1, 1], atol=0.01)
    assert found.converged


QUADRATIC = (np.array([[2.0, 1.0], [0.0, 3.0]]), np.array([1.0, -2.0]))
WIDE = (np.full(2, -50.0), np.full(2, 50.0))


def test_nlopt_counts_its_evaluations():
    """With a wrong gradient it needs many more, or ends elsewhere."""
    problem = Linear(*QUADRATIC, np.array([3.0, 2.0]), WIDE)
    found = search(problem, "nlopt", 100)
    np.testing.assert_allclose(found.x, np.linalg.solve(*QUADRATIC), atol=1e-6)
    assert found.n_iterations == len(problem.points) - 1 <= 10  # less the start
    assert found.converged


@pytest.mark.parametrize("solver", ["lm", "nlopt"])
def test_steps_from_a_start_out_of_the_bounds_end_within(solver):
    problem = Linear(*QUADRATIC, np.array([80.0, -80.0]), WIDE)
    found = search(problem, solver, 100)
    assert problem.points[0].tolist() == [80, -80]
    assert np.all(np.abs(problem.points[1:]) <= 50)
    np.testing.assert_allclose(found.x, np.linalg.solve(*QUADRATIC), atol=1e-2)


@pytest.mark.parametrize("hint", ["look at the units", ""])
def test_a_start_that_cannot_be_simulated_has_the_hint_of_its_cause(monkeypatch, hint):
    def fail(status):
        raise GsidError(-4, "the plant left the range of numbers", hint)

    monkeypatch.setattr(gsid.greybox.problem, "check_simulation", fail)
    with pytest.raises(InputError) as refused:
        fit_plant(plant(FREE_AXIS), measured())
    assert refused.value.where == "axis"
    assert refused.value.hint == (hint or "use starting values closer to those of a working axis")


@pytest.mark.parametrize("solver", ["lm", "nlopt"])
def test_what_fails_while_the_records_are_simulated_is_raised(monkeypatch, solver):
    """At the third evaluation, in the call back from the C library."""

    class Failing(ThreadPoolExecutor):
        n_calls = 0

        def submit(self, *arguments):
            Failing.n_calls += 1
            if Failing.n_calls == 3:
                raise ArithmeticError("call 3")
            return super().submit(*arguments)

    monkeypatch.setattr(gsid.greybox.fit, "ThreadPoolExecutor", Failing)
    off = plant(FREE_AXIS)
    off["rigid_body.gain"].value *= 1.3
    with pytest.raises(ArithmeticError, match="call 3"):
        fit_plant(off, measured(), solver=solver)
    assert Failing.n_calls == 3


# ---- result ------------------------------------------------------------------------------------------------


def test_a_direction_of_the_parameters_is_pinned_if_its_singular_value_is_below_a_millionth():
    """The first two columns have the same direction; the sum of the parameters is known, and the third."""
    found = covariance(np.array([[1.0, 1.0, 0.0], [0.0, 1e-9, 0.0], [0.0, 0.0, 2.0]]))
    assert (found.n_open, found.is_open.tolist()) == (1, [True, True, False])
    want = [[0.25, 0.25, 0], [0.25, 0.25, 0], [0, 0, 0.25]]
    np.testing.assert_allclose(found.of_unknowns, want, atol=1e-8)
    r = np.array([[1.0, 1.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 2.0]])
    found = covariance(r)
    assert (found.n_open, found.is_open.any()) == (0, False)
    np.testing.assert_allclose(found.of_unknowns, np.linalg.inv(r.T @ r), rtol=1e-6)


def test_the_covariance_is_that_of_numpys_singular_values():
    """Errors relative to the standard deviations; columns of any length and condition numbers up to 1e4."""
    rng = np.random.default_rng(20261123)
    for n in (1, 2, 7, 24) * 10:
        u, v = (np.linalg.qr(rng.standard_normal((n, n)))[0] for _ in range(2))
        r = np.linalg.qr(u * np.geomspace(1, 1e-4, n) @ v)[1] * 10.0 ** rng.uniform(-9, 9, n)
        length = np.linalg.norm(r, axis=0)
        want = np.linalg.pinv(r / length)
        want = want @ want.T / np.outer(length, length)
        std = np.sqrt(np.diag(want))
        np.testing.assert_allclose(
            covariance(r).of_unknowns / np.outer(std, std), want / np.outer(std, std), atol=1e-11
        )


def test_the_p_value_of_a_fit_is_that_of_the_lines_above_0_hz():
    """An offset fails at 0 Hz alone."""
    s = measured()
    s.Y[:, 0] += 1.0
    fit = fit_plant(plant(FREE_AXIS), s, band=(0.0, 250.0))
    assert fit.records[0].line[0] == 0
    assert fit.noise_p_value == pytest.approx(compare(fit.model, s, band=(1.0, 250.0), fitted=True).p_value)
    assert fit.noise_p_value > 1e-3


def test_the_file_of_a_model_has_what_each_record_has_of_its_own():
    fit = fit_plant(plant(FREE_AXIS), measured(), per_record=["drift"])
    drift = fit.records[0].params["drift"]
    assert fit.model.fit["per_record"] == [{"name": "axis", "drift": [drift.value, drift.std]}]
    drift.std = float("nan")
    assert fit.summary()["per_record"] == [{"name": "axis", "drift": [drift.value, None]}]


# ---- linear start ------------------------------------------------------------------------------------------


def test_the_error_of_the_linear_part_is_weighted_by_the_noise_and_a_thousandth_of_the_response():
    """G = 900 / (s + 60). The measured response is 1 % larger; half of the lines have a noise of 0.2 %."""
    line, n_periods = np.arange(N // 2 + 1), 4
    excited = (line > 0) & (line <= 20)
    g = 1.01 * 900 / (2j * np.pi * line * FS_HZ / N + 60)
    U = np.tile(np.where(excited, 0.5 + 0j, 0), (n_periods, 1))
    std = np.where(line <= 10, 2e-3, 0) * np.abs(g) * 0.5  # of one period
    scatter = np.array([1, -1, 1, -1]) * np.sqrt(3 / 4)  # mean 0, sample variance 1
    Y = g * U + scatter[:, None] * std
    s = Spectra(FS_HZ, N, line, U, Y, 0, 0, excited, hold="none", y_unit="deg/s")
    # |error| / |g| is 0.01 / 1.01 at each line; the noise of the mean is 0.1 % of |g|.
    expected = (0.01 / 1.01) ** 2 * (10 / (1e-6 + 1e-6) + 10 / 1e-6)
    assert linear_error(plant(FREE_AXIS), [s]) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("off", "zeta"), [(0.87, 0.01), (1.14, 0.01), (1.14, 0.0)])
def test_a_resonance_is_found_on_both_sides_of_its_start_value(off, zeta):
    """14 % off are seven widths of the resonance: the gradient does not lead there."""
    u = np.tile(Multisine.design(FS_HZ, N, (5, 250), amplitude=0.05, phases="random", seed=1).table(), 4)
    record = Record(u, np.zeros(len(u)), FS_HZ, N, 0, hold="zoh", y_unit="deg/s")
    model = plant(MODE)
    y = np.tile(model.predict(spectra(record)).y, 4)
    record.y = y + 1e-3 * np.std(y) * np.random.default_rng(1).standard_normal(len(y))
    model["flexible_mode.f_hz"].value *= off
    model["flexible_mode.zeta"].value = zeta
    assert linear_start(model, [spectra(record)])["flexible_mode.f_hz"].value == pytest.approx(182, rel=1e-3)
