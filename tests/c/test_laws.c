/* Laws of the user's own: expressions and tables against the catalogue, against brute force, and their derivatives against
 * differences; laws that are too steep to follow. */
#include "plant_bench.h"

#include "gsid/expression.h"
#include "gsid/table.h"

#ifdef GSID_SINGLE
#define TOLERANCE 1e-3 /* of the peak, as in test_effects.c */
#else
#define TOLERANCE 3e-5
#define SLOPE 1e-4 /* of the derivative's peak: differences of runs whose steps are not cut alike */
#define BUMP 1e-5 /* of the parameter */
#endif

#define NUMBER(x) {GSID_EXPRESSION_NUMBER, 0, GSID_R(x)}
#define VALUE(k) {GSID_EXPRESSION_PARAMETER, k, 0}
#define DO(name) {GSID_EXPRESSION_##name, 0, 0}
#define LENGTH(list) (sizeof(list) / sizeof *(list))
#define FROM(list) {LENGTH(list), list}

enum { N = 400, SUBSTEPS = 512 };
static bench a, b;
static gsid_real y[N], other[N], dy[FREE_MAX * N];
#ifndef GSID_SINGLE
static gsid_real bumped[N];
#endif

static void make(gsid_effect *effect, const gsid_expression *expression, uint32_t n_parameters) {
    const gsid_effect_parameter any = {"p", "", 1, GSID_R(-1e9), GSID_R(1e9), NAN};
    memset(effect, 0, sizeof *effect);
    effect->n_parameters = n_parameters;
    for (uint32_t k = 0; k < n_parameters; k++) {
        effect->parameter[k] = any;
    }
    assert_int_equal(gsid_expression_effect(expression, effect), GSID_OK);
}

static gsid_plant_item *add(bench *to, const gsid_effect *effect, const void *data, double v0, double v1) {
    gsid_plant_item *item = &to->item[to->cfg.n_items++];
    memset(item, 0, sizeof *item);
    item->effect = effect;
    item->data = data;
    item->value[0] = (gsid_real)v0;
    item->value[1] = (gsid_real)v1;
    return item;
}

static gsid_status step_all(bench *to, double size, gsid_real *out, gsid_real *slopes) {
    for (uint32_t n = 0; n < N; n++) {
        gsid_real here[FREE_MAX];
        const gsid_status status =
            gsid_plant_step(&to->plant, (gsid_real)bench_command(N, n, size), &out[n], slopes != NULL ? here : NULL);
        if (status != GSID_OK) {
            return status;
        }
        for (uint32_t p = 0; slopes != NULL && p < to->cfg.n_free; p++) {
            slopes[p * N + n] = here[p];
        }
    }
    return GSID_OK;
}

static double peak(const gsid_real *x) {
    double largest = 0;
    for (int n = 0; n < N; n++) {
        largest = fmax(largest, fabs((double)x[n]));
    }
    return largest;
}

static void assert_same(const gsid_real *got, const gsid_real *want, double tolerance) {
    for (int n = 0; n < N; n++) {
        assert_near((double)got[n], (double)want[n], tolerance * peak(want));
    }
}

/* Every derivative of the simulation against its difference; differences of a float simulation are rounding only. */
static void assert_slopes(bench *of, double size) {
#ifdef GSID_SINGLE
    (void)of;
    (void)size;
#else
    bench_free_all(of);
    bench_init(of);
    assert_int_equal(step_all(of, size, y, dy), GSID_OK);
    for (uint32_t p = 0; p < of->cfg.n_free; p += (uint32_t)repeats(1, 3)) {
        gsid_real *value = &of->item[of->free_parameter[p].item].value[of->free_parameter[p].parameter];
        const gsid_real kept = *value, bump = (gsid_real)(BUMP * fmax(fabs((double)kept), 1e-4));
        gsid_real *sides[2] = {bumped, other};
        for (int i = 0; i < 2; i++) {
            *value = i == 0 ? kept + bump : kept - bump;
            bench_init(of);
            assert_int_equal(step_all(of, size, sides[i], NULL), GSID_OK);
        }
        *value = kept;
        for (int n = 0; n < N; n++) {
            bumped[n] = (bumped[n] - other[n]) / (2 * bump);
        }
        assert_same(bumped, dy + p * N, SLOPE);
    }
#endif
}

