"""Each rule of the decision on fits by simulation, with numbers on both sides of its limit."""

from types import SimpleNamespace

import pytest
from scipy import special

from gsid.diagnosis.from_records.confirm import Simulated
from gsid.diagnosis.from_records.evidence import Evidence, contains, is_simpler_of_angle, may_be_noise
from gsid.diagnosis.from_records.result import Diagnosis, RankedLaw
from gsid.diagnosis.from_records.settings import DEFAULTS
from gsid.diagnosis.from_records.verdict import decide
from gsid.diagnosis.missing_torque.conclusion import too_close
from gsid.effects.types import catalogue

N_DOF = 2000  # two standard deviations of the mean cost are 0.063
LAW, OTHER_FAMILY, SIMPLER = "stribeck_friction", "cubic_spring", "coulomb_friction"


def fit(effect, per_dof, kept=None, records=4, periods=8, p_value=None, **changes):
    """A fit by simulation with this cost per degree of freedom.

    The p-value of what it leaves is that of a normal distribution, if it is not given.
    """
    spectra = SimpleNamespace(spectra=SimpleNamespace(n_periods=periods))
    undetermined = changes.pop("undetermined", [])
    of_plant = SimpleNamespace(
        cost=per_dof * N_DOF,
        cost_per_dof=per_dof,
        n_dof=N_DOF,
        undetermined=undetermined,
        records=[spectra] * records,
        model=SimpleNamespace(labels=lambda: [(effect, SimpleNamespace(id=effect))]),
    )
    facts = {"converged": True, "scatter": 0.01, "scatter_error": 0.001} | changes
    one = Simulated((effect,) if effect else (), of_plant, kept=per_dof if kept is None else kept, **facts)
    chance = special.ndtr((1 - per_dof) * (N_DOF / 2) ** 0.5)
    one.__dict__["noise_p_value"] = chance if p_value is None else p_value
    return one


def decision(best, *others, null=100.0, beaten_by=(), all_linear=True, left=(), gain=1e9, doubts=()):
    asked = {
        "what_is_left": lambda _, least: dict(left if gain >= least else ()),
        "doubts": lambda *_: list(doubts),
    }
    laws = [best, *others]
    return decide(Evidence(fit("", null), laws, beaten_by, DEFAULTS, (), all_linear, **asked))


RIVAL = fit(OTHER_FAMILY, 60.0)


def test_bug_an_unbalance_over_small_angles_kept_a_spring_from_its_name():
    """It is that spring with one parameter too many, of another family."""
    spring, unbalance = fit("cable_spring", 1.050), fit("mass_unbalance", 1.049)
    found = decision(spring, unbalance, fit("cubic_spring", 60.0))
    assert (found.verdict, found.effects) == ("missing_effect", ("cable_spring",))


@pytest.mark.parametrize(
    ("better", "verdict", "effect"),
    [
        (11, "missing_effect", "cable_spring"),
        (13, "nearest_effect", "cable_spring"),  # significantly better; the odds are for the spring
        (16, "nearest_effect", "motor_cogging"),
    ],
)
def test_bug_a_cogging_over_small_angles_kept_a_spring_from_its_name(better, verdict, effect):
    """It is that spring with two parameters too many (seed 5312: 4 of 15 springs were nearest)."""
    found = decision(fit("cable_spring", above(1.0, better)), fit("motor_cogging", 1.0))
    assert (found.verdict, found.effects) == (verdict, (effect,))


def test_a_law_that_does_not_contain_a_spring_keeps_it_from_its_name():
    found = decision(fit("cable_spring", above(1.0, 7)), fit("coulomb_friction", 1.0), null=1.5)
    assert found.verdict != "missing_effect"


def test_laws_of_the_position_and_those_with_a_memory_contain_a_spring():
    spring = fit("cable_spring", 1.0)
    containing = {one for one in catalogue() if contains(fit(one, 1.0), spring)}
    assert containing == {"mass_unbalance", "motor_cogging", "hard_stop", "presliding_friction", "bouc_wen"}


