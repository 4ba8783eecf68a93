"""The steps of the diagnosis from records as numbers: stack, convergence, kept-out cost, scatter."""

from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gsid.base.deadline import Deadline, OutOfTime
from gsid.diagnosis.from_records import confirm as confirming
from gsid.diagnosis.from_records import draft as drafting
from gsid.diagnosis.from_records import find_structure as finding
from gsid.diagnosis.from_records import fit_laws, mend_structure
from gsid.diagnosis.from_records.canonical import (
    canonical_stack,
    has_low_mode,
    insignificant,
    pruned,
    resonant_stack,
    unit_of_values,
    without_wrong_unit,
)
from gsid.diagnosis.from_records.confirm import has_converged, judged
from gsid.diagnosis.from_records.run import Run
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.verdict import Decision
from gsid.diagnosis.missing_torque import ranking
from gsid.diagnosis.missing_torque import refit as refitting
from gsid.diagnosis.missing_torque.kept_out import keep_out
from gsid.diagnosis.missing_torque.law_columns import Law
from gsid.diagnosis.missing_torque.motion import Motion
from gsid.diagnosis.missing_torque.problem import linear_part
from gsid.diagnosis.missing_torque.settings import DEFAULTS as SEARCH
from gsid.effects.types import find
from gsid.plant.effect import Param
from gsid.plant.model import PlantModel
from gsid.spectrum.spectra import Spectra

F_LO, FS_HZ = 2.0, 1000.0
CORNER = 2 * np.pi * F_LO
BODY, VISCOUS = {"rigid_body": {"gain": 10.0}}, {"viscous_friction": {"rate": 3.0}}
SPRING, LAG = {"cable_spring": {"stiffness": 500.0}}, {"sensor_lag": {"time_constant_s": 2e-3}}
DELAY = {"transport_delay": {"delay_s": 3e-3}}


def mode(f_hz, residue=0.2, zeta=0.02):
    return {"flexible_mode": {"f_hz": f_hz, "zeta": zeta, "residue": residue}}


def model(*parts, output="rate"):
    effects = [{"effect": effect, "params": params} for part in parts for effect, params in part.items()]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "output": output, "effects": effects})


def values(plant, effect):
    return plant.stack()[effect]


# ---- canonical stack -------------------------------------------------------------------------------


def test_a_mode_below_four_lowest_lines_is_low():
    assert has_low_mode(model(BODY, mode(7.9)), F_LO, DEFAULTS)
    assert not has_low_mode(model(BODY, mode(8.1)), F_LO, DEFAULTS)


def test_a_body_and_a_low_mode_are_one_sprung_body():
    stack = canonical_stack(model(BODY, VISCOUS, mode(5.0, 0.5), mode(40.0)), F_LO, DEFAULTS)
    w0 = 2 * np.pi * 5.0
    assert values(stack, "rigid_body")["gain"] == pytest.approx(15.0)
    assert values(stack, "viscous_friction")["rate"] == pytest.approx(2 * 0.02 * w0)
    assert values(stack, "cable_spring")["stiffness"] == pytest.approx(w0**2)
    assert [e.params["f_hz"].value for e in stack.effects if e.id == "flexible_mode"] == [40.0]


def test_beside_a_spring_a_low_mode_is_left_out():
    stack = canonical_stack(model(BODY, VISCOUS, SPRING, mode(5.0)), F_LO, DEFAULTS)
    assert values(stack, "cable_spring") == SPRING["cable_spring"]
    assert values(stack, "rigid_body")["gain"] == 10.0
    assert "flexible_mode" not in stack.stack()


def test_without_merging_a_low_mode_stays():
    stack = canonical_stack(model(BODY, VISCOUS, mode(5.0)), F_LO, DEFAULTS, merged=False)
    assert values(stack, "flexible_mode")["f_hz"] == 5.0
    assert values(stack, "rigid_body")["gain"] == 10.0


