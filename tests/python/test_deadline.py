"""Deadlines: a fit by simulation ends when its time is over, with the best values so far."""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from plants import axis_record, plant

import gsid.greybox.fit
from gsid.base.deadline import Deadline, OutOfTime
from gsid.greybox.fit import fit_plant

SEED = 20261122
LATE_S = 1.0  # a sample of a stiff model; on a busy computer the processor time counts


@pytest.fixture(scope="module")
def record():
    print("seed", SEED)
    u = 30 * np.random.default_rng(SEED).standard_normal(3000)
    return axis_record(u, 4, 0.01, SEED, gain=7.4, viscous_rate=11.0)


def stiff():
    """Steep cogging: one simulation takes half a second on a fast computer."""
    cogging = {"level": 1e6, "cycles_per_rev": 5000.0, "phase_rad": 0.3}
    return plant({"rigid_body": {"gain": 7.4}, "viscous_friction": {"rate": 11.0}, "motor_cogging": cogging})


def good():
    return plant({"rigid_body": {"gain": 6.0}, "viscous_friction": {"rate": 9.0}})


def test_a_simulation_within_a_fit_is_stopped_at_the_deadline(record):
    """A bug: a fit of a stiff model went on for minutes after the budget of its search."""
    begin = time.perf_counter(), time.process_time()
    with Deadline(0.1) as deadline, pytest.raises(OutOfTime):
        fit_plant(stiff(), record, deadline=deadline)
    now = time.perf_counter(), time.process_time()
    assert min(at - then for at, then in zip(now, begin, strict=True)) < 0.1 + LATE_S


def test_a_fit_out_of_time_has_the_best_values_so_far(record, monkeypatch):
    deadline, n_runs = Deadline(), []

    class StopsAtTheThird(ThreadPoolExecutor):
        def submit(self, *arguments):
            n_runs.append(1)
            if len(n_runs) == 3:
                deadline.stop()
            return super().submit(*arguments)

    monkeypatch.setattr(gsid.greybox.fit, "ThreadPoolExecutor", StopsAtTheThird)
    cut = fit_plant(good(), record, deadline=deadline)
    monkeypatch.undo()
    whole, one = fit_plant(good(), record), fit_plant(good(), record, max_iter=1)
    assert not cut.converged
    assert cut.cost == one.cost > whole.cost


def test_a_deadline_in_time_changes_nothing(record):
    with Deadline(60) as deadline:
        fit = fit_plant(good(), record, deadline=deadline)
    assert fit.cost == fit_plant(good(), record).cost
    assert fit.converged


def test_time_that_is_over():
    deadline = Deadline(0)
    assert deadline.is_over
    assert deadline.left_s == 0
    with pytest.raises(OutOfTime):
        deadline.check()


def test_no_time_is_too_long():
    with Deadline(1e300) as deadline, Deadline() as endless:
        assert not deadline.is_over
        assert not endless.is_over


# ---- a bound on the work, which does not depend on the clock ---------------------------------------


def test_a_simulation_that_takes_too_many_moves_ends_without_a_clock(record):
    """A bug: one fit of a wide hard stop took 200 s, and only the clock ended it."""
    deadline = Deadline().bounded(1e5)
    with pytest.raises(OutOfTime):
        fit_plant(stiff(), record, deadline=deadline)
    assert deadline.moves_left == 0
    assert not deadline.is_over


def test_the_work_of_a_fit_is_the_same_every_time_and_enough_of_it_changes_nothing(record):
    deadline = Deadline().bounded(1e9)
    fit = fit_plant(good(), record, deadline=deadline)
    work = 1e9 - deadline.moves_left
    assert work >= record.u.size / 4  # at least one move for each sample of a period
    again = deadline.bounded(2 * work)
    assert fit_plant(good(), record, deadline=again).cost == fit.cost == fit_plant(good(), record).cost
    assert again.moves_left == work


def test_a_fit_whose_work_is_used_up_has_the_best_values_so_far(record):
    deadline = Deadline().bounded(1e9)
    one = fit_plant(good(), record, deadline=deadline, max_iter=1)
    work = 1e9 - deadline.moves_left
    deadline = Deadline().bounded(work + 1)  # the second step is stopped
    cut = fit_plant(good(), record, deadline=deadline)
    assert not cut.converged
    assert cut.cost == one.cost > fit_plant(good(), record).cost
    assert deadline.moves_left == 0


def test_a_bounded_deadline_is_stopped_with_the_other_and_has_work_of_its_own():
    deadline = Deadline()
    part = deadline.bounded(5)
    part.spend(3)
    assert (part.moves_left, deadline.moves_left) == (2, np.inf)
    deadline.stop()
    assert part.is_over