@pytest.mark.parametrize(
    ("cost", "verdict", "effects"),
    [
        (1.0, "nearest_effect", ("hard_stop",)),
        (1.16, "nearest_effect", ("drive_quantization",)),  # it leaves more than noise too
    ],
)
def test_bug_a_stop_that_one_realisation_touches_was_nearest_to_a_law_that_leaves_more_than_noise(
    cost, verdict, effects
):
    """It explains nothing where that one is left out (blind trial 110031 single 7)."""
    stop, rounding = fit("hard_stop", cost, kept=3.0), fit("drive_quantization", 1.2, kept=1.12)
    found = decision(stop, rounding, null=1.3)
    assert (found.verdict, found.effects) == (verdict, effects)


@pytest.mark.parametrize(("lead", "verdict"), [(99, "unknown_effect"), (101, "nearest_effect")])
def test_a_law_of_one_realisation_that_leaves_only_noise_is_nearest_if_it_is_clear(lead, verdict):
    found = decision(fit("hard_stop", 1.0, kept=3.0), null=1.0 + lead / N_DOF)
    assert (found.verdict, found.unexplained_share) == (verdict, None)


@pytest.mark.parametrize(("better", "verdict"), [(11, "missing_effect"), (13, "nearest_effect")])
def test_bug_frictions_that_do_not_slide_kept_a_spring_from_its_name(better, verdict):
    """Within their elastic travel they are that spring (seed 5314, cable_spring 12)."""
    spring, sliding = fit("cable_spring", above(1.0, better)), fit("presliding_friction", 1.0)
    assert decision(spring, sliding, fit("bouc_wen", 1.0), null=2.0).verdict == verdict


@pytest.mark.parametrize(("name", "verdict"), [("level", "nearest_effect"), ("angle_deg", "missing_effect")])
def test_bug_a_quadratic_spring_was_named_an_unbalance(name, verdict):
    """With 0.97, at a level 500 times the torque of the motor that the data did not determine."""
    best = fit("mass_unbalance", 1.0, undetermined=[f"mass_unbalance.{name}"])
    assert decision(best, fit("coulomb_friction", 60.0)).verdict == verdict


@pytest.mark.parametrize(("cost", "verdict"), [(1.0, "missing_effect"), (2.0, "nearest_effect")])
def test_bug_a_damping_with_the_corner_of_a_lag_was_not_named(cost, verdict):
    """The two poles are one: the data determine neither, but refute the model with one (seed 5320, 26)."""
    best = fit("viscous_friction", cost, undetermined=["viscous_friction.rate"])
    assert decision(best, fit("coulomb_friction", 60.0), null=1e4).verdict == verdict


@pytest.mark.parametrize(
    ("undetermined", "verdict"),
    [("flexible_mode#2.zeta", "nearest_effect"), ("flexible_mode.zeta", "missing_effect")],
)
def test_bug_an_undetermined_mode_of_the_model_counted_against_the_one_added(undetermined, verdict):
    """And that of the mode that was added did not."""
    best = fit("flexible_mode", 2.0, undetermined=[undetermined])
    modes = [(label, SimpleNamespace(id="flexible_mode")) for label in ("flexible_mode", "flexible_mode#2")]
    best.fit.model.labels = lambda: modes
    assert decision(best, RIVAL, null=1e4).verdict == verdict


@pytest.mark.parametrize(
    ("law", "scatter", "verdict"),
    [
        ("bouc_wen", 1.1, "nearest_effect"),
        ("bouc_wen", 0.9, "missing_effect"),
        ("presliding_friction", 1.1, "missing_effect"),  # of two parameters
        ("flexible_mode", 1.1, "missing_effect"),
    ],
)
def test_bug_a_creep_was_named_bouc_wen(law, scatter, verdict):
    """No record alone determined its stiffness (166 %), and the shapes made up for that (seed 103012)."""
    best = fit(law, 1.0, scatter=scatter, scatter_error=scatter)
    assert decision(best, RIVAL).verdict == verdict