def test_what_the_start_did_not_find_is_in_the_stack():
    stack = canonical_stack(model(BODY), F_LO, DEFAULTS)
    assert values(stack, "viscous_friction")["rate"] == pytest.approx(0.5 * CORNER)
    assert values(stack, "cable_spring")["stiffness"] == pytest.approx((0.5 * CORNER) ** 2)
    assert values(stack, "sensor_lag")["time_constant_s"] == pytest.approx(0.5 / FS_HZ)
    assert values(stack, "transport_delay")["delay_s"] == pytest.approx(0.5 / FS_HZ)
    assert set(stack.free_names) == {f"{e}.{p}" for e, params in stack.stack().items() for p in params}


def test_a_lag_of_the_actuator_is_the_lag():
    stack = canonical_stack(model(BODY, {"motor_lag": {"time_constant_s": 1e-3}}), F_LO, DEFAULTS)
    assert "sensor_lag" not in stack.stack()
    assert values(stack, "motor_lag")["time_constant_s"] == 1e-3


@pytest.mark.parametrize("factor", [0.98, 1.02])
def test_elements_whose_values_vanished_are_dropped(factor):
    """0.02 of the corner of the lowest line, and 0.02 of a sample."""
    corner = 0.02 * CORNER
    parts = {
        "viscous_friction": {"rate": corner * factor},
        "cable_spring": {"stiffness": corner**2 * factor},
        "sensor_lag": {"time_constant_s": 0.02 / FS_HZ * factor},
        "transport_delay": {"delay_s": 0.02 / FS_HZ * factor},
    }
    left = pruned(model(BODY, parts), F_LO, DEFAULTS).stack()
    assert set(left) == {"rigid_body"} | (set(parts) if factor > 1 else set())


def test_bug_the_damping_of_a_slow_resonance_was_dropped():
    """Its corner is far below the lowest line, and its resonance is not: the cost was 1.2 on 1200 numbers."""
    parts = {"viscous_friction": {"rate": 1e-3 * CORNER}, "cable_spring": {"stiffness": CORNER**2}}
    assert "viscous_friction" in pruned(model(BODY, parts), F_LO, DEFAULTS).stack()


def with_std(plant, **std):
    effects = []
    for effect in plant.effects:
        params = {n: Param(p.value, True, std.get(effect.id)) for n, p in effect.params.items()}
        effects.append(replace(effect, params=params))
    return replace(plant, effects=effects)


def test_an_element_within_three_standard_deviations_may_be_zero():
    plant = model(BODY, VISCOUS, SPRING, LAG, DELAY)
    sizes = {"viscous_friction": 3.0 / 2.9, "cable_spring": 500.0 / 3.1, "sensor_lag": 2e-3 / 2.0}
    assert insignificant(with_std(plant, **sizes, transport_delay=1e-6), DEFAULTS) == [
        "sensor_lag",
        "viscous_friction",
    ]
    # What is not determined may be zero as well; the gain may not.
    assert insignificant(with_std(plant, viscous_friction=np.nan, rigid_body=100.0), DEFAULTS) == [
        "viscous_friction",
        "cable_spring",
        "sensor_lag",
        "transport_delay",
    ]


def test_the_lowest_resonance_becomes_the_sprung_body_of_a_slow_one():
    stack = resonant_stack(model(BODY, VISCOUS, mode(30.0, 2.0), mode(60.0)), F_LO, DEFAULTS)
    assert values(stack, "rigid_body")["gain"] == pytest.approx(20.0)
    assert values(stack, "cable_spring")["stiffness"] == pytest.approx((2 * np.pi * 30) ** 2)
    assert [e.params["f_hz"].value for e in stack.effects if e.id == "flexible_mode"] == [60.0]
    # A body that resonates itself stays: damped less than critically.
    sprung = {"cable_spring": {"stiffness": 2.3}}
    assert resonant_stack(model(BODY, VISCOUS, sprung, mode(30.0)), F_LO, DEFAULTS) is None
    slow = {"cable_spring": {"stiffness": 2.2}}
    assert resonant_stack(model(BODY, VISCOUS, slow, mode(30.0)), F_LO, DEFAULTS) is not None
    assert resonant_stack(model(BODY, VISCOUS), F_LO, DEFAULTS) is None


