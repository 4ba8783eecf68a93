/* Every law of the catalogue against equations written down once more here and integrated by brute force, and every
 * derivative against differences of the simulation. */
#include "plant_bench.h"
#include "gsid/effect_facts.h"

#ifdef GSID_SINGLE
#define TOLERANCE 1e-3 /* of the peak: float rounds the state 400 times to 6e-8, and springs add the errors up */
#else
#define TOLERANCE                                                                                                      \
    3e-5 /* of the peak: the truth's steps are 5 us, and its errors at the edges of a law of second order */
#endif

enum { N = 400, SUBSTEPS = 64 };
static bench b;
static double truth[N];
static gsid_real y[N];

/* ---- the truth: RK4 with 64 steps a sample ---- */

/* One stack with everything in it; a zero is an effect left out. */
typedef struct {
    double gain, viscous, spring, delay_steps;
    double motor_lag, f_hz, zeta, residue, sensor_lag, refresh_samples;
    double coulomb, stribeck, stribeck_speed, dahl, dahl_stiffness, hysteresis, unloading, loading, drag, quadratic,
        cubic, unbalance, unbalance_rad;
    double cogging, cycles, phase, stop, stop_stiffness, bias;
    double gap, gear_stiffness, ratio, damping;
    double step, dead_zone, limit;
    double kp, kv, loop_limit;
    int rate_samples; /* the loop's rate is the change of the angle over this many samples; 0: the measured rate */
    double fan_hz, fan, fan_phase;
} physics;

enum { ANGLE, RATE, MOTOR, BEND, BEND_RATE, GYRO, DAHL, BOUC_WEN, MOTOR_ANGLE, MOTOR_RATE, N_STATES };

static double sign(double x) {
    return (x > 0) - (x < 0);
}

static double outside(double x, double edge) {
    return fabs(x) > edge ? x - sign(x) * edge : 0.0;
}

static double friction(const physics *p, const double *x) {
    const double w = x[RATE], ratio = p->stribeck > 0 ? w / p->stribeck_speed : 0.0;
    return p->viscous * w + p->drag * w * fabs(w) + p->dahl * x[DAHL] + p->hysteresis * x[BOUC_WEN] +
           (p->coulomb + p->stribeck * exp(-ratio * ratio)) * sign(w);
}

static double springs(const physics *p, double angle) {
    const double rad = angle * PI / 180.0;
    return p->spring * angle + p->quadratic * angle * angle + p->cubic * pow(angle, 3) + p->bias +
           p->unbalance * (sin(rad + p->unbalance_rad) - sin(p->unbalance_rad)) +
           p->cogging * sin(p->cycles * rad + p->phase) + p->stop_stiffness * outside(angle, p->stop);
}

static void derivative(const physics *p, double u, const double *x, double *dx) {
    const double w0 = 2.0 * PI * p->f_hz, motor = p->motor_lag > 0 ? x[MOTOR] : u;
    const double against = friction(p, x) + springs(p, x[ANGLE]);
    memset(dx, 0, N_STATES * sizeof *dx);
    dx[ANGLE] = x[RATE];
    dx[RATE] = p->gain * motor - against;
    if (p->gear_stiffness > 0) {
        const double twist = x[MOTOR_ANGLE] - x[ANGLE], speed = x[MOTOR_RATE] - x[RATE];
        const double passed = p->gear_stiffness * outside(twist, p->gap / 2) + p->damping * speed;
        dx[RATE] = passed - against;
        dx[MOTOR_ANGLE] = x[MOTOR_RATE];
        dx[MOTOR_RATE] = (p->gain * motor - passed) / p->ratio;
    }
    if (p->motor_lag > 0) {
        dx[MOTOR] = (u - x[MOTOR]) / p->motor_lag;
    }
    dx[BEND] = x[BEND_RATE];
    dx[BEND_RATE] = p->residue * p->gain * motor - 2.0 * p->zeta * w0 * x[BEND_RATE] - w0 * w0 * x[BEND];
    if (p->sensor_lag > 0) {
        dx[GYRO] = (x[RATE] + x[BEND_RATE] - x[GYRO]) / p->sensor_lag;
    }
    dx[DAHL] = p->dahl_stiffness * (x[RATE] - fabs(x[RATE]) * x[DAHL]);
    /* gamma |w| z + delta w |z|: unloading = gamma - delta, loading = gamma + delta */
    dx[BOUC_WEN] = x[RATE] - 0.5 * (p->unloading + p->loading) * fabs(x[RATE]) * x[BOUC_WEN] -
                   0.5 * (p->loading - p->unloading) * x[RATE] * fabs(x[BOUC_WEN]);
}