@pytest.mark.parametrize(("better", "verdict"), [(11, "missing_effect"), (13, "nearest_effect")])
def test_bug_a_stop_without_a_gap_kept_a_spring_from_its_name(better, verdict):
    """It is that spring (seed 5314, cable_spring 3: a drop of 67 000)."""
    found = decision(fit("cable_spring", above(1.0, better)), fit("hard_stop", 1.0))
    assert found.verdict == verdict


@pytest.mark.parametrize(
    ("kept", "all_linear", "verdict"),
    [
        (1.08, True, "missing_effect"),
        (1.08, False, "nearest_effect"),
        (1.06, False, "missing_effect"),  # within two standard deviations of noise
    ],
)
def test_bug_a_mode_was_named_in_place_of_a_lag_that_was_left_out(kept, all_linear, verdict):
    """It left 9 % of the misfit on records kept out (seed 101012, single 12 without the lags)."""
    found = decision(fit("flexible_mode", 1.05, kept=kept), null=1.35, all_linear=all_linear)
    assert (found.verdict, found.effects) == (verdict, ("flexible_mode",))


def test_an_unbalance_that_is_significantly_better_than_a_spring_is_named():
    found = decision(fit("cable_spring", 9.0), fit("mass_unbalance", 1.0))
    assert (found.verdict, found.effects) == ("missing_effect", ("mass_unbalance",))


def above(cost, numbers):
    """A cost per degree of freedom that is higher by so much in all."""
    return cost + numbers / N_DOF


def test_bug_a_mode_that_does_the_same_kept_a_lag_from_its_name():
    """Its three parameters can take the place of any other linear effect: 98 of the cost were too little."""
    found = decision(fit("flexible_mode", 1.0), fit("motor_lag", above(1.0, 5)), null=above(1.0, 98))
    assert (found.verdict, found.effects) == ("missing_effect", ("motor_lag",))


@pytest.mark.parametrize(
    ("behind", "effects"),
    [(14, ("motor_lag",)), (28, ("flexible_mode", "motor_lag")), (30, ("flexible_mode",))],
)
def test_a_mode_needs_odds_against_a_lag_that_pay_for_its_parameters(behind, effects):
    """Two parameters more of ln 2000 each are 15.2, and odds of 1000 are 13.8."""
    found = decision(fit("flexible_mode", 1.0), fit("motor_lag", above(1.0, behind)), null=1.5)
    assert (found.verdict, found.effects) == ("missing_effect", effects)


@pytest.mark.parametrize(("drop", "verdict"), [(39, "nearest_effect"), (41, "missing_effect")])
def test_a_linear_effect_needs_a_drop_that_is_no_chance(drop, verdict):
    rival = fit("cubic_spring", above(1.0, drop - 5))
    assert decision(fit("motor_lag", 1.0), rival, null=above(1.0, drop)).verdict == verdict


@pytest.mark.parametrize(("behind", "verdict"), [(13, "nearest_effect"), (15, "missing_effect")])
def test_a_law_that_may_stand_for_a_linear_effect_keeps_it_from_its_name(behind, verdict):
    """Odds of 1000 are 13.8."""
    rival = fit("quadratic_drag", above(1.0, behind))
    assert decision(fit("cable_spring", 1.0), rival, null=1.2).verdict == verdict


@pytest.mark.parametrize(("behind", "group"), [(13, True), (15, False)])
def test_linear_effects_that_the_data_do_not_distinguish_form_a_group(behind, group):
    found = decision(fit("cable_spring", 1.0), fit("viscous_friction", above(1.0, behind)), null=1.2)
    assert found.verdict == "missing_effect"
    assert found.effects == ("cable_spring", *["viscous_friction"] * group)


@pytest.mark.parametrize("drag", [-5, 13])
def test_bug_a_drag_that_the_data_do_not_distinguish_hid_a_damping(drag):
    """It was the nearest alone, where its cost was 1 lower."""
    found = decision(fit("viscous_friction", 1.0), fit("quadratic_drag", above(1.0, drag)), null=1.2)
    assert (found.verdict, found.effects) == ("missing_effect", ("viscous_friction", "quadratic_drag"))