@pytest.mark.parametrize(
    ("output", "unit", "left"),
    [("rate", "deg/s", "deg/s"), ("rate", "deg", ""), ("angle", "deg", "deg"), ("angle", "rad/s", "")],
)
def test_a_unit_that_the_output_contradicts_is_removed(output, unit, left):
    line = np.arange(4)
    flat = np.ones((2, 4), complex)
    one = Spectra(FS_HZ, 8, line, flat, flat, 0, 0, excited=line > 0, y_unit=unit)
    (found,) = without_wrong_unit([one], model(BODY, output=output))
    assert found.y_unit == left


@pytest.mark.parametrize(
    ("unit", "output", "said"),
    [
        ("counts", "angle", "values in deg are in counts;"),
        ("rpm", "rate", "values in deg are in rpm;"),
        ("counts/s", "rate", "values in deg are in counts;"),
        ("deg/s", "rate", None),
        ("", "angle", None),
    ],
)
def test_values_of_an_output_in_counts_state_so(unit, output, said):
    """Bug: the gain of an axis measured in counts was printed in deg/s^2 without a word."""
    text = unit_of_values(unit, model(BODY, output=output))
    assert (text is None) == (said is None)
    assert said is None or said in text


# ---- linear effects first --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("effect", "share", "kind", "added"),
    [
        ("cable_spring", 0.26, "nearest", True),
        ("cable_spring", 0.24, "nearest", False),
        ("cable_spring", 0.9, "none", False),
        ("coulomb_friction", 0.9, "named", False),
        ("sensor_sample_hold", 0.0, "named", True),
    ],
)
def test_a_linear_effect_that_explains_a_quarter_enters_the_stack(effect, share, kind, added):
    best = SimpleNamespace(effects=(effect,), share_kept_out=share)
    stage = SimpleNamespace(ranking=[best], conclusion=SimpleNamespace(kind=kind), cost_per_dof=200.0)
    assert drafting._adds_linear(stage, DEFAULTS) is added


# ---- fits by simulation ----------------------------------------------------------------------------


def simulated(n_records=4, cost_left=0.0, slope=1.0, error=0.3, seed=1, periods=8):
    """A fit of one value with noise of variance 1 in each record, which depends on it by a column."""
    rng = np.random.default_rng(seed)
    records, jacobian, residual = [], [], []
    for _ in range(n_records):
        column = slope * rng.standard_normal((60, 1))
        noise = error * rng.standard_normal(60)
        records.append(SimpleNamespace(jacobian=column, residual=noise))
        jacobian.append(column)
        residual.append(noise)
    jacobian, residual = np.vstack(jacobian), np.concatenate(residual)
    best = np.linalg.lstsq(jacobian, residual, rcond=None)[0]
    for one in records:
        one.residual = one.residual - one.jacobian @ best + cost_left * one.jacobian[:, 0]
    plant = model(BODY, {"coulomb_friction": {"level": 2.0}})
    plant = replace(
        plant,
        effects=[
            replace(e, params={n: Param(p.value, e.id == "coulomb_friction") for n, p in e.params.items()})
            for e in plant.effects
        ],
    )
    whole = np.concatenate([one.residual for one in records])
    return SimpleNamespace(
        model=plant,
        records=records,
        jacobian=jacobian,
        residual=whole,
        cost=float(whole @ whole),
        converged=False,
    )