static void runge_kutta(const physics *p, double u, double h, double *x) {
    double k[4][N_STATES], at[N_STATES];
    const double to[3] = {h / 2, h / 2, h};
    derivative(p, u, x, k[0]);
    for (int stage = 0; stage < 3; stage++) {
        for (int i = 0; i < N_STATES; i++) {
            at[i] = x[i] + to[stage] * k[stage][i];
        }
        derivative(p, u, at, k[stage + 1]);
    }
    for (int i = 0; i < N_STATES; i++) {
        x[i] += h / 6 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
    }
}

static double map_command(const physics *p, double u) {
    if (p->step > 0) {
        u = p->step * round(u / p->step);
    }
    u = outside(u, p->dead_zone);
    return p->limit > 0 ? fmax(-p->limit, fmin(p->limit, u)) : u;
}

static double control(const physics *p, double r, int n, const double *x) {
    static double angle[N];
    angle[n] = x[ANGLE];
    if (p->kv == 0) {
        return r;
    }
    const int past = n - p->rate_samples;
    const double rate =
        p->rate_samples > 0 ? (angle[n] - (past < 0 ? 0.0 : angle[past])) * FS / p->rate_samples : x[RATE];
    const double u = p->kv * (p->kp * (r - x[ANGLE]) - rate);
    return fmax(-p->loop_limit, fmin(p->loop_limit, u));
}

static double command_at(int n, double size, double offset) {
    return bench_command(N, (uint32_t)n, size) + offset;
}

static void run_truth(const physics *p, double size, double offset) {
    static double given[N];
    double x[N_STATES] = {0}, held = 0.0, to_refresh = 0.0;
    const double h = 1.0 / FS / SUBSTEPS;
    for (int n = 0; n < N; n++) {
        for (int k = 0; k < SUBSTEPS; k++) {
            const double now = p->sensor_lag > 0 ? x[GYRO] : x[RATE] + x[BEND_RATE];
            if (n * SUBSTEPS + k >= to_refresh) {
                held = now;
                to_refresh += p->refresh_samples * SUBSTEPS;
            }
            if (k == 0) {
                truth[n] =
                    (p->refresh_samples > 0 ? held : now) + p->fan * sin(2.0 * PI * p->fan_hz * n / FS + p->fan_phase);
                given[n] = map_command(p, control(p, command_at(n, size, offset), n, x));
            }
            const int late = n * SUBSTEPS + k - (int)p->delay_steps;
            runge_kutta(p, late < 0 ? 0.0 : given[late / SUBSTEPS], h, x);
        }
    }
}

/* ---- comparison ---- */

/* Delays are whole steps of the truth: 2 samples and 13/64. */
static const physics plain = {.gain = 7.4, .viscous = 3.0, .spring = 30.0, .delay_steps = 141};

static void start_stack(void) {
    bench_clear(&b);
    bench_add_with(&b, "transport_delay", 141.0 / SUBSTEPS / FS, 0, 0);
    bench_add_with(&b, "rigid_body", 7.4, 0, 0);
    bench_add_with(&b, "viscous_friction", 3.0, 0, 0);
    bench_add_with(&b, "cable_spring", 30.0, 0, 0);
}

static void run_plant(double size, double offset) {
    bench_init(&b);
    for (int n = 0; n < N; n++) {
        assert_int_equal(gsid_plant_step(&b.plant, (gsid_real)command_at(n, size, offset), &y[n], NULL), GSID_OK);
    }
}

static void compare(const physics *p, double size, double offset) {
    run_truth(p, size, offset);
    run_plant(size, offset);
    double peak = 0.0, worst = 0.0;
    for (int n = 0; n < N; n++) {
        peak = fmax(peak, fabs(truth[n]));
        worst = fmax(worst, fabs((double)y[n] - truth[n]));
    }
    if (!(peak > 0.1 && worst <= TOLERANCE * peak)) {
        fail_msg("%s: off by %.3g of the peak %.3g", b.item[b.cfg.n_items - 1].effect->id, worst / peak, peak);
    }
}