@pytest.mark.parametrize(
    ("hysteresis", "verdict"), [(7, "missing_effect"), (-11, "missing_effect"), (-13, "nearest_effect")]
)
def test_bug_a_larger_law_of_the_group_kept_it_from_its_name(hysteresis, verdict):
    """Seed 5318: a damping or a dry friction was nearest beside a hysteresis that cost 7 more."""
    friction, larger = fit("coulomb_friction", above(1.0, 5)), fit("bouc_wen", above(1.0, hysteresis))
    found = decision(fit("viscous_friction", 1.0), friction, larger, null=1.2)
    assert (found.verdict, found.effects) == (verdict, ("viscous_friction", "coulomb_friction"))


def test_a_group_with_a_law_needs_the_large_lead():
    """A law outside the catalogue may be imitated by both."""
    found = decision(fit("viscous_friction", 1.0), fit("quadratic_drag", above(1.0, 5)), null=above(1.0, 98))
    assert (found.verdict, found.effects) == ("nearest_effect", ("viscous_friction", "quadratic_drag"))


@pytest.mark.parametrize(("law", "named"), [("quadratic_drag", -15), ("stribeck_friction", -45)])
def test_a_law_that_is_clearly_better_than_a_damping_is_not_grouped_with_it(law, named):
    found = decision(fit("viscous_friction", 1.0), fit(law, above(1.0, named)), null=1.2)
    assert found.effects == (law,)


def test_a_linear_effect_needs_the_large_lead_where_others_were_left_out():
    """A lag that was left out is imitated by a mode to some percent, which are less than noise."""
    mode, rival = fit("flexible_mode", 1.0), fit("cubic_spring", above(1.0, 80))
    assert decision(mode, rival, null=above(1.1, 0)).verdict == "missing_effect"
    assert decision(mode, rival, null=above(1.1, 0), all_linear=False).verdict == "nearest_effect"


def test_a_law_that_leaves_little_is_named():
    found = decision(fit(LAW, 2.0), RIVAL)
    assert (found.verdict, found.effects, found.reasons) == ("missing_effect", (LAW,), ())
    assert found.unexplained_share == pytest.approx(0.0095, abs=5e-4)


# What is changed, the verdict just beyond the limit, and the one just before it.
LIMITS = {
    "share of a name, 0.9": ({"per_dof": 11.2}, "nearest_effect", {"per_dof": 10.4}, "missing_effect"),
    "share of a nearest, 0.5": ({"per_dof": 51.0}, "unknown_effect", {"per_dof": 49.0}, "nearest_effect"),
    "scatter of a name, 6 %": ({"scatter": 0.07}, "nearest_effect", {"scatter": 0.05}, "missing_effect"),
    "scatter of a nearest, 30 %": ({"scatter": 0.31}, "unknown_effect", {"scatter": 0.29}, "nearest_effect"),
    "scatter within 2.5 errors": (
        {"scatter": 0.26, "scatter_error": 0.1},
        "nearest_effect",
        {"scatter": 0.24, "scatter_error": 0.1},
        "missing_effect",
    ),
    "convergence": ({"converged": False}, "nearest_effect", {"converged": True}, "missing_effect"),
    "no convergence, and a rival that leaves 6 times as much": (
        {"converged": False, "per_dof": 10.9},
        "unknown_effect",
        {"converged": False, "per_dof": 10.7},
        "nearest_effect",
    ),
    "neither convergence nor refits without each record": (
        {"converged": False, "per_dof": 12.0},
        "unknown_effect",
        {"converged": False, "per_dof": 12.0, "left_out": ()},
        "nearest_effect",
    ),
    "a stalled fit that leaves more than noise": (
        {"converged": False, "stalled": True},
        "nearest_effect",
        {"converged": False, "stalled": True, "per_dof": 1.02},
        "missing_effect",
    ),
    "determined": (
        {"undetermined": [f"{LAW}.level"]},
        "nearest_effect",
        {"undetermined": [f"{OTHER_FAMILY}.stiffness"]},
        "missing_effect",
    ),
    "a cost below that of the linear part": (
        {"per_dof": 100.0, "kept": 20.0},
        "unknown_effect",
        {"per_dof": 99.0, "kept": 20.0},
        "nearest_effect",
    ),
}