def test_a_fit_whose_next_step_is_below_noise_or_a_thousandth_has_converged():
    at_rest = simulated()
    assert has_converged(at_rest)
    size = np.sum(at_rest.jacobian**2)
    before, beyond = (simulated(cost_left=np.sqrt(drop / size)) for drop in (0.9, 1.1))
    assert has_converged(before)
    assert not has_converged(beyond)
    beyond.converged = True
    assert has_converged(beyond)
    large = simulated(error=100.0)
    drop = np.sqrt(0.9e-3 * large.cost / size), np.sqrt(1.2e-3 * large.cost / size)
    assert has_converged(simulated(error=100.0, cost_left=drop[0]))
    assert not has_converged(simulated(error=100.0, cost_left=drop[1]))


def test_the_kept_out_cost_is_that_of_records_left_out_and_fitted_again():
    """Against the fit without each record, done one by one."""
    fit = simulated(error=1.0)
    found = judged(fit, ("coulomb_friction",), DEFAULTS)
    squares, alone = 0.0, []
    for i, one in enumerate(fit.records):
        others = [r for j, r in enumerate(fit.records) if j != i]
        rows, left = np.vstack([r.jacobian for r in others]), np.concatenate([r.residual for r in others])
        moved = -np.linalg.lstsq(rows, left, rcond=None)[0]
        squares += np.sum((one.residual + one.jacobian @ moved) ** 2)
        alone.append(2.0 - np.linalg.lstsq(one.jacobian, one.residual, rcond=None)[0][0])
    assert found.kept == pytest.approx(squares / 240)
    assert found.scatter == pytest.approx(np.std(alone) / 2.0)
    errors = [1 / np.sum(one.jacobian**2) for one in fit.records]
    assert found.scatter_error == pytest.approx(np.sqrt(np.mean(errors)) / 2.0)


def test_a_linear_part_alone_has_no_scatter():
    found = judged(simulated(), (), DEFAULTS)
    assert (found.scatter, found.scatter_error) == (0.0, 0.0)


# ---- kept out in the first stage -------------------------------------------------------------------


def problem_of(n_records, n=60):
    rows = [np.arange(i * n, (i + 1) * n) for i in range(n_records)]
    return SimpleNamespace(records=[None] * n_records, rows_of=lambda i: rows[i], has_model_error=False)


def test_the_first_stage_keeps_out_as_fits_without_each_record_do():
    rng = np.random.default_rng(4)
    jacobian = rng.standard_normal((240, 2)) * [1.0, 50.0]
    error = rng.standard_normal(240)
    error -= jacobian @ np.linalg.lstsq(jacobian, error, rcond=None)[0]
    part = SimpleNamespace(values=np.array([7.0, 3.0]))
    fit = SimpleNamespace(error=error, part=part)
    kept, scatter, noise = keep_out(problem_of(4), fit, jacobian, 1)
    squares, alone, variances = 0.0, [], []
    for i in range(4):
        inside = np.arange(240) // 60 == i
        moved = -np.linalg.lstsq(jacobian[~inside], error[~inside], rcond=None)[0]
        squares += np.sum((error[inside] + jacobian[inside] @ moved) ** 2)
        alone.append(3.0 - np.linalg.lstsq(jacobian[inside], error[inside], rcond=None)[0][1])
        variances.append(np.linalg.inv(jacobian[inside].T @ jacobian[inside])[1, 1])
    assert kept == pytest.approx(squares / 240)
    assert scatter == pytest.approx(np.std(alone) / 3.0)
    assert noise == pytest.approx(np.sqrt(np.mean(variances)) / 3.0)


def test_a_coefficient_without_effect_has_an_infinite_scatter():
    rng = np.random.default_rng(5)
    jacobian = rng.standard_normal((240, 2)) * [1.0, 0.0]
    fit = SimpleNamespace(error=rng.standard_normal(240), part=SimpleNamespace(values=np.ones(2)))
    assert keep_out(problem_of(4), fit, jacobian, 1)[1:] == (np.inf, 0.0)


# ---- choices between fits --------------------------------------------------------------------------


