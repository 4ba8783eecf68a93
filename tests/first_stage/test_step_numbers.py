"""The steps of a diagnosis are numbered, and say how much time is left."""

import re

import numpy as np

import gsid
from gsid.base.deadline import Deadline
from gsid.diagnosis.from_records.steps import BEFORE_FITS, USUAL_FITS, Steps
from gsid.excitation.multisine import Multisine
from gsid.records.record import Record
from gsid.rig.axis import SimulatedAxis

STEP = re.compile(r"\[(\d+)/(\d+)\] (.*), (\d+) s left")


def test_more_steps_than_expected_make_the_total_grow():
    texts = []
    steps = Steps(texts.append, Deadline())
    steps("one")
    steps.expect(1)
    steps("two")
    steps("three")
    total = BEFORE_FITS + USUAL_FITS
    assert texts == [f"[1/{total}] one", "[2/2] two", "[3/3] three"]


def test_the_time_left_is_that_of_the_budget():
    texts = []
    Steps(texts.append, Deadline(41.4))("fitting")
    assert texts[0].endswith("fitting, 41 s left")


def test_the_steps_of_a_diagnosis_are_counted_to_the_last_fit():
    n, seed, texts = 3000, 20261125, []
    print("seed", seed)
    u = Multisine.design(3000.0, n, (1, 195), grid="odd", phases="random", seed=seed, amplitude=5.0).table()
    u, y, _ = SimulatedAxis(coulomb_level=2.0, seed=seed).step(np.tile(u, 10))
    gsid.diagnose_records(Record(u, y, 3000.0, n, 2 * n, hold="zoh"), time_s=30, on_step=texts.append)
    steps = [STEP.fullmatch(text).groups() for text in texts]
    assert [int(done) for done, *_ in steps] == list(range(1, len(steps) + 1))
    left_s = [int(left) for *_, left in steps]
    assert left_s[0] in (29, 30)
    assert left_s == sorted(left_s, reverse=True)
    fits = [(int(done), int(total)) for done, total, text, _ in steps if "by simulation" in text]
    assert fits[0][0] == BEFORE_FITS + 1
    assert fits[0][1] >= BEFORE_FITS + len(fits) - 1  # the total is known before the first fit