@pytest.mark.parametrize("rule", LIMITS)
def test_each_limit_from_both_sides(rule):
    beyond, verdict_beyond, before, verdict_before = LIMITS[rule]
    found = decision(fit(LAW, **{"per_dof": 2.0} | beyond), RIVAL)
    assert found.verdict == verdict_beyond, found.reasons
    assert found.reasons
    found = decision(fit(LAW, **{"per_dof": 2.0} | before), RIVAL)
    assert found.verdict == verdict_before, found.reasons


@pytest.mark.parametrize(
    ("periods", "misfit", "verdict"),
    [(5, 9.0, "nearest_effect"), (5, 11.0, "missing_effect"), (6, 9.0, "missing_effect")],
)
def test_a_single_record_of_few_periods_needs_a_misfit_far_above_noise(periods, misfit, verdict):
    assert decision(fit(LAW, 1.5, records=1, periods=periods), RIVAL, null=misfit).verdict == verdict


@pytest.mark.parametrize(("rival", "verdict"), [(6.5, "nearest_effect"), (7.5, "missing_effect")])
def test_the_best_other_family_has_to_leave_six_times_as_much(rival, verdict):
    assert decision(fit(LAW, 2.0), fit(OTHER_FAMILY, rival)).verdict == verdict


@pytest.mark.parametrize(("rival", "verdict"), [(1.06, "nearest_effect"), (1.08, "missing_effect")])
def test_where_only_noise_is_left_the_cost_has_to_be_a_hundred_lower(rival, verdict):
    assert decision(fit(LAW, 1.02), fit(OTHER_FAMILY, rival), null=1.5).verdict == verdict


@pytest.mark.parametrize(("gain", "verdict"), [(32.0, "adequate"), (34.0, "nearest_effect")])
def test_a_law_needs_more_than_the_drop_that_chance_gives_the_best_of_many(gain, verdict):
    """A bug: a null became a nearest unbalance. 32.6 for one parameter: 25 and the logarithm of 2000."""
    found = decision(fit(SIMPLER, 1.0 - gain / N_DOF), fit(OTHER_FAMILY, 1.0), null=1.0)
    assert found.verdict == verdict
    assert bool(found.effects) == (verdict != "adequate")


@pytest.mark.parametrize(("n_dof", "expected"), [(760, True), (2000, False)])
def test_bug_a_null_of_few_lines_had_a_nearest_effect(n_dof, expected):
    """A cost of 1.13 is 2.5 standard deviations of 760 numbers, and 4 of 2000."""
    null = SimpleNamespace(fit=SimpleNamespace(cost_per_dof=1.13, n_dof=n_dof))
    assert may_be_noise(null, DEFAULTS) is expected


@pytest.mark.parametrize(("null", "verdict"), [(1.09, "adequate"), (1.11, "nearest_effect")])
def test_nothing_is_missing_only_where_the_linear_part_leaves_noise(null, verdict):
    assert decision(fit(SIMPLER, null - 0.004), fit(OTHER_FAMILY, null), null=null).verdict == verdict


@pytest.mark.parametrize(("rival", "verdict"), [(1.18, "nearest_effect"), (1.2, "missing_effect")])
def test_what_a_law_leaves_counts_as_half_the_scatter_of_noise_at_least(rival, verdict):
    """0.032 of a cost per number; six times that is 0.19."""
    assert decision(fit(LAW, 1.0), fit(OTHER_FAMILY, 1.03, kept=rival), null=1.5).verdict == verdict


@pytest.mark.parametrize(("left", "verdict"), [(1.0, "nearest_effect"), (1.3, "unknown_effect")])
def test_bug_a_law_that_left_only_noise_was_unknown_where_its_fit_had_not_converged(left, verdict):
    """Further iterations can only lower its cost (seed 110019, single 29, a cogging)."""
    rival = fit(OTHER_FAMILY, left + 0.03, kept=left + 0.15)
    assert decision(fit(LAW, left, converged=False), rival, null=1.5).verdict == verdict