class Costs:
    """Simulations whose costs are known by the effects of the model."""

    def __init__(self, costs):
        self.costs, self.asked = costs, []

    def fit(self, plant, effects):
        self.asked.append(frozenset(plant.stack()))
        cost = self.costs.get(self.asked[-1])
        return None if cost is None else SimpleNamespace(model=plant, cost=cost, effects=effects)


@pytest.mark.parametrize(("rise", "dropped"), [(7.9, True), (8.1, False)])
def test_an_element_that_may_be_zero_is_dropped_unless_the_cost_rises_by_eight(rise, dropped):
    plant = with_std(model(BODY, VISCOUS, SPRING), viscous_friction=2.0, cable_spring=1.0)
    fits = Costs({frozenset({"rigid_body", "cable_spring"}): 100.0 + rise})
    final = SimpleNamespace(model=plant, cost=100.0, effects=("coulomb_friction",))
    run = SimpleNamespace(simulations=lambda: fits, final=final, settings=DEFAULTS)
    mend_structure._drop_zeros(run)
    assert fits.asked == [frozenset({"rigid_body", "cable_spring"})]
    assert ("viscous_friction" not in run.final.model.stack()) is dropped


@pytest.mark.parametrize(("cost", "kept"), [(10.1, True), (9.9, False)])
def test_a_low_mode_stays_if_the_stack_without_it_costs_ten_times_as_much(monkeypatch, cost, kept):
    found = model(BODY, VISCOUS, mode(5.0))
    merged = canonical_stack(found, F_LO, DEFAULTS)
    monkeypatch.setattr(
        finding, "null_cost", lambda measured, plant, *_: 1.0 if "flexible_mode" in plant.stack() else cost
    )
    start = SimpleNamespace(model=lambda: found)
    facts = {"measured": [], "band": None, "deadline": None, "f_lo_hz": F_LO, "settings": DEFAULTS}
    run = SimpleNamespace(start=start, stack=merged, known_fits={}, **facts)
    finding._keep_resonances(run)
    assert ("flexible_mode" in run.stack.stack()) is kept


@pytest.mark.parametrize(
    ("kind", "effect", "cost", "doubtful"),
    [
        ("nearest", "coulomb_friction", 1.16, True),
        ("nearest", "coulomb_friction", 1.14, False),
        ("none", "coulomb_friction", 5.0, False),
        ("named", "coulomb_friction", 2.9, False),
        ("named", "coulomb_friction", 3.1, True),
        ("named", "cable_spring", 5.0, True),
        ("unknown", "cable_spring", 5.0, True),
    ],
)
def test_the_linear_part_is_doubtful_where_much_is_left_and_no_torque_law_is_named(
    kind, effect, cost, doubtful
):
    best = SimpleNamespace(effects=(effect,), cost_per_dof=cost)
    stage = SimpleNamespace(ranking=[best], conclusion=SimpleNamespace(kind=kind), cost_per_dof=200.0)
    assert drafting._is_doubtful(stage, DEFAULTS) is doubtful


def test_a_missing_spring_and_damping_are_tried_at_corners_in_lowest_lines():
    lines = SimpleNamespace(f_hz=np.array([2.0, 4.0]))
    scan = SimpleNamespace(problem=SimpleNamespace(first=[lines], settings=SEARCH))
    corner = 2 * np.pi * 2.0 * np.array([0.3, 0.7, 1.5, 3.0, 6.0, 12.0])
    for effect, expected in (("viscous_friction", corner), ("cable_spring", corner**2)):
        assert find(effect).parameters[0].grid is None
        assert ranking._linear_points(scan, find(effect), {}) == pytest.approx(expected)
    points = ranking._linear_points(scan, find("transport_delay"), {"sample": 1e-3})
    assert points == pytest.approx([1e-3, 3e-3, 8e-3, 16e-3])


