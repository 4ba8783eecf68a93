/* Calls each function of the tick many times, between two marks that the emulator's counter detects (count.c). The cases run
 * one after the other, and each first writes its name to the log. */
#include "../cortex_m7/board.h"

#include "gsid/catalogue.h"
#include "gsid/excitation.h"
#include "gsid/frf.h"
#include "gsid/guard.h"
#include "gsid/plant.h"

enum { N_PERIOD = 6000, N_PERIOD_WITH_7 = 4200, N_LINES_MAX = 500, N_PERIODS = 2 };

void budget_case(void);
void budget_begin(void);
void budget_end(void);
__attribute__((noinline)) void budget_case(void) {
    __asm volatile("");
}
__attribute__((noinline)) void budget_begin(void) {
    __asm volatile("");
}
__attribute__((noinline)) void budget_end(void) {
    __asm volatile("");
}

static gsid_cplx twiddle[N_PERIOD], u_known[N_LINES_MAX];
static uint32_t line[N_LINES_MAX];
static gsid_real output[N_PERIOD]; /* any signal: the cost of a tick does not depend on it */
static gsid_cplx memory[GSID_FRF_SPREAD_MEM_SIZE(N_PERIOD, N_LINES_MAX, 1) / sizeof(gsid_cplx) + 1];
static gsid_frf frf;
static uint32_t n_period;

static void begin_case(const char *name) {
    board_log(name);
    board_log("\n");
    budget_case();
}

static void require(gsid_status status) {
    if (status < 0) {
        board_exit(1);
    }
}

typedef gsid_status engine(gsid_frf *, const gsid_frf_cfg *, void *, size_t);

static void init(engine *init_engine, uint32_t n_lines, int is_known) {
    const gsid_frf_cfg cfg = {.n_period = n_period,
                              .n_lines = n_lines,
                              .line = line,
                              .twiddle = twiddle,
                              .u_known = is_known ? u_known : NULL};
    require(init_engine(&frf, &cfg, memory, sizeof memory));
}

static void count_frf(const char *name, engine *init_engine, uint32_t n_lines, int is_known) {
    init(init_engine, n_lines, is_known);
    for (uint32_t n = 0; n < n_period; n++) { /* in the first period there is no complete period to transform */
        gsid_frf_step(&frf, output[n], output[n]);
    }
    begin_case(name);
    for (uint32_t n = 0; n < N_PERIODS * n_period; n++) {
        const gsid_real y = output[n % n_period];
        budget_begin();
        gsid_frf_step(&frf, y, y);
        budget_end();
    }
}

/* One line of a stepped sine: the excitation, and the line of the response. */
static void count_stepped_sine(void) {
    gsid_sine sine;
    gsid_real u;
    require(gsid_sine_init(&sine, N_PERIOD, line[99], 1, 0, twiddle));
    init(gsid_frf_init, 1, 1);
    begin_case("stepped sine");
    for (uint32_t n = 0; n < N_PERIODS * N_PERIOD; n++) {
        const gsid_real y = output[n % N_PERIOD];
        budget_begin();
        gsid_sine_step(&sine, &u);
        gsid_frf_step(&frf, 0, y);
        budget_end();
    }
}

static void count_skips(void) {
    init(gsid_frf_init_spread, N_LINES_MAX, 1);
    begin_case("skip spread 500");
    for (uint32_t n = 0; n < N_PERIODS * N_PERIOD; n++) {
        const int is_lost = n % 2000 == 1999;
        const gsid_real y = output[n % N_PERIOD];
        if (is_lost) {
            budget_begin();
        }
        if (is_lost) {
            gsid_frf_skip(&frf, 1);
        } else {
            gsid_frf_step(&frf, 0, y);
        }
        if (is_lost) {
            budget_end();
        }
    }
}

static void count_guard(void) {
    const gsid_guard_cfg cfg = {.fs_hz = 3000,
                                .command_limit = 100,
                                .rate_limit = 100,
                                .angle_lo = -100,
                                .angle_hi = 100,
                                .reaction_s = GSID_R(0.005),
                                .acceleration_per_command = 7,
                                .deceleration = 100,
                                .n_ramp = 100};
    gsid_guard guard;
    gsid_real allowed;
    require(gsid_guard_init(&guard, &cfg));
    require(gsid_guard_start(&guard, 0));
    begin_case("guard");
    for (uint32_t n = 0; n < 1000; n++) {
        const gsid_guard_sample sample = {output[n], 0};
        if (n == 500) {
            require(gsid_guard_stop(&guard));
        }
        budget_begin();
        gsid_guard_step(&guard, &sample, 0, output[n], &allowed);
        budget_end();
    }
}

/* The axis of the examples, simulated in parallel with the loop. The last effect is the only nonlinear one. */
static void count_plant(const char *name, uint32_t n_effects) {
    static const char *const id[] = {"rigid_body", "viscous_friction", "transport_delay", "flexible_mode",
                                     "coulomb_friction"};
    gsid_plant_item stack[] = {{.value = {GSID_R(7.4)}},
                               {.value = {10}},
                               {.value = {GSID_R(0.0051)}},
                               {.value = {60, GSID_R(0.03), GSID_R(0.3)}},
                               {.value = {1}}};
    for (uint32_t i = 0; i < n_effects; i++) {
        stack[i].effect = gsid_catalogue_find(id[i]);
    }
    const gsid_plant_cfg cfg = {.fs_hz = 3000, .n_items = n_effects, .item = stack};
    gsid_plant plant;
    gsid_real y;
    require(gsid_plant_init(&plant, &cfg, memory, sizeof memory));
    begin_case(name);
    for (uint32_t n = 0; n < N_PERIODS * N_PERIOD; n++) {
        const gsid_real u = output[n % N_PERIOD];
        budget_begin();
        gsid_plant_step(&plant, u, &y, NULL);
        budget_end();
    }
}

static void set_period(uint32_t n) {
    n_period = n;
    require(gsid_twiddle_fill(n, twiddle));
}

int main(void) {
    set_period(N_PERIOD);
    for (uint32_t i = 0; i < N_LINES_MAX; i++) {
        line[i] = i + 1;
        u_known[i].re = 1;
    }
    for (uint32_t i = 0; i < N_PERIOD; i++) {
        output[i] = twiddle[i].im + twiddle[17 * i % N_PERIOD].re;
    }
    begin_case("nothing");
    budget_begin();
    budget_end();
    count_stepped_sine();
    count_frf("direct 1", gsid_frf_init, 1, 1);
    count_frf("direct 50", gsid_frf_init, 50, 1);
    count_frf("direct 500", gsid_frf_init, 500, 1);
    count_frf("spread 1", gsid_frf_init_spread, 1, 1);
    count_frf("spread 50", gsid_frf_init_spread, 50, 1);
    count_frf("spread 500", gsid_frf_init_spread, 500, 1);
    count_frf("direct 500, input measured", gsid_frf_init, 500, 0);
    count_frf("spread 500, input measured", gsid_frf_init_spread, 500, 0);
    count_skips();
    count_guard();
    count_plant("plant of four linear effects", 4);
    count_plant("the last, and Coulomb friction", 5);
    set_period(N_PERIOD_WITH_7);
    count_frf("spread 500, period 4200", gsid_frf_init_spread, 500, 1);
    count_frf("spread 500, period 4200, input measured", gsid_frf_init_spread, 500, 0);
    return 0;
}

/* The board's interrupts stay off. */
void on_byte(uint8_t byte) {
    (void)byte;
}
void on_tick(int by_timer) {
    (void)by_timer;
}