@pytest.mark.parametrize(("better", "first"), [(13, "quadratic_drag"), (15, "cubic_spring")])
def test_bug_a_stop_was_nearest_to_a_rounding_that_was_far_less_likely(better, first):
    """By the scatter of what is kept out; its cost was 34 lower (seed 110016, single 38, a drop of 130)."""
    less_likely = fit("quadratic_drag", above(1.0, better), kept=1.02)
    found = decision(less_likely, fit("cubic_spring", 1.0, kept=1.03), null=1.2)
    assert found.effects[0] == first


@pytest.mark.parametrize("converged", [True, False])
def test_a_rival_that_has_not_converged_counts_with_what_its_minimum_leaves(converged):
    """It was given up early: the cost that it had reached is no evidence against it."""
    rival = fit("cubic_spring", 3.2, kept=1.32, converged=converged)
    assert decision(fit("coulomb_friction", 1.3), rival).verdict == "nearest_effect"


@pytest.mark.parametrize(
    ("effect", "cost", "all_linear", "verdict", "unexplained"),
    [
        ("motor_lag", 1.09, True, "missing_effect", 0.0),
        ("motor_lag", 1.10, True, "nearest_effect", 0.185),  # above three standard deviations
        ("motor_lag", 1.09, False, "nearest_effect", 0.135),
        ("coulomb_friction", 1.09, True, "nearest_effect", 0.135),
    ],
)
def test_bug_a_share_of_a_small_misfit_kept_a_lag_from_its_name(
    effect, cost, all_linear, verdict, unexplained
):
    """It explained 75 % of 66, and what it left was not significant (5319, lag 12)."""
    found = decision(fit(effect, cost), null=1.2, all_linear=all_linear)
    assert found.verdict == verdict
    assert found.unexplained_share == pytest.approx(unexplained, abs=2e-3)


@pytest.mark.parametrize(
    ("p_value", "verdict"),
    [(0.0014, "missing_effect"), (0.0013, "nearest_effect"), (0.0213, "missing_effect")],
)
def test_bug_a_complete_model_of_four_periods_explained_72_percent(p_value, verdict):
    """Three standard deviations of its cost were those of better known variances: the p-value was 0.02
    (5327, damping 21)."""
    found = decision(fit("viscous_friction", 1.079, kept=1.085, p_value=p_value), null=1.13)
    assert found.verdict == verdict


@pytest.mark.parametrize(
    ("p_value", "has_model_error", "adequate"),
    [(0.051, False, True), (0.049, False, False), (0.051, True, False)],
)
def test_bug_a_complete_model_of_three_periods_left_more_than_noise(p_value, has_model_error, adequate):
    """Its cost was 1.20 times that of noise, by chance (p = 0.08): a damping was only nearest (5325, 26)."""
    null = fit("", 100.0, weighed=1.0 if has_model_error else None)
    damping = fit("viscous_friction", 1.2, p_value=p_value)
    assert Evidence(null, [damping], (), DEFAULTS).is_adequate(damping) == adequate


@pytest.mark.parametrize(
    ("more", "group"),
    [(13, ("motor_lag", "transport_delay")), (14, ("motor_lag",)), (-1, ("transport_delay", "motor_lag"))],
)
def test_bug_a_delay_was_named_a_lag_because_both_are_of_one_family(more, group):
    """Its cost was 12.8 higher, significant within a family; the odds of 600 exclude it no more than another
    linear effect (5320, delay 72)."""
    assert decision(fit("motor_lag", 1.0), fit("transport_delay", above(1.0, more))).effects == group


@pytest.mark.parametrize(("drop", "best", "share"), [(0, OTHER_FAMILY, 0.0), (1, LAW, 1.0)])
def test_bug_a_law_without_strength_was_kept_out_best(drop, best, share):
    """A cogging of level 0 explained "100 %": linearised there any shape is as good (110014, single 26)."""
    law, other = fit(LAW, above(2.0, -drop), kept=1.0), fit(OTHER_FAMILY, 1.95, kept=1.9)
    evidence = Evidence(fit("", 2.0), [law, other], (), DEFAULTS)
    assert evidence.best().effects == (best,)
    assert evidence.share(law) == pytest.approx(share, abs=evidence.noise)