@pytest.mark.parametrize(
    ("effect", "stiffness", "share", "cancels"),
    [
        ("cubic_spring", 25.0, -1.0, True),
        ("cubic_spring", 25.0, -0.5, False),
        ("cubic_spring", 25.0, 1.0, False),
        ("cubic_spring", 0.0, -1.0, False),
        ("coulomb_friction", 25.0, -1.0, False),
    ],
)
def test_a_law_whose_own_spring_cancels_that_of_the_linear_part(effect, stiffness, share, cancels):
    """The own spring of a cubic one is the regression of its torque on the angle."""
    angle = 0.3 + np.sin(np.linspace(0, 2 * np.pi, 400, endpoint=False))
    rate = np.gradient(angle)
    moved = Motion(1e-3, angle, rate, np.sign(rate), np.zeros(len(rate)), 0.0)
    around = angle - np.mean(angle)
    own = (angle**3 @ around) / (around @ around)
    problem = SimpleNamespace(stiffness=lambda part: stiffness, radians=np.pi / 180, settings=SEARCH)
    law = Law(find(effect), effect, "")
    c = np.array([share * 25.0 / own])
    one = SimpleNamespace(law=law, coefficients=c, shape=np.zeros(0), fit=SimpleNamespace(part=None))
    assert refitting._cancels_spring(problem, one, [moved]) is cancels


def test_an_unknown_hold_is_that_of_the_first_stage_from_then_on(monkeypatch):
    """Otherwise a linear effect that is added would be judged with both readings again."""
    line = np.arange(4)
    flat = np.ones((2, 4), complex)
    one = Spectra(FS_HZ, 8, line, flat, flat, 0, 0, excited=line > 0, hold=None)
    seen = []

    def stage(measured, plant, **_):
        seen.append([each.hold for each in measured])
        best = SimpleNamespace(
            effects=("cable_spring",), share_kept_out=1.0, linear=plant.stack(), cost_per_dof=1.0
        )
        kind = "named" if len(seen) == 1 else "none"
        conclusion = SimpleNamespace(kind=kind, effects=("cable_spring",))
        return SimpleNamespace(ranking=[best], conclusion=conclusion, hold="none", linear=plant.stack())

    monkeypatch.setattr(drafting, "first_stage", stage)
    how = {"band": None, "settings": DEFAULTS, "on_step": lambda step: None}
    drafting.draft([one], model(BODY), **how, deadline=Deadline(), from_data=True, linear_rounds=3)
    assert seen == [[None], ["none"]]


def test_thirds_of_the_lines_of_a_single_record_of_few_periods_are_left_out():
    one = simulated(n_records=1, error=1.0)
    one.records[0].line = np.arange(30)
    one.records[0].spectra = SimpleNamespace(n_periods=5)
    found = judged(one, ("coulomb_friction",), DEFAULTS)
    third = np.tile(np.arange(30) % 3, 2)
    squares = 0.0
    for i in range(3):
        inside = third == i
        moved = -np.linalg.lstsq(one.jacobian[~inside], one.residual[~inside], rcond=None)[0]
        squares += np.sum((one.residual[inside] + one.jacobian[inside] @ moved) ** 2)
    assert found.kept == pytest.approx(squares / 60)


# ---- the fit of the best law that was cut short -----------------------------------------------------

CUT_SHORT = {"converged": False, "stalled": False, "cost": 49.0}


@pytest.mark.parametrize(
    ("change", "is_finished"),
    [({}, True), ({"converged": True}, False), ({"stalled": True}, False), ({"cost": 51.0}, False)],
)
def test_the_best_law_is_finished_if_it_explains_most_and_was_cut_short(change, is_finished):
    best, rival, finished = (SimpleNamespace(**(CUT_SHORT | change)) for _ in range(3))
    fits = SimpleNamespace(finished=lambda one: finished)
    run = SimpleNamespace(final=best, laws=[rival, best], null=SimpleNamespace(cost=100.0), settings=DEFAULTS)
    run.deadline, run.decide = Deadline(), lambda: None
    fit_laws._finish_best(run, fits)
    assert run.laws == [rival, finished if is_finished else best]
    assert (run.laws[1] is finished) is is_finished