/* ---- expressions ---- */

static const gsid_expression_step cubic[] = {VALUE(0), DO(ANGLE), NUMBER(3.0), DO(POWER), DO(MULTIPLY)};
static const gsid_expression_step drag[] = {VALUE(0), DO(RATE), DO(MULTIPLY), DO(RATE), DO(ABS), DO(MULTIPLY)};
static const gsid_expression_step push[] = {VALUE(0), DO(COMMAND), DO(MULTIPLY), DO(NEGATE)};
static const gsid_expression_step grease[] = {VALUE(0), DO(RATE), VALUE(1), DO(DIVIDE), DO(TANH), DO(MULTIPLY)};

static void test_an_expression_is_the_catalogue_law(void **state) {
    (void)state;
    static const struct {
        const char *id;
        gsid_expression law;
        double value;
    } same[] = {{"cubic_spring", FROM(cubic), 40.0}, {"quadratic_drag", FROM(drag), 0.3}};
    for (size_t i = 0; i < LENGTH(same); i++) {
        gsid_effect effect;
        make(&effect, &same[i].law, 1);
        assert_int_equal(effect.looks_at_angle, i == 0);
        bench_clear(&a);
        bench_clear(&b);
        bench_add_source(&a);
        bench_add_source(&b);
        bench_add_with(&a, same[i].id, same[i].value, 0, 0);
        add(&b, &effect, &same[i].law, same[i].value, 0);
        bench_init(&a);
        assert_int_equal(step_all(&a, 40.0, other, NULL), GSID_OK);
        bench_init(&b);
        assert_int_equal(step_all(&b, 40.0, y, NULL), GSID_OK);
        assert_same(y, other, TOLERANCE);
        assert_slopes(&b, 40.0);
    }
}

/* A law -p u is p more gain, for values and derivatives; through a lag, and held. */
static void test_the_command_that_a_law_sees(void **state) {
    (void)state;
    const gsid_expression law = FROM(push);
    for (int with_lag = 0; with_lag < 2; with_lag++) {
        gsid_effect effect;
        make(&effect, &law, 1);
        bench_clear(&a);
        bench_clear(&b);
        bench_add_with(&a, "transport_delay", 1.4e-3, 0, 0);
        bench_add_with(&b, "transport_delay", 1.4e-3, 0, 0);
        if (with_lag) {
            bench_add_with(&a, "motor_lag", 0.002, 0, 0);
            bench_add_with(&b, "motor_lag", 0.002, 0, 0);
        }
        bench_add_with(&a, "rigid_body", 9.4, 0, 0);
        bench_add_with(&b, "rigid_body", 7.4, 0, 0);
        bench_add_with(&a, "viscous_friction", 11.0, 0, 0);
        bench_add_with(&b, "viscous_friction", 11.0, 0, 0);
        add(&b, &effect, &law, 2.0, 0);
        bench_free_all(&a);
        bench_free_all(&b);
        bench_init(&a);
        bench_init(&b);
        assert_int_equal(step_all(&a, 10.0, other, dy), GSID_OK);
        static gsid_real slopes[FREE_MAX * N];
        assert_int_equal(step_all(&b, 10.0, y, slopes), GSID_OK);
        assert_same(y, other, TOLERANCE);
        for (uint32_t p = 0; p < a.cfg.n_free; p++) { /* the parameters before the law's are the same ones */
            assert_same(slopes + p * N, dy + p * N, 10 * TOLERANCE);
        }
        assert_slopes(&b, 10.0);
    }
}

