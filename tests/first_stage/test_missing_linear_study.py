"""The study of missing linear effects: which axes it draws, and how it counts."""

import linear_axes as axes
import linear_names_study as names
import missing_linear_study as study
import numpy as np
import pytest

LAWS_OF_ANGLE = names.LAWS.index("motor_cogging")


@pytest.mark.parametrize(("effect", "index"), [("viscous_friction", 85), ("transport_delay", 93)])
def test_bug_effects_were_drawn_that_cost_next_to_nothing(effect, index, monkeypatch):
    """The refit was cut short, and one line of four stood for all: 437, not 15 (seed 5333, delay 93)."""
    trial = axes.drawn(5333, effect, index)
    monkeypatch.setattr(axes, "EVALUATIONS", 4 * axes.EVALUATIONS)
    monkeypatch.setattr(axes, "NEAR", np.inf)
    again = axes.drawn(5333, effect, index)
    assert again.axis == trial.axis
    assert again.drop == pytest.approx(trial.drop, rel=0.01)


def test_the_noise_of_the_lowest_lines_is_a_mean_of_fewer():
    assert axes._local_mean(np.arange(5.0), 3) == pytest.approx([0.5, 1.0, 2.0, 3.0, 3.5])


def test_drawn_effects_are_clear_and_drawn_again_alike():
    first, again = axes.drawn(2, "transport_delay", 0), axes.drawn(2, "transport_delay", 0)
    assert first.drop == again.drop >= axes.CLEAR
    assert "transport_delay" not in first.lacking
    assert np.array_equal(first.records[0][1], again.records[0][1])


@pytest.mark.parametrize("named", [("sensor_lag",), ("motor_lag", "sensor_lag")])
def test_either_lag_counts(named):
    assert study.is_named({"effect": "lag", "verdict": "missing_effect", "effects": list(named)})
    assert not study.is_named({"effect": "lag", "verdict": "nearest_effect", "effects": list(named)})


def test_bug_a_second_name_hid_behind_the_right_one():
    row = {"effect": "cable_spring", "verdict": "missing_effect", "effects": ["cable_spring"]}
    assert not study.has_another_name(row | {"found": [["cable_spring"]]})
    assert study.has_another_name(row | {"found": [["cable_spring"], ["coulomb_friction"]]})


def test_the_table_counts_the_effects_that_are_hardly_above_noise():
    rows = [
        {"seed": 2, "effect": "lag", "index": i, "percent": percent, "drop": drop, "output": "rate"}
        | {"hold": "zoh", "declared": True, "cost": [2.0, 1.0], "seconds": 1.0, "processor_s": 1.0}
        | {"verdict": verdict, "effects": effects, "found": []}
        for i, percent, drop, verdict, effects in [
            (0, 5, 99.0, "missing_effect", ["motor_lag", "sensor_lag"]),
            (0, 30, 99.0, "nearest_effect", ["motor_lag"]),
            (1, 5, 101.0, "missing_effect", ["motor_lag", "transport_delay"]),
        ]
    ]
    text = study.table(rows, "make missing-linear-study")
    assert "| lag | 2 of 2 | 0 of 1 | 0 |" in text
    assert "2 of the 3 diagnoses are of an effect with a drop below 100. Of these 1 named it." in text
    assert "1 of the 2 names are groups with another effect in them." in text
    assert "- 2 lag 0, 30 %: drop 99" in text


@pytest.mark.parametrize(
    ("law", "removed", "verdict", "found", "left", "expected"),
    [
        (None, False, "adequate", [], None, "none"),
        (None, False, "missing_effect", ["cable_spring"], None, "LINEAR NAME"),
        ("quadratic_drag", False, "missing_effect", ["viscous_friction", "quadratic_drag"], None, "the law"),
        ("motor_cogging", True, "missing_effect", ["cable_spring"], 63.0, "equal linear effect"),
        ("motor_cogging", True, "missing_effect", ["cable_spring"], 65.0, "LINEAR NAME"),
        ("motor_cogging", True, "missing_effect", ["cubic_spring"], None, "another name"),
        ("motor_cogging", True, "nearest_effect", ["cable_spring"], None, "nearest"),
    ],
)
def test_a_linear_name_is_right_only_where_the_law_is_linear_to_the_data(
    law, removed, verdict, found, left, expected
):
    row = {"law": law, "removed": removed, "verdict": verdict, "found": [found], "left": left}
    assert names.outcome(row) == expected


def test_bug_a_linear_name_hid_behind_that_of_the_law():
    row = {"law": "quadratic_drag", "removed": False, "verdict": "missing_effect", "left": None}
    assert names.outcome(row | {"found": [["quadratic_drag"], ["cable_spring"]]}) == "LINEAR NAME"
    assert names.outcome(row | {"found": [["quadratic_drag"], ["motor_cogging"]]}) == "another name"


def test_what_a_linear_model_leaves_of_a_linear_axis_is_nothing_and_of_cogging_is_not():
    trial, stack, law, noise, clean = names.drawn(3, LAWS_OF_ANGLE)
    assert law == "motor_cogging"
    fitted = names.model_of(stack, trial.fs_hz, trial.output)
    linear = [(u, fitted.simulate(u).y) for u, _ in clean]
    assert names.left_by(trial, fitted, linear, noise) < 0.01
    assert names.left_by(trial, fitted, clean, noise) > 1.0