static void linear_effects_follow_the_truth(void **state) {
    (void)state;
    physics p = plain;
    start_stack();
    compare(&p, 50, 0);
    bench_add_with(&b, "torque_bias", 40, 0, 0);
    p.bias = 40;
    compare(&p, 50, 0);
    bench_add_with(&b, "motor_lag", 2e-3, 0, 0);
    p.motor_lag = 2e-3;
    compare(&p, 50, 0);
    bench_add_with(&b, "flexible_mode", 179, 0.015, 0.15);
    p.f_hz = 179, p.zeta = 0.015, p.residue = 0.15;
    compare(&p, 50, 0);
    bench_add_with(&b, "sensor_lag", 1e-3, 0, 0);
    p.sensor_lag = 1e-3;
    compare(&p, 50, 0);
    bench_add_with(&b, "sensor_sample_hold", 400, 0, 0);
    p.refresh_samples = 7.5;
    compare(&p, 50, 0);
}

static void springs_follow_the_truth(void **state) {
    (void)state;
    physics p = plain;
    start_stack();
    bench_add_with(&b, "quadratic_spring", 100, 0, 0);
    p.quadratic = 100;
    compare(&p, 100, 0);

    p = plain;
    start_stack();
    bench_add_with(&b, "cubic_spring", 300, 0, 0);
    p.cubic = 300;
    compare(&p, 100, 0);

    p = plain;
    start_stack();
    bench_add_with(&b, "mass_unbalance", 5000, 45, 0);
    p.unbalance = 5000, p.unbalance_rad = PI / 4;
    compare(&p, 100, 0);

    p = plain;
    start_stack();
    bench_add_with(&b, "motor_cogging", 50, 252, 0.3);
    p.cogging = 50, p.cycles = 252, p.phase = 0.3;
    compare(&p, 100, 0);

    p = plain;
    start_stack();
    bench_add_with(&b, "hard_stop", 0.3, 1e5, 0);
    p.stop = 0.3, p.stop_stiffness = 1e5;
    compare(&p, 100, 0);
}

/* The laws that hold the axis are compared where it never comes to rest; through rest, see test_host_plant.c. */
static void friction_follows_the_truth(void **state) {
    (void)state;
    physics p = plain;
    start_stack();
    bench_add_with(&b, "coulomb_friction", 15, 0, 0);
    p.coulomb = 15;
    compare(&p, 5, 60);

    p = plain;
    start_stack();
    bench_add_with(&b, "stribeck_friction", 15, 5, 2);
    p.coulomb = 15, p.stribeck = 5, p.stribeck_speed = 2;
    compare(&p, 5, 60);

    p = plain;
    start_stack();
    bench_add_with(&b, "presliding_friction", 60, 50, 0);
    p.dahl = 60, p.dahl_stiffness = 50;
    compare(&p, 50, 0);

    p = plain;
    start_stack();
    bench_add_with(&b, "bouc_wen", 3000, 50, -3);
    p.hysteresis = 3000, p.unloading = 50, p.loading = -3;
    compare(&p, 50, 0);

    p = plain;
    start_stack();
    bench_add_with(&b, "quadratic_drag", 0.5, 0, 0);
    p.drag = 0.5;
    compare(&p, 100, 0);
}

static void backlash_follows_the_truth(void **state) {
    (void)state;
    physics p = plain;
    start_stack();
    bench_add_with(&b, "gear_backlash", 0.02, 1e5, 0.1)->value[3] = GSID_R(20.0);
    p.gap = 0.02, p.gear_stiffness = 1e5, p.ratio = 0.1, p.damping = 20;
    compare(&p, 50, 0);
}

static void command_maps_and_loops_follow_the_truth(void **state) {
    (void)state;
    physics p = plain;
    start_stack();
    bench_add_with(&b, "drive_quantization", 7, 0, 0);
    bench_add_with(&b, "drive_dead_zone", 3, 0, 0);
    bench_add_with(&b, "drive_saturation", 40, 0, 0);
    p.step = 7, p.dead_zone = 3, p.limit = 40;
    compare(&p, 50, 0);

    p = plain;
    start_stack();
    gsid_plant_item *loop = bench_add_with(&b, "position_velocity_loop", 20, 5, 40);
    bench_add_with(&b, "periodic_disturbance", 30.9, 0.1, 0.5);
    p.kp = 20, p.kv = 5, p.loop_limit = 40, p.fan_hz = 30.9, p.fan = 0.1, p.fan_phase = 0.5;
    compare(&p, 1, 0);
    loop->value[3] = 2;
    p.rate_samples = 2;
    compare(&p, 1, 0);
}

