"""The sweep of the constants of the diagnosis."""

from dataclasses import fields

import pytest
import settings_sweep as sweep


@pytest.mark.parametrize(
    ("value", "factor", "expected"),
    [(0.9, 0.5, 0.45), (3, 0.5, 2), (1, 0.5, 1), (3, 2.0, 6), ((1.0, 3.0), 2.0, (2.0, 6.0))],
)
def test_a_constant_times_a_factor(value, factor, expected):
    found = sweep.changed(value, factor)
    assert found == expected
    assert type(found) is type(expected)


def test_each_constant_of_the_search_and_each_that_the_decision_reads_is_swept():
    tasks = sweep.tasks()
    assert len(tasks) == len(set(tasks))
    swept = {(group, name) for group, name, _ in tasks if name}
    search = {field.name for field in fields(sweep.of_search.SearchSettings)}
    assert {name for group, name in swept if group == sweep.SEARCH} == search
    decision = {name for group, name in swept if group == sweep.DECISION}
    assert {"named_share", "named_margin", "worse", "null_gain", "nearest_scatter"} <= decision
    assert not {"slices", "low_mode", "time_s"} & decision  # they change the fits themselves


def test_the_table_has_what_changes_and_lists_what_does_not():
    same = [["named", "cubic_spring"]] + [["unknown"]] * (len(sweep.PROBLEMS) - 1)
    other = [["nearest", "cubic_spring"], *same[1:]]
    rows = []
    for task in sweep.tasks():
        rows.append({"task": list(task), "verdicts": other if task[1:] == ("named_share", 2.0) else same})
    rows[-1] = {"task": rows[-1]["task"], "verdict": "ValueError: no"}
    rows = [row for row in rows if row["task"][1] != "stuck"]
    text = sweep.table(rows)
    assert (
        "| `named_share` | 0.9 | none | 21710 single 0: named cubic_spring, now nearest cubic_spring |"
        in text
    )
    assert "ValueError: no" in text
    assert "No verdict changes: `images`" in text
    assert "Not run yet: `stuck`." in text


def test_a_group_of_constants_that_has_hardly_been_run_has_no_empty_table():
    same = [["unknown"]] * len(sweep.PROBLEMS)
    tasks = [task for task in sweep.tasks() if task[0] == sweep.DECISION or task[1] in ("", "images")]
    text = sweep.table([{"task": list(task), "verdicts": same} for task in tasks])
    n_left = len(fields(sweep.of_search.SearchSettings)) - 1
    assert "| constant |" not in text
    assert "the first stage. No verdict changes: `images`." in text
    assert f"Not run yet: the other {n_left} constants." in text
