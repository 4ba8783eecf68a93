/* What plans with FFTW, in threads beside each other: the same answers as alone. */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "gsid/host/batch.h"
#include "gsid/host/optimise_excitation.h"

#include "reference.h"

enum { N_THREADS = 4, N_SIZES = 8, N_MAX = 512, F = 4, L = 10 };

typedef struct {
    gsid_status status[2];
    gsid_cplx lines[F];
    double phase_rad[L], peak;
} answer;

static answer alone[N_SIZES];

/* A period and a multisine of its own length each: every call plans anew. */
static answer work(uint32_t size) {
    answer a;
    memset(&a, 0, sizeof a);
    const uint32_t n_period = 100 + 4 * size, line[F] = {0, 1, 2, n_period / 2};
    double x[N_MAX], amplitude[L];
    for (uint32_t n = 0; n < n_period; n++) {
        x[n] = (double)((n * n + size) % 17) - 8;
    }
    a.status[0] = gsid_batch_spectra(1, n_period, x, F, line, a.lines);
    uint32_t excited[L];
    for (uint32_t i = 0; i < L; i++) {
        excited[i] = (i + 1) * (size + 1);
        amplitude[i] = 1;
        a.phase_rad[i] = (double)i;
    }
    gsid_optimise_cfg cfg;
    memset(&cfg, 0, sizeof cfg);
    cfg.n_lines = L;
    cfg.line = excited;
    cfg.amplitude = amplitude;
    cfg.n_per_stage = 1;
    a.status[1] = gsid_optimise_phases(&cfg, a.phase_rad, &a.peak);
    return a;
}

/* Returns the number of answers that differ. */
static void *repeat(void *first) {
    uintptr_t different = 0;
    const uint32_t n = (uint32_t)repeats(40, 5) * N_SIZES;
    for (uint32_t i = 0; i < n; i++) {
        const uint32_t size = (i + *(const uint32_t *)first) % N_SIZES;
        const answer a = work(size);
        different += memcmp(&a, &alone[size], sizeof a) != 0;
    }
    return (void *)different;
}

/* Bug: FFTW makes one plan at a time, and two searches of phases at once corrupted the heap. */
static void threads_get_the_answers_of_one(void **state) {
    (void)state;
    for (uint32_t size = 0; size < N_SIZES; size++) {
        alone[size] = work(size);
        assert_int_equal(alone[size].status[0], GSID_OK);
        assert_true(alone[size].status[1] >= 0 || alone[size].status[1] == GSID_E_BACKEND);
    }
    pthread_t thread[N_THREADS];
    uint32_t first[N_THREADS];
    for (uint32_t i = 0; i < N_THREADS; i++) {
        first[i] = i;
        assert_int_equal(pthread_create(&thread[i], NULL, repeat, &first[i]), 0);
    }
    for (int i = 0; i < N_THREADS; i++) {
        void *different;
        assert_int_equal(pthread_join(thread[i], &different), 0);
        assert_null(different);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(threads_get_the_answers_of_one)};
    return cmocka_run_group_tests_name("host threads", tests, NULL, NULL);
}