/* ---- derivatives ---- */

#ifndef GSID_SINGLE /* differences of a float simulation are rounding only */

static double dy[FREE_MAX][N], differences[N];

static void run_with(gsid_real *value, double x, double size, double *out) {
    *value = x;
    assert_int_equal(gsid_plant_update(&b.plant), GSID_OK);
    assert_int_equal(gsid_plant_reset(&b.plant), GSID_OK);
    for (int n = 0; n < N; n++) {
        assert_int_equal(gsid_plant_step(&b.plant, command_at(n, size, 0), &out[n], NULL), GSID_OK);
    }
}

/* Fourth-order differences; from one side where the parameter cannot be less. */
static void difference(gsid_real *value, double size, double h, int one_sided) {
    static double run[N];
    static const double central[] = {1, -8, 0, 8, -1}, forward[] = {-25, 48, -36, 16, -3};
    const double at = *value, *weight = one_sided ? forward : central;
    memset(differences, 0, sizeof differences);
    for (int k = 0; k < 5; k++) {
        run_with(value, at + h * (one_sided ? k : k - 2), size, run);
        for (int n = 0; n < N; n++) {
            differences[n] += weight[k] * run[n] / (12.0 * h);
        }
    }
    *value = at;
    assert_int_equal(gsid_plant_update(&b.plant), GSID_OK);
}

/* The derivatives by one item's parameters, or by all. */
static void compare_derivatives(double size, double tolerance, uint32_t only) {
    double now[FREE_MAX], y_now;
    bench_free_all(&b);
    bench_init(&b);
    for (int n = 0; n < N; n++) {
        assert_int_equal(gsid_plant_step(&b.plant, command_at(n, size, 0), &y_now, now), GSID_OK);
        for (uint32_t p = 0; p < b.cfg.n_free; p++) {
            dy[p][n] = now[p];
        }
    }
    for (uint32_t p = 0; p < b.cfg.n_free; p += (uint32_t)repeats(1, 5)) {
        const gsid_plant_free f = b.free_parameter[p];
        const gsid_effect_parameter *d = &b.item[f.item].effect->parameter[f.parameter];
        gsid_real *value = &b.item[f.item].value[f.parameter];
        const int at_null = *value == d->null_value && d->lower == 0.0;
        const double scale = *value != 0.0 ? fabs(*value) : d->typical != 0.0 ? d->typical : 1.0;
        if (f.item < only) {
            continue;
        }
        difference(value, size, 1e-5 * scale, at_null);
        /* Beside its own size, a derivative is judged by what 1e-4 deg/s for all of the parameter would be: rounding makes
         * differences of 1e-10 deg/s out of nothing. */
        double error = 0.0, whole = N * pow(1e-4 / scale, 2);
        for (int n = 0; n < N; n++) {
            error += pow(dy[p][n] - differences[n], 2);
            whole += pow(differences[n], 2);
        }
        if (!(error <= pow(tolerance, 2) * whole)) {
            fail_msg("%s of %s: off by %.3g of the derivative's size", d->name, b.item[f.item].effect->id,
                     sqrt(error / whole));
        }
    }
}

/* Sizes at which each effect shows within 400 samples, and no instant of a refresh falls on a sample's. */
static gsid_plant_item *add_shown(const char *id) {
    gsid_plant_item *item = bench_add(&b, id);
    if (item->effect == gsid_catalogue_find("hard_stop")) {
        item->value[0] = 0.3;
    }
    if (item->effect == gsid_catalogue_find("gear_backlash")) {
        item->value[3] = 20.0;
    }
    if (item->effect == gsid_catalogue_find("drive_saturation")) {
        item->value[0] = 40.0;
    }
    if (item->effect == gsid_catalogue_find("sensor_sample_hold")) {
        item->value[0] = 397.3123;
    }
    if (item->effect == gsid_catalogue_find("position_velocity_loop")) {
        item->value[2] = 40.0, item->value[3] = 2.0;
    }
    return item;
}

/* Between two commands the rate has corners: differences stumble over the few refreshes that pass one. */
static double tolerance_of(const gsid_effect *effect) {
    return effect->refresh_hz != NULL ? 3e-4 : 1e-5;
}