def test_the_laws_of_the_short_list_end_with_the_best_one_finished(monkeypatch):
    best, finished = SimpleNamespace(**CUT_SHORT), SimpleNamespace(**CUT_SHORT | {"converged": True})
    run = SimpleNamespace(laws=[], cut=False, deadline=Deadline(), given=None, settings=DEFAULTS, final=None)
    run.null, run.noise_p_value, run.alpha = SimpleNamespace(cost=100.0), 0.0, 0.05

    def decide():
        run.final = run.laws[0]

    run.decide = decide
    for further in ("_add_bias", "_fit_null_again"):
        monkeypatch.setattr(fit_laws, further, lambda run, fits: None)
    fits = SimpleNamespace(fit=lambda *_: best, finished=lambda one: finished)
    fit_laws._fit_laws(run, fits, [SimpleNamespace(model=None, effect="hard_stop")])
    assert run.laws == [finished]
    assert run.final is finished


@pytest.mark.parametrize(("cost", "is_taken"), [(9.0, True), (11.0, False), (OutOfTime(""), False)])
def test_a_fit_is_finished_with_work_of_its_own(monkeypatch, cost, is_taken):
    """Bug: a stop that left only noise was unknown, because its rivals had used up the work of its fit."""
    before = SimpleNamespace(effects=("hard_stop",), model="a model", fit=SimpleNamespace(cost=10.0))
    deadline = Deadline().bounded(0.0)  # used up by the fits so far
    fits = confirming.Simulations([None], None, deadline, DEFAULTS, lambda text: None)

    def in_slices(model, to_beat, its_deadline):
        assert (model, to_beat, its_deadline.moves_left) == ("a model", None, DEFAULTS.moves_of_fit)
        if isinstance(cost, Exception):
            raise cost
        return SimpleNamespace(cost=cost), True

    monkeypatch.setattr(fits, "_in_slices", in_slices)
    judged_now = confirming.Simulated(before.effects, None, False, 1.0, 0.0, 0.0)
    monkeypatch.setattr(confirming, "judged", lambda fit, effects, settings: judged_now)
    found = fits.finished(before)
    assert found is not before if is_taken else found is before
    assert not is_taken or (found.effects, found.stalled) == (before.effects, True)


# ---- what is left ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("p_value", "verdict"), [(1.1e-4, "adequate"), (0.9e-4, "unknown_effect")])
def test_without_a_law_the_linear_part_has_to_leave_noise(p_value, verdict):
    """Through `confirm`, which asks for it where nothing is found."""
    run = SimpleNamespace(
        in_closed_loop=False,
        timed=lambda step: nullcontext(),
        simulations=lambda: SimpleNamespace(not_tried={}),
        draft=SimpleNamespace(stage=SimpleNamespace(conclusion=SimpleNamespace(kind="none"))),
        on_step=SimpleNamespace(expect=lambda n: None),
        null="a fit",
        laws=[],
        decision=Decision("adequate"),
        accept_noise=lambda: None,
        noise_p_value=p_value,
        p_least=DEFAULTS.p_least,
        not_tried={},
    )
    run.check_adequate = lambda: Run.check_adequate(run)
    fit_laws.confirm(run)
    assert run.decision.verdict == verdict
    assert len(run.decision.reasons) == (verdict != "adequate")


@pytest.mark.parametrize(("residual", "settles"), [(1.9e-3, True), (2.1e-3, False)])
def test_a_simulation_settles_up_to_a_thousandth_of_its_rms(monkeypatch, residual, settles):
    answer = SimpleNamespace(settled=False, residual=residual, y=2.0 * np.array([1.0, -1.0]))
    plant = SimpleNamespace(run=lambda: answer, bound=lambda moves: None, moves=7)
    monkeypatch.setattr(confirming, "PeriodicPlant", SimpleNamespace(of=lambda *_: plant))
    fits, deadline = SimpleNamespace(measured=[None], settings=DEFAULTS), Deadline().bounded(10)
    assert confirming.Simulations._settles(fits, None, deadline) is settles
    assert deadline.moves_left == 3
    answer.settled = True
    assert confirming.Simulations._settles(fits, None, deadline)