/* c tanh(w / width) by brute force: w' = gain u - c tanh(w / width) */
static void test_a_steep_law(void **state) {
    (void)state;
    const gsid_expression law = FROM(grease);
    const double widths[] = {1.0, 0.1, 0.01, 0.001};
    for (size_t i = 0; i < LENGTH(widths); i++) {
        static gsid_real truth[N];
        gsid_effect effect;
        double w = 0;
        make(&effect, &law, 2);
        bench_clear(&b);
        bench_add_with(&b, "rigid_body", 7.4, 0, 0);
        add(&b, &effect, &law, 15.0, widths[i]);
        bench_init(&b);
        assert_int_equal(step_all(&b, 10.0, y, NULL), GSID_OK);
        for (uint32_t n = 0; n < N; n++) {
            const double drive = 7.4 * bench_command(N, n, 10.0), h = 1.0 / FS / SUBSTEPS;
            truth[n] = (gsid_real)w;
            for (int k = 0; k < SUBSTEPS; k++) { /* midpoint rule */
                const double middle = w + h / 2 * (drive - 15.0 * tanh(w / widths[i]));
                w += h * (drive - 15.0 * tanh(middle / widths[i]));
            }
        }
        assert_same(y, truth, TOLERANCE);
        if (widths[i] > 0.05) { /* narrower, a difference that crosses the transition is none */
            assert_slopes(&b, 10.0);
        }
    }
}

static void test_what_cannot_be_followed_is_refused(void **state) {
    (void)state;
    static const gsid_expression_step jump[] = {VALUE(0),   DO(RATE), DO(ABS),     NUMBER(1e-30), DO(ADD),
                                                DO(DIVIDE), DO(RATE), DO(MULTIPLY)}; /* c w / (|w| + tiny): a sign */
    static const gsid_expression_step pole[] = {VALUE(0), DO(RATE), DO(DIVIDE)};
    static const gsid_expression_step explosion[] = {VALUE(0),  DO(RATE),     NUMBER(3.0),
                                                     DO(POWER), DO(MULTIPLY), DO(NEGATE)};
    static const struct {
        gsid_expression law;
        gsid_status status, or_status; /* what runs away is stopped by either, whichever comes first */
    } bad[] = {{FROM(jump), GSID_E_STEEP, GSID_E_STEEP},
               {FROM(pole), GSID_E_NONFINITE, GSID_E_NONFINITE},
               {FROM(explosion), GSID_E_STEEP, GSID_E_NONFINITE}};
    for (size_t i = 0; i < LENGTH(bad); i++) {
        gsid_effect effect;
        gsid_real u[N];
        make(&effect, &bad[i].law, 1);
        bench_clear(&b);
        bench_add_with(&b, "rigid_body", 7.4, 0, 0);
        add(&b, &effect, &bad[i].law, 20.0, 0);
        bench_init(&b);
        gsid_status status = step_all(&b, 10.0, y, NULL);
        assert_true(status == bad[i].status || status == bad[i].or_status);
        for (uint32_t n = 0; n < N; n++) {
            u[n] = (gsid_real)bench_command(N, n, 10.0);
        }
        status = gsid_plant_periodic(&b.plant, N, u, 1, 4, y, NULL, NULL, NULL, NULL);
        assert_true(status == bad[i].status || status == bad[i].or_status);
        /* The plant is at rest and goes on: with the law switched off it works. */
        b.item[1].value[0] = 0;
        assert_int_equal(gsid_plant_update(&b.plant), GSID_OK);
        if (i != 1) { /* 0 / 0 is no number either */
            assert_int_equal(step_all(&b, 10.0, y, NULL), GSID_OK);
        }
    }
}