static void derivatives_are_those_of_the_simulation(void **state) {
    (void)state;
    for (uint32_t i = 0; i < gsid_n_catalogue; i++) {
        const gsid_effect *effect = gsid_catalogue[i];
        if (effect == gsid_catalogue_find("drive_quantization")) {
            continue; /* its derivative is that of the trend: see the effect */
        }
        if (effect == gsid_catalogue_find("rigid_body")) {
            continue; /* in every stack */
        }
        start_stack();
        add_shown(effect->id);
        compare_derivatives(effect->control != NULL ? 1.0 : 100.0, tolerance_of(effect), 0);
    }
}

static void derivatives_hold_where_the_effect_vanishes(void **state) {
    (void)state;
    for (uint32_t i = 0; i < gsid_n_catalogue; i++) {
        const gsid_effect *effect = gsid_catalogue[i];
        if (effect->null_kind == GSID_NULL_THRESHOLD || effect->null_kind == GSID_NULL_NEVER) {
            continue; /* by its descriptor there is none */
        }
        start_stack();
        gsid_plant_item *item = effect == gsid_catalogue_find("transport_delay")    ? &b.item[0]
                                : effect == gsid_catalogue_find("viscous_friction") ? &b.item[2]
                                : effect == gsid_catalogue_find("cable_spring")     ? &b.item[3]
                                                                                    : add_shown(effect->id);
        for (uint32_t k = 0; k < effect->n_parameters; k++) {
            if (!isnan(effect->parameter[k].null_value)) {
                item->value[k] = effect->parameter[k].null_value;
            }
        }
        compare_derivatives(100.0, 1e-4, (uint32_t)(item - b.item));
    }
}

static void everything_at_once_has_right_derivatives(void **state) {
    (void)state;
    start_stack();
    bench_add_with(&b, "motor_lag", 1e-3, 0, 0);
    bench_add_with(&b, "coulomb_friction", 10, 0, 0);
    bench_add_with(&b, "presliding_friction", 10, 50, 0);
    bench_add_with(&b, "mass_unbalance", 500, 45, 0);
    bench_add_with(&b, "flexible_mode", 179, 0.015, 0.15);
    bench_add_with(&b, "sensor_lag", 1e-3, 0, 0);
    bench_add_with(&b, "drive_saturation", 80, 0, 0);
    compare_derivatives(100.0, 1e-5, 0);
}

#endif

/* ---- descriptors ---- */

static int is_listed(const char *list) {
    while (*list != '\0') {
        char id[64] = {0};
        const size_t n = strcspn(list, ",");
        assert_in_range(n, 1, sizeof id - 1);
        memcpy(id, list, n);
        if (gsid_catalogue_find(id) == NULL) {
            return 0;
        }
        list += n + (list[n] == ',');
    }
    return 1;
}

static void descriptors_are_complete(void **state) {
    (void)state;
    assert_int_equal(gsid_n_catalogue, 26);
    for (uint32_t i = 0; i < gsid_n_catalogue; i++) {
        const gsid_effect *e = gsid_catalogue[i];
        assert_ptr_equal(gsid_catalogue_find(e->id), e);
        assert_ptr_equal(gsid_catalogue_facts[i]->effect, e);
        assert_true(e->sentence[strlen(e->sentence) - 1] == '.');
        assert_true(is_listed(e->confused_with));
        assert_in_range(e->n_parameters, 1, GSID_EFFECT_PARAMETERS_MAX);
        for (uint32_t k = 0; k < e->n_parameters; k++) {
            const gsid_effect_parameter *p = &e->parameter[k];
            assert_true(p->lower < p->upper && p->lower <= p->typical && p->typical <= p->upper);
            assert_true(strlen(p->name) > 0 && strlen(p->unit) > 0);
        }
    }
    assert_null(gsid_catalogue_find("viscous"));
    assert_null(gsid_catalogue_find(NULL));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(descriptors_are_complete),
        cmocka_unit_test(linear_effects_follow_the_truth),
        cmocka_unit_test(springs_follow_the_truth),
        cmocka_unit_test(friction_follows_the_truth),
        cmocka_unit_test(backlash_follows_the_truth),
        cmocka_unit_test(command_maps_and_loops_follow_the_truth),
#ifndef GSID_SINGLE
        cmocka_unit_test(derivatives_are_those_of_the_simulation),
        cmocka_unit_test(derivatives_hold_where_the_effect_vanishes),
        cmocka_unit_test(everything_at_once_has_right_derivatives),
#endif
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