@pytest.mark.parametrize(
    ("needed", "left", "why"),
    [
        (0.9, 5.0, "fitted"),
        (1.1, 5.0, "its simulation takes too long"),
        (0.9, 0.5, "its simulation takes too long"),
        (0.9, 0.0, "the work of all simulations was used up before its fit"),
    ],
)
def test_the_work_of_a_fit_and_that_of_all_fits_are_bounded(monkeypatch, needed, left, why):
    """In units of the work of one fit. A fit that takes too long leaves work for the others."""
    unit = DEFAULTS.moves_of_fit

    def fit_plant(model, measured, *, band, max_iter, deadline):
        is_enough = deadline.moves_left >= needed * unit
        deadline.spend(needed * unit)
        if not is_enough:
            raise OutOfTime("")
        return SimpleNamespace(cost=1.0, converged=True, unsettled=[], model=model)

    monkeypatch.setattr(confirming, "fit_plant", fit_plant)
    monkeypatch.setattr(confirming, "judged", lambda fit, effects, settings: simulated_law(fit, effects))
    monkeypatch.setattr(confirming.Simulations, "_settles", lambda *_: True)
    deadline = Deadline().bounded(left * unit)
    fits = confirming.Simulations([None], None, deadline, DEFAULTS, lambda text: None)
    start = model(BODY, {"hard_stop": {"angle_deg": 1.0, "stiffness": 1e3}})
    fitted = fits.fit(start, ("hard_stop",))
    assert (fitted is not None) is (why == "fitted")
    assert fits.not_tried.get("hard_stop", "fitted") == why
    assert deadline.moves_left == pytest.approx(unit * max(left - min(needed, 1.0), 0.0))


def test_play_has_work_of_its_own(monkeypatch):
    """It is tried last, when the other laws may have used up theirs."""
    given = []
    monkeypatch.setattr(confirming, "fit_play", lambda *how, **_: given.append(how[5].moves_left))
    deadline = Deadline().bounded(0.0)
    fits = confirming.Simulations([None], None, deadline, DEFAULTS, lambda text: None)
    assert fits.fit_play(SimpleNamespace(cost=0.0, n_dof=1), None, 0.0) is None
    assert given == [DEFAULTS.moves_of_play]


def simulated_law(fit, effects):
    return confirming.Simulated(effects, fit, True, 1.0, 0.0, 0.0)


@pytest.mark.parametrize(("lag_s", "delay_s"), [(1e-3, 2e-3), (5e-3, 0.0)])
def test_a_lag_that_is_tried_takes_its_delay_from_the_delay(lag_s, delay_s):
    part = linear_part(model(BODY, DELAY))
    larger = ranking.with_linear(part, find("sensor_lag"), lag_s)
    assert larger.stack["sensor_lag"]["time_constant_s"] == lag_s
    assert larger.stack["transport_delay"]["delay_s"] == pytest.approx(delay_s)


# ---- a linear effect that became zero ------------------------------------------------------------------


@pytest.mark.parametrize("left_out", [(), ("sensor_lag",)])
def test_bug_a_linear_effect_that_became_zero_was_fitted_by_simulation(left_out):
    """It had been removed from the stack, and the diagnosis ended in a StopIteration (98011, single 28)."""
    known = {"known": (), "left_out": left_out}
    fits = confirming.Simulations([None], None, Deadline(), DEFAULTS, lambda text: None, **known)
    start = model(BODY, VISCOUS, LAG) if left_out else model(BODY, VISCOUS)
    assert fits.fit(start, ("sensor_lag",)) is None
    why = "left out in a closed loop" if left_out else "zero in the first stage"
    assert fits.not_tried == {"sensor_lag": why}