/* Each function at several places: by angle and by value. */
static void test_functions_and_their_derivatives(void **state) {
    (void)state;
    static const gsid_expression_kind one[] = {GSID_EXPRESSION_NEGATE, GSID_EXPRESSION_ABS, GSID_EXPRESSION_SQRT,
                                               GSID_EXPRESSION_EXP,    GSID_EXPRESSION_LOG, GSID_EXPRESSION_SIN,
                                               GSID_EXPRESSION_COS,    GSID_EXPRESSION_TANH};
    static const gsid_expression_kind two[] = {
        GSID_EXPRESSION_ADD,   GSID_EXPRESSION_SUBTRACT, GSID_EXPRESSION_MULTIPLY, GSID_EXPRESSION_DIVIDE,
        GSID_EXPRESSION_POWER, GSID_EXPRESSION_MIN,      GSID_EXPRESSION_MAX};
    for (size_t i = 0; i < LENGTH(one) + LENGTH(two); i++) {
        const int binary = i >= LENGTH(one);
        const gsid_expression_step step[] = {DO(ANGLE),
                                             VALUE(0),
                                             {binary ? two[i - LENGTH(one)] : GSID_EXPRESSION_MULTIPLY, 0, 0},
                                             {binary ? GSID_EXPRESSION_NEGATE : one[i], 0, 0}};
        const gsid_expression law = FROM(step);
        gsid_effect effect;
        gsid_plant_item item = {&effect, {0}, &law};
        make(&effect, &law, 1);
        for (int k = 0; k < 3; k++) {
            const double angle = 0.3 + 0.4 * k, value = 0.8 + 0.1 * k, h = sizeof(gsid_real) == 4 ? 1e-2 : 1e-5;
            gsid_real at[2][3];
            gsid_torque t = {0};
            for (int j = 0; j < 5; j++) { /* there, and on both sides in angle and in value */
                const gsid_motion motion = {.angle = (gsid_real)(angle + (j == 1 ? h : j == 2 ? -h : 0))};
                gsid_torque side;
                memset(&side, 0, sizeof side);
                item.value[0] = (gsid_real)(value + (j == 3 ? h : j == 4 ? -h : 0));
                effect.torque(&item, &motion, &side);
                if (j == 0) {
                    t = side;
                } else {
                    at[(j - 1) / 2][(j - 1) % 2] = side.torque;
                }
            }
            /* Central differences err by h^2 and rounding over h. */
            const double tolerance = sizeof(gsid_real) == 4 ? 2e-3 : 1e-8;
            assert_near((double)t.by_angle, (double)(at[0][0] - at[0][1]) / (2 * h), tolerance);
            assert_near((double)t.by_value[0], (double)(at[1][0] - at[1][1]) / (2 * h), tolerance);
        }
    }
}

/* sqrt(|w|) at rest: an infinite slope times nothing that moves. */
static void test_derivatives_at_rest_are_numbers(void **state) {
    (void)state;
    static const gsid_expression_step root[] = {DO(RATE), DO(ABS), DO(SQRT), VALUE(0), DO(MULTIPLY)};
    static const gsid_expression_step raised[] = {DO(RATE), DO(ABS), VALUE(0), DO(POWER)};
    const gsid_expression laws[] = {FROM(root), FROM(raised)};
    for (size_t i = 0; i < LENGTH(laws); i++) {
        const gsid_motion rest = {.side = 1};
        gsid_effect effect;
        gsid_torque t;
        memset(&t, 0, sizeof t);
        make(&effect, &laws[i], 1);
        const gsid_plant_item item = {&effect, {GSID_R(0.5)}, &laws[i]};
        effect.torque(&item, &rest, &t);
        assert_near((double)t.torque, 0, 0);
        assert_near((double)t.by_rate, 0, 0);
        assert_near((double)t.by_value[0], 0, 0);
    }
}