def test_a_law_that_leaves_more_than_noise_is_the_best_where_it_was_not_fitted():
    """Its cost may be higher: the other one takes up errors of a model."""
    least = fit("quadratic_drag", 2.1, kept=2.2)
    assert decision(least, fit("cubic_spring", 2.0, kept=9.0)).effects == ("quadratic_drag",)


def test_a_law_from_outside_that_explains_more_leaves_it_unknown():
    found = decision(fit(LAW, 2.0), RIVAL, beaten_by=("c*w^3",))
    assert (found.verdict, found.effects) == ("unknown_effect", ())
    assert found.reasons == ("In the first stage c*w^3 explains more, and is not in the catalogue.",)


def test_a_law_that_leaves_only_noise_is_the_nearest_beside_one_from_outside():
    found = decision(fit(LAW, 1.0), RIVAL, beaten_by=("c*w^3",))
    assert (found.verdict, found.effects) == ("nearest_effect", (LAW,))


@pytest.mark.parametrize(
    ("law", "beaten", "left", "reasons"),
    [
        (LAW, LAW, 1.0, 1),
        (LAW, SIMPLER, 1.0, 1),
        (LAW, OTHER_FAMILY, 1.0, 0),
        (LAW, OTHER_FAMILY, 2.0, 1),
        (LAW, "", 1.0, 1),
        ("hard_stop", "cubic_spring", 1.0, 0),
        ("hard_stop", "hard_stop", 1.0, 1),
        ("motor_cogging", "cubic_spring", 1.0, 1),
    ],
)
def test_bug_a_law_from_outside_that_beat_another_one_kept_a_stop_from_its_name(law, beaten, left, reasons):
    """A search of its own found the stop; the first stage had a friction that explained 4 % (98011, 28)."""
    evidence = Evidence(fit("", 100.0), [fit(law, left), RIVAL], ("c*w^3",), DEFAULTS, beaten=beaten)
    assert len(evidence.from_outside(evidence.laws[0])) == reasons


@pytest.mark.parametrize(
    ("simpler", "named"),
    [(1.004, (SIMPLER,)), (1.008, (LAW, SIMPLER)), (1.012, (LAW, SIMPLER)), (1.014, (LAW,))],
)
def test_the_simpler_law_is_named_unless_it_is_clearly_worse(simpler, named):
    """12 units of the cost are 0.006 per degree of freedom, 25 are 0.0125; between them both are named.

    Bug: a Coulomb friction was called Stribeck friction at 13 (blind study, seed 94014, single 7).
    """
    assert decision(fit(LAW, 1.0), fit(SIMPLER, simpler), RIVAL).effects == named


@pytest.mark.parametrize(("other", "group"), [(1.004, True), (1.008, False)])
def test_laws_of_one_family_that_are_as_good_form_a_group(other, group):
    found = decision(fit("cubic_spring", 1.0), fit("quadratic_spring", other), fit(LAW, 60.0))
    assert found.verdict == "missing_effect"
    assert found.effects == ("cubic_spring", *["quadratic_spring"] * group)


@pytest.mark.parametrize(
    ("law", "best", "expected"),
    [
        ("cubic_spring", "motor_cogging", True),
        ("mass_unbalance", "motor_cogging", False),  # with a constant torque it has as many parameters
        ("coulomb_friction", "motor_cogging", False),
        ("coulomb_friction", "stribeck_friction", False),  # a spring takes the constant torque
        ("motor_cogging", "cubic_spring", False),
    ],
)
def test_a_constant_torque_is_tried_beside_simpler_laws_of_the_angle(law, best, expected):
    """A bug: cogging was named where a cubic spring has an offset, of which it is one number of cycles."""
    assert is_simpler_of_angle(fit(law, 1.2), fit(best, 1.0)) is expected


def test_bug_the_table_printed_shares_of_minus_a_billion_percent():
    bad = RankedLaw(("flexible_mode",), {}, 1.0, -8.1e8, 0.1, 340.0, False)
    fair = RankedLaw(("coulomb_friction",), {}, 1.0, 0.98, 30.0, 0.007, True)
    text = Diagnosis.table(SimpleNamespace(ranking=[fair, bad])).text()
    assert "98.0%" in text
    assert "0.70%" in text
    assert "< 0%" in text
    assert "> 100%" in text
    assert "000" not in text


