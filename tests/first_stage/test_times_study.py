"""The study of the time of each step: its table, and that both clocks run."""

import time

import pytest
import times_study as study

from gsid.base.deadline import Deadline
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.settings import DEFAULTS


def row(start, draft, simulation, verdict="adequate", effects=()):
    steps = {"spectra": [0.1, 0.2], "first draft": draft, "simulation": simulation}
    sums = {"records to first draft": [0.1 + draft[0], 0.2 + draft[1]], "all": [9.0, 19.0]}
    return {"start": start, "verdict": verdict, "effects": list(effects), "steps": steps | sums}


def test_the_table_has_median_and_worst_of_each_step_and_start_before_and_now():
    rows = [row("records", [i, 2.0 * i], [0.5, 1.0]) for i in (1.0, 2.0, 6.0)]
    rows.append(row("30", [7.0, 8.0], [0.5, 1.0], "unknown_effect"))
    before = [row("records", [i, 0.0], [0.5, 1.0], effects=["hard_stop"]) for i in (3.0, 5.0, 4.0)]
    text = study.table(rows, before, "make it")
    lines = {tuple(cell.strip() for cell in line.split("|")[1:3]): line for line in text.splitlines()}
    line = lines["records alone", "first draft"]
    assert "| 3 | 4.00 (4.9, 5.0) | 2.00 (5.6, 6.0) | 4.00 (11.2, 12.0) |" in line
    assert "| 2.10 (5.7, 6.1) |" in lines["records alone", "records to first draft"]
    assert "| 1 | - | 7.00 (7.0, 7.0) |" in lines["model 30 % off", "first draft"]
    assert "The 1 unknown: 9.00 (9.0, 9.0) s of processor time, 19.00 (19.0, 19.0) s." in text
    assert "The effects of 0 of 3 diagnoses are those of before." in text


def test_both_clocks_run_also_in_a_step_that_is_interrupted(monkeypatch):
    monkeypatch.setattr(Run, "timed", study.timed)
    run = Run(Deadline(), DEFAULTS, None, (), lambda text: None)

    def step():
        with run.timed("a step"):
            time.sleep(0.05)
            raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            step()
    processor_s, clock_s = run.seconds["a step"]
    assert 0 <= processor_s < clock_s
    assert clock_s >= 0.1