static void test_lists_that_are_no_expression(void **state) {
    (void)state;
    static const gsid_expression_step empty_stack[] = {DO(ADD)}, two_left[] = {DO(RATE), DO(RATE)},
                                      unknown[] = {{GSID_EXPRESSION_N_KINDS, 0, 0}}, no_such[] = {VALUE(1)},
                                      infinite[] = {{GSID_EXPRESSION_NUMBER, 0, INFINITY}};
    static gsid_expression_step deep[2 * GSID_EXPRESSION_DEPTH_MAX + 1], wide[GSID_EXPRESSION_STEPS_MAX + 1];
    for (size_t i = 0; i < LENGTH(deep); i++) {
        deep[i].kind = i <= GSID_EXPRESSION_DEPTH_MAX ? GSID_EXPRESSION_RATE : GSID_EXPRESSION_ADD;
    }
    wide[0].kind = GSID_EXPRESSION_RATE;
    for (size_t i = 1; i < LENGTH(wide); i++) {
        wide[i].kind = GSID_EXPRESSION_ABS;
    }
    const gsid_expression bad[] = {{0, deep},     FROM(empty_stack), FROM(two_left), FROM(unknown),
                                   FROM(no_such), FROM(deep),        FROM(wide)};
    const gsid_expression not_finite = FROM(infinite), none = {1, NULL};
    gsid_effect effect;
    memset(&effect, 0, sizeof effect);
    effect.n_parameters = 1;
    for (size_t i = 0; i < LENGTH(bad); i++) {
        assert_int_equal(gsid_expression_effect(&bad[i], &effect), GSID_E_CONFIG);
    }
    assert_int_equal(gsid_expression_effect(&not_finite, &effect), GSID_E_NONFINITE);
    assert_int_equal(gsid_expression_effect(&none, &effect), GSID_E_NULL);
    assert_int_equal(gsid_expression_effect(NULL, &effect), GSID_E_NULL);
    assert_null(effect.torque);
}

/* ---- tables ---- */

enum { POINTS = 81 };
static gsid_real at[POINTS], curve[POINTS], slope[POINTS];

static void fill(double from, double to, double (*f)(double)) {
    for (int i = 0; i < POINTS; i++) {
        const double x = from + (to - from) * i / (POINTS - 1);
        at[i] = (gsid_real)x;
        curve[i] = (gsid_real)f(x);
    }
    assert_int_equal(gsid_table_slopes(POINTS, at, curve, slope), GSID_OK);
}

static double friction(double w) {
    return 12.0 * tanh(w / 3.0) + 0.1 * w;
}

static void test_a_table_is_the_law_that_it_samples(void **state) {
    (void)state;
    static const gsid_expression_step sampled[] = {VALUE(0),   NUMBER(12.0), DO(RATE),     NUMBER(3.0),
                                                   DO(DIVIDE), DO(TANH),     DO(MULTIPLY), NUMBER(0.1),
                                                   DO(RATE),   DO(MULTIPLY), DO(ADD),      DO(MULTIPLY)};
    const gsid_expression law = FROM(sampled);
    const gsid_table table = {GSID_TABLE_RATE, POINTS, at, curve, slope};
    gsid_effect expression, effect;
    fill(-30.0, 30.0, friction);
    make(&expression, &law, 1);
    memset(&effect, 0, sizeof effect);
    assert_int_equal(gsid_table_effect(&table, &effect), GSID_OK);
    bench_clear(&a);
    bench_clear(&b);
    bench_add_source(&a);
    bench_add_source(&b);
    add(&a, &expression, &law, 0.8, 0);
    add(&b, &effect, &table, 0.8, 0);
    bench_init(&a);
    bench_init(&b);
    assert_int_equal(step_all(&a, 20.0, other, NULL), GSID_OK);
    assert_int_equal(step_all(&b, 20.0, y, NULL), GSID_OK);
    assert_same(y, other, 1e-3); /* the cubic's error at 40 points over the transition */
    assert_slopes(&b, 20.0);
}

static double bent(double x) {
    return x < 0 ? -2 * x : x * x;
}