@pytest.mark.parametrize(("lead", "text"), [(41.0, "41 higher"), (-19.0, "lower by 19")])
def test_bug_a_cost_was_minus_nineteen_higher(lead, text):
    assert text in too_close(1.0, lead)


@pytest.mark.parametrize(
    ("other", "null", "text"),
    [
        (
            6.5,
            100.0,
            "The best law of another family leaves only 5.5 times as much, and its cost is 9000 higher.",
        ),
        (6.5, 6.0, "The linear part alone leaves 5 times what the best law leaves; its cost is 8000 higher."),
    ],
)
def test_bug_the_fit_without_a_law_was_called_a_law_of_another_family(other, null, text):
    """Where no law of another family costs less than the linear part alone."""
    found = decision(fit(LAW, 2.0), fit(OTHER_FAMILY, other), null=null)
    assert any(reason.startswith(text) for reason in found.reasons)


def test_the_reasons_name_the_numbers_that_are_required():
    reasons = decision(fit(LAW, 30.0, scatter=0.2, records=1, periods=2), RIVAL, null=90.0).reasons
    assert reasons[0] == "The best law explains 67 % of the misfit on held-out data; 90 % are required."
    assert reasons[2] == "The coefficient of the best law varies by 20 % between realisations."
    reasons = decision(fit(LAW, 1.5, records=1, periods=2), RIVAL, null=9.0).reasons
    assert "One record of 2 periods is too short to measure the scatter" in reasons[-1]
    assert "6 periods are required" in reasons[-1]


def test_a_linear_effect_has_to_explain_nearly_all():
    found = decision(fit("sensor_lag", 2.0), RIVAL)
    required = "A linear effect has to explain 99.5 % of the misfit on held-out data"
    assert found.reasons == (f"{required}; the best one explains 99.05 %.",)


@pytest.mark.parametrize(("p_value", "verdict"), [(0.0009, "nearest_effect"), (0.0011, "missing_effect")])
def test_a_law_whose_rest_depends_on_a_coordinate_is_the_nearest(p_value, verdict):
    """Its cost is that of noise, which is a weak statement of thousands of numbers."""
    found = decision(fit(LAW, 1.0), RIVAL, left={"the rate": p_value, "the angle": 1.0})
    assert found.verdict == verdict
    assert found.reasons == () or "depends on the rate (p = 0.0009)" in found.reasons[0]


def test_where_more_than_noise_is_left_its_coordinates_are_not_asked_for():
    assert decision(fit(LAW, 2.0), RIVAL, left={"the rate": 0.0}).verdict == "missing_effect"


@pytest.mark.parametrize(("share", "verdict"), [(0.004, "missing_effect"), (0.006, "nearest_effect")])
def test_bug_a_thousandth_that_a_lag_left_kept_it_from_its_name(share, verdict):
    """34 of 1.2 million; of a lag that leaves more than noise 0.5 % may be left (seed 5322, lag 13)."""
    left = {"left": {"the angle": 1e-4}, "gain": share * 99 * N_DOF}
    assert decision(fit("motor_lag", 1.0), RIVAL, **left).verdict == verdict


def test_a_law_that_is_in_doubt_is_the_nearest():
    found = decision(fit(LAW, 1.0), RIVAL, doubts=("It is on one line.",))
    assert (found.verdict, found.reasons) == ("nearest_effect", ("It is on one line.",))


@pytest.mark.parametrize(("error", "verdict"), [(0.29, "missing_effect"), (0.31, "nearest_effect")])
def test_bug_a_coefficient_that_noise_varies_at_will_was_the_same_in_all_realisations(error, verdict):
    """A creep was named bouc_wen: what was left was not noise, and its scatter of 170 % was within errors."""
    found = decision(fit(LAW, 2.0, scatter=0.2, scatter_error=error), RIVAL)
    assert found.verdict == verdict
