"""The study's coverage counts what it states."""

import numpy as np
import start_study

SEED = 20261127


def test_coverage_of_normal_estimates_around_their_mean_is_95_percent():
    print("seed", SEED)
    rng = np.random.default_rng(SEED)
    held = []
    for _ in range(400):
        estimates = [[["effect.value", 3.0 + rng.normal(0, 0.2), 0.2]] for _ in range(6)]
        (name, inside), *_ = start_study._around_mean(estimates)
        assert name == "effect.value"
        held += inside
    assert abs(np.mean(held) - 0.95) < 0.012


def test_an_axis_with_few_right_stacks_has_no_coverage():
    assert list(start_study._around_mean([[["effect.value", 3.0, 0.2]]] * 4)) == []


def test_the_tables_stand_between_their_marks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- study: begin -->\nold\n<!-- study: end -->\nb\n")
    start_study.write_table(page, "study", "new")
    assert page.read_text() == "a\n<!-- study: begin -->\nnew\n<!-- study: end -->\nb\n"