/* Through the points, slope continuous, a line beyond the ends; for each variable. */
static void test_values_of_a_table(void **state) {
    (void)state;
    const gsid_real unit = sizeof(gsid_real) == 4 ? (gsid_real)1e-5 : (gsid_real)1e-12;
    fill(-1.0, 3.0, bent);
    for (int variable = GSID_TABLE_RATE; variable <= GSID_TABLE_COMMAND; variable++) {
        const gsid_table table = {(gsid_table_variable)variable, POINTS, at, curve, slope};
        gsid_effect effect;
        memset(&effect, 0, sizeof effect);
        assert_int_equal(gsid_table_effect(&table, &effect), GSID_OK);
        assert_int_equal(effect.looks_at_angle, variable == GSID_TABLE_ANGLE);
        assert_int_equal(effect.looks_at_command, variable == GSID_TABLE_COMMAND);
        const gsid_plant_item item = {&effect, {2}, &table};
        const gsid_real places[] = {at[0] - 5, at[0], at[7], at[40] + unit, at[POINTS - 1], at[POINTS - 1] + 2};
        for (size_t i = 0; i < LENGTH(places); i++) {
            const gsid_real x = places[i];
            const gsid_motion motion = {.rate = variable == GSID_TABLE_RATE ? x : 99,
                                        .angle = variable == GSID_TABLE_ANGLE ? x : 99,
                                        .command = variable == GSID_TABLE_COMMAND ? x : 99};
            gsid_torque t;
            memset(&t, 0, sizeof t);
            effect.torque(&item, &motion, &t);
            const gsid_real by[] = {t.by_rate, t.by_angle, t.by_command};
            const gsid_real end = i == 0 ? curve[0] - 5 * slope[0] : curve[POINTS - 1] + 2 * slope[POINTS - 1];
            const gsid_real want[] = {end, curve[0], curve[7], curve[40], curve[POINTS - 1], end};
            const gsid_real steep[] = {slope[0], slope[0], slope[7], slope[40], slope[POINTS - 1], slope[POINTS - 1]};
            const double tolerance = sizeof(gsid_real) == 4 ? 1e-3 : 1e-9; /* x is a rounding off the point */
            assert_near((double)t.torque, 2 * (double)want[i], tolerance);
            assert_near((double)by[variable], 2 * (double)steep[i], tolerance);
            assert_near((double)by[(variable + 1) % 3], 0, 0);
            assert_near((double)t.by_value[0], (double)t.torque / 2, tolerance);
        }
    }
}

static void test_tables_that_are_refused(void **state) {
    (void)state;
    gsid_real x[4] = {0, 1, 2, 3}, f[4] = {0, 1, 4, 9}, d[4];
    gsid_effect effect;
    memset(&effect, 0, sizeof effect);
    assert_int_equal(gsid_table_slopes(4, x, f, d), GSID_OK);
    assert_int_equal(gsid_table_slopes(2, x, f, d), GSID_E_CONFIG);
    assert_int_equal(gsid_table_slopes(GSID_TABLE_POINTS_MAX + 1, x, f, d), GSID_E_CONFIG);
    assert_int_equal(gsid_table_slopes(4, x, NULL, d), GSID_E_NULL);
    assert_int_equal(gsid_table_slopes(4, x, f, NULL), GSID_E_NULL);
    gsid_table table = {(gsid_table_variable)7, 4, x, f, d};
    assert_int_equal(gsid_table_effect(&table, &effect), GSID_E_CONFIG);
    table.variable = GSID_TABLE_RATE;
    assert_int_equal(gsid_table_effect(&table, NULL), GSID_E_NULL);
    assert_int_equal(gsid_table_effect(NULL, &effect), GSID_E_NULL);
    d[1] = NAN;
    assert_int_equal(gsid_table_effect(&table, &effect), GSID_E_NONFINITE);
    x[2] = x[1];
    assert_int_equal(gsid_table_slopes(4, x, f, d), GSID_E_CONFIG);
    x[2] = NAN;
    assert_int_equal(gsid_table_slopes(4, x, f, d), GSID_E_NONFINITE);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_an_expression_is_the_catalogue_law),
        cmocka_unit_test(test_the_command_that_a_law_sees),
        cmocka_unit_test(test_a_steep_law),
        cmocka_unit_test(test_what_cannot_be_followed_is_refused),
        cmocka_unit_test(test_functions_and_their_derivatives),
        cmocka_unit_test(test_derivatives_at_rest_are_numbers),
        cmocka_unit_test(test_lists_that_are_no_expression),
        cmocka_unit_test(test_a_table_is_the_law_that_it_samples),
        cmocka_unit_test(test_values_of_a_table),
        cmocka_unit_test(test_tables_that_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
