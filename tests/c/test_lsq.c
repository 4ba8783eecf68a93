/* Least squares against the normal equations in long double, and against the reduced problem where columns repeat. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "gsid/lsq.h"
#include "reference.h"

#ifdef GSID_SINGLE
#define LARGEST FLT_MAX
#define SMALLEST FLT_MIN
#else
#define LARGEST DBL_MAX
#define SMALLEST DBL_MIN
#endif

enum { N = 5, N_ROWS = 40 };

static gsid_real memory[GSID_LSQ_MEM_SIZE(N) / sizeof(gsid_real) + 1];
static gsid_real a[N_ROWS][N], b[N_ROWS];

/* uniform in -1 .. 1, the same on every machine */
static gsid_real draw(void) {
    static uint32_t seed = 1;
    seed = 1664525u * seed + 1013904223u;
    return (gsid_real)((double)seed / 2147483648.0 - 1.0);
}

static void draw_problem(void) {
    for (int i = 0; i < N_ROWS; i++) {
        for (int j = 0; j < N; j++) {
            a[i][j] = draw();
        }
        b[i] = draw();
    }
}

static gsid_lsq start(uint32_t n_columns) {
    gsid_lsq q;
    memset(&q, 0, sizeof q); /* the padding too: whole objects are compared */
    assert_int_equal(gsid_lsq_init(&q, n_columns, memory, sizeof memory), GSID_OK);
    return q;
}

/* the first n_columns columns of the problem */
static gsid_lsq load(uint32_t n_columns) {
    gsid_lsq q = start(n_columns);
    for (int i = 0; i < N_ROWS; i++) {
        assert_int_equal(gsid_lsq_add(&q, a[i], b[i]), GSID_OK);
    }
    return q;
}

/* inverse <- (A'A)^-1 over the first n columns, by Gauss and Jordan without pivoting, which a definite matrix does not need */
static void invert_normal(int n, long double inverse[N][N]) {
    long double m[N][2 * N] = {{0}};
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            for (int k = 0; k < N_ROWS; k++) {
                m[i][j] += (long double)a[k][i] * a[k][j];
            }
        }
        m[i][n + i] = 1;
    }
    for (int p = 0; p < n; p++) {
        for (int j = 2 * n - 1; j >= p; j--) {
            m[p][j] /= m[p][p];
        }
        for (int i = 0; i < n; i++) {
            for (int j = 2 * n - 1; j >= p && i != p; j--) {
                m[i][j] -= m[i][p] * m[p][j];
            }
        }
    }
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            inverse[i][j] = m[i][n + j];
        }
    }
}

/* x <- the solution over the first n columns; returns the sum of squared residuals */
static long double solve_normal(int n, long double x[N]) {
    long double inverse[N][N], right[N] = {0}, cost = 0;
    invert_normal(n, inverse);
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < N_ROWS; k++) {
            right[i] += (long double)a[k][i] * b[k];
        }
    }
    for (int i = 0; i < n; i++) {
        x[i] = 0;
        for (int j = 0; j < n; j++) {
            x[i] += inverse[i][j] * right[j];
        }
    }
    for (int k = 0; k < N_ROWS; k++) {
        long double residual = b[k];
        for (int i = 0; i < n; i++) {
            residual -= x[i] * a[k][i];
        }
        cost += residual * residual;
    }
    return cost;
}

/* Forty random rows have a condition number below 4; 40 rotations of entries up to 1, 5 columns: 40 epsilon. */
#define TOLERANCE (40 * (long double)EPSILON)

static void solution_cost_and_covariance_are_those_of_the_normal_equations(void **state) {
    (void)state;
    for (int repeat = 0; repeat < 20; repeat++) {
        draw_problem();
        gsid_lsq q = load(N);
        gsid_real x[N], cost, cov[N * N], y[N];
        long double want[N], inverse[N][N];
        const long double want_cost = solve_normal(N, want);
        assert_int_equal(gsid_lsq_solve(&q, 0, x, &cost), GSID_OK);
        for (int i = 0; i < N; i++) {
            assert_near(x[i], want[i], TOLERANCE);
        }
        assert_near(cost, want_cost, 10 * TOLERANCE); /* the cost itself is about 13 */
        invert_normal(N, inverse);
        assert_int_equal(gsid_lsq_covariance(&q, cov), GSID_OK);
        const gsid_real c[N] = {1, -2, 3, -4, 5};
        memcpy(y, c, sizeof c);
        assert_int_equal(gsid_lsq_solve_normal(&q, y, y), GSID_OK);
        for (int i = 0; i < N; i++) {
            long double product = 0;
            for (int j = 0; j < N; j++) {
                assert_near(cov[i * N + j], inverse[i][j], TOLERANCE);
                assert_true(cov[i * N + j] == cov[j * N + i]);
                product += inverse[i][j] * c[j];
            }
            assert_near(y[i], product, 10 * TOLERANCE);
        }
    }
}

static void as_many_rows_as_unknowns_leave_no_residual(void **state) {
    (void)state;
    gsid_lsq q = start(2);
    gsid_real x[2], cost;
    assert_int_equal(gsid_lsq_add(&q, (const gsid_real[2]){1, 1}, 5), GSID_OK);
    assert_int_equal(gsid_lsq_solve(&q, 0, x, &cost), GSID_E_TOO_FEW);
    assert_int_equal(gsid_lsq_add(&q, (const gsid_real[2]){1, -1}, 1), GSID_OK);
    assert_int_equal(gsid_lsq_solve(&q, 0, x, &cost), GSID_OK);
    assert_near(x[0], 3, 4 * EPSILON);
    assert_near(x[1], 2, 4 * EPSILON);
    assert_near(cost, 0, EPSILON * EPSILON);
}

/* A problem of N columns whose column `bad` is a combination of those before it: that unknown is 0, and the others, those
 * after it too, are what least squares without the column gives. */
static void assert_pinned(int bad) {
    for (int i = 0; i < N_ROWS; i++) {
        a[i][bad] = 0;
        for (int j = 0; j < bad; j++) {
            a[i][bad] += (gsid_real)(j + 1) * a[i][j];
        }
    }
    gsid_lsq q = load(N);
    gsid_real x[N], cost, again[N], cov[N * N] = {7};
    assert_int_equal(gsid_lsq_solve(&q, 0, x, &cost), GSID_RANK);
    assert_int_equal(q.n_pinned, 1);
    assert_true(x[bad] == 0);
    for (int i = 0; i < N_ROWS; i++) {
        memmove(&a[i][bad], &a[i][bad + 1], (size_t)(N - 1 - bad) * sizeof a[i][0]);
    }
    long double want[N];
    const long double want_cost = solve_normal(N - 1, want);
    for (int j = 0; j < N - 1; j++) {
        assert_near(x[j < bad ? j : j + 1], want[j], TOLERANCE);
    }
    assert_near(cost, want_cost, 10 * TOLERANCE);
    /* the pin is there to stay, and nothing forgets it */
    assert_int_equal(gsid_lsq_solve(&q, 0, again, NULL), GSID_RANK);
    assert_memory_equal(again, x, sizeof x);
    assert_int_equal(gsid_lsq_covariance(&q, cov), GSID_E_SINGULAR);
    assert_int_equal(gsid_lsq_solve_normal(&q, x, cov), GSID_E_SINGULAR);
    assert_true(cov[0] == 7);
}

static void a_linearly_dependent_column_is_pinned_and_the_rest_stays_optimal(void **state) {
    (void)state;
    for (int bad = 0; bad < N; bad++) { /* 0: a column of zeros */
        draw_problem();
        assert_pinned(bad);
    }
}

static void reset_forgets_rows_and_pins(void **state) {
    (void)state;
    draw_problem();
    for (int i = 0; i < N_ROWS; i++) {
        a[i][2] = a[i][1];
    }
    gsid_lsq q = load(N);
    gsid_real x[N];
    assert_int_equal(gsid_lsq_solve(&q, 0, x, NULL), GSID_RANK);
    assert_int_equal(gsid_lsq_reset(&q), GSID_OK);
    assert_int_equal(q.n_rows, 0);
    assert_int_equal(gsid_lsq_solve(&q, 0, x, NULL), GSID_E_TOO_FEW);
    draw_problem();
    for (int i = 0; i < N_ROWS; i++) {
        assert_int_equal(gsid_lsq_add(&q, a[i], b[i]), GSID_OK);
    }
    long double want[N];
    solve_normal(N, want);
    assert_int_equal(gsid_lsq_solve(&q, 0, x, NULL), GSID_OK);
    for (int i = 0; i < N; i++) {
        assert_near(x[i], want[i], TOLERANCE);
    }
}

static void the_rank_tolerance_is_relative_to_the_column(void **state) {
    (void)state;
    draw_problem();
    for (int i = 0; i < N_ROWS; i++) {
        a[i][1] = a[i][0] + (gsid_real)1e-3 * a[i][1];
    }
    gsid_real x[N];
    gsid_lsq q = load(N);
    assert_int_equal(gsid_lsq_solve(&q, 0, x, NULL), GSID_OK);
    assert_int_equal(gsid_lsq_solve(&q, (gsid_real)0.01, x, NULL), GSID_RANK);
    assert_true(x[1] == 0);
    assert_int_equal(gsid_lsq_solve(&q, -1, x, NULL), GSID_E_CONFIG);
    assert_int_equal(gsid_lsq_solve(&q, (gsid_real)NAN, x, NULL), GSID_E_CONFIG);
}

/* Squares of such entries leave the range: lengths must not be sums of squares. */
static void entries_near_the_ends_of_the_range_are_no_rank_loss(void **state) {
    (void)state;
    const gsid_real scales[2] = {LARGEST / 1000, 1000 * SMALLEST / EPSILON};
    for (int s = 0; s < 2; s++) {
        draw_problem();
        long double want[N];
        solve_normal(N, want);
        gsid_lsq q = start(N);
        for (int i = 0; i < N_ROWS; i++) {
            for (int j = 0; j < N; j++) {
                a[i][j] *= scales[s];
            }
            assert_int_equal(gsid_lsq_add(&q, a[i], scales[s] * b[i]), GSID_OK);
        }
        gsid_real x[N];
        assert_int_equal(gsid_lsq_solve(&q, 0, x, NULL), GSID_OK);
        for (int i = 0; i < N; i++) {
            assert_near(x[i], want[i], 10 * TOLERANCE); /* the small ones lose bits below the least normal number */
        }
    }
}

static void refused_rows_change_nothing(void **state) {
    (void)state;
    draw_problem();
    gsid_lsq q = load(N), untouched;
    memcpy(&untouched, &q, sizeof q);
    gsid_real before[sizeof memory / sizeof memory[0]], row[N] = {0};
    memcpy(before, memory, sizeof memory);
    const gsid_real bad[3] = {(gsid_real)NAN, (gsid_real)INFINITY, (gsid_real)-INFINITY};
    for (int i = 0; i < 3; i++) {
        row[N - 1] = bad[i];
        assert_int_equal(gsid_lsq_add(&q, row, 0), GSID_E_NONFINITE);
        row[N - 1] = 0;
        assert_int_equal(gsid_lsq_add(&q, row, bad[i]), GSID_E_NONFINITE);
    }
    assert_int_equal(gsid_lsq_add(&q, NULL, 0), GSID_E_NULL);
    assert_memory_equal(&q, &untouched, sizeof q);
    assert_memory_equal(memory, before, sizeof memory);
}

static void failures_leave_the_outputs(void **state) {
    (void)state;
    gsid_lsq q = start(2);
    gsid_real out[4] = {1, 2, 3, 4}, cost = 5;
    const gsid_real untouched[4] = {1, 2, 3, 4}, first[2] = {1, 0}, second[2] = {0, SMALLEST};
    assert_int_equal(gsid_lsq_add(&q, first, 1), GSID_OK);
    assert_int_equal(gsid_lsq_solve(&q, 0, out, &cost), GSID_E_TOO_FEW);
    assert_int_equal(gsid_lsq_covariance(&q, out), GSID_E_TOO_FEW);
    assert_int_equal(gsid_lsq_solve_normal(&q, first, out), GSID_E_TOO_FEW);
    assert_int_equal(gsid_lsq_add(&q, second, LARGEST), GSID_OK);
    assert_int_equal(gsid_lsq_solve(&q, 0, out, &cost), GSID_E_NONFINITE); /* 1/SMALLEST times LARGEST */
    assert_int_equal(gsid_lsq_reset(&q), GSID_OK);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(gsid_lsq_add(&q, (const gsid_real[2]){1, 1}, 1), GSID_OK);
    }
    assert_int_equal(gsid_lsq_covariance(&q, out), GSID_E_SINGULAR);
    assert_int_equal(gsid_lsq_solve_normal(&q, first, out), GSID_E_SINGULAR);
    assert_int_equal(gsid_lsq_solve(NULL, 0, out, &cost), GSID_E_NULL);
    assert_int_equal(gsid_lsq_solve(&q, 0, NULL, &cost), GSID_E_NULL);
    assert_int_equal(gsid_lsq_covariance(NULL, out), GSID_E_NULL);
    assert_int_equal(gsid_lsq_covariance(&q, NULL), GSID_E_NULL);
    assert_int_equal(gsid_lsq_solve_normal(NULL, first, out), GSID_E_NULL);
    assert_int_equal(gsid_lsq_solve_normal(&q, NULL, out), GSID_E_NULL);
    assert_int_equal(gsid_lsq_solve_normal(&q, first, NULL), GSID_E_NULL);
    assert_int_equal(gsid_lsq_add(NULL, first, 0), GSID_E_NULL);
    assert_int_equal(gsid_lsq_reset(NULL), GSID_E_NULL);
    assert_memory_equal(out, untouched, sizeof out);
    assert_true(cost == 5);
}

/* Bug: the memory of an object of zeros was written to. */
static void not_initialised(void **state) {
    (void)state;
    gsid_lsq q = {0};
    gsid_real x[1] = {1}, block[GSID_LSQ_BLOCK] = {0};
    assert_int_equal(gsid_lsq_reset(&q), GSID_E_STATE);
    assert_int_equal(gsid_lsq_add(&q, x, 0), GSID_E_STATE);
    assert_int_equal(gsid_lsq_add_block(&q, 1, block), GSID_E_STATE);
    assert_int_equal(gsid_lsq_solve(&q, 0, x, NULL), GSID_E_STATE);
    assert_int_equal(gsid_lsq_solve_normal(&q, x, x), GSID_E_STATE);
    assert_int_equal(gsid_lsq_covariance(&q, x), GSID_E_STATE);
}

static void memory_is_counted_and_checked(void **state) {
    (void)state;
    gsid_lsq q = {0}, untouched = {0};
    for (uint32_t n = 1; n <= GSID_LSQ_COLUMNS_MAX; n++) {
        assert_int_equal(gsid_lsq_mem_size(n), GSID_LSQ_MEM_SIZE(n));
    }
    assert_int_equal(gsid_lsq_mem_size(0), 0);
    /* beyond the limit the bytes would not fit a size_t everywhere: 65535 columns of float ask for 2^34 */
    assert_int_equal(gsid_lsq_mem_size(GSID_LSQ_COLUMNS_MAX + 1), 0);
    assert_int_equal(gsid_lsq_mem_size(UINT32_MAX), 0);
    unsigned char *bytes = (unsigned char *)memory;
    const size_t size = GSID_LSQ_MEM_SIZE(N);
    assert_int_equal(gsid_lsq_init(&q, N, memory, size - 1), GSID_E_MEMORY);
    assert_int_equal(gsid_lsq_init(&q, N, bytes + 1, size), GSID_E_MEMORY);
    assert_int_equal(gsid_lsq_init(&q, 0, memory, size), GSID_E_CONFIG);
    assert_int_equal(gsid_lsq_init(&q, GSID_LSQ_COLUMNS_MAX + 1, memory, SIZE_MAX), GSID_E_CONFIG);
    assert_int_equal(gsid_lsq_init(&q, UINT32_MAX, memory, SIZE_MAX), GSID_E_CONFIG);
    assert_int_equal(gsid_lsq_init(&q, N, NULL, size), GSID_E_NULL);
    assert_int_equal(gsid_lsq_init(NULL, N, memory, size), GSID_E_NULL);
    assert_memory_equal(&q, &untouched, sizeof q);

    /* the bytes asked for are the bytes used, on the heap so that a sanitizer sees one more */
    draw_problem();
    void *exact = malloc(size);
    assert_non_null(exact);
    assert_int_equal(gsid_lsq_init(&q, N, exact, size), GSID_OK);
    gsid_real x[N], cov[N * N];
    for (int i = 0; i < N_ROWS; i++) {
        assert_int_equal(gsid_lsq_add(&q, a[i], b[i]), GSID_OK);
    }
    assert_int_equal(gsid_lsq_solve(&q, 0, x, NULL), GSID_OK);
    assert_int_equal(gsid_lsq_covariance(&q, cov), GSID_OK);
    free(exact);
}

/* Blocks of n_rows rows of the problem, times scale. */
static gsid_lsq load_blocks(uint32_t n_rows, double scale) {
    gsid_lsq q = start(N);
    for (uint32_t first = 0; first < N_ROWS; first += n_rows) {
        gsid_real block[(N + 1) * GSID_LSQ_BLOCK];
        const uint32_t n = N_ROWS - first < n_rows ? N_ROWS - first : n_rows;
        for (size_t i = 0; i < (N + 1) * GSID_LSQ_BLOCK; i++) {
            block[i] = 7; /* what rows beyond n hold does not matter */
        }
        for (uint32_t t = 0; t < n; t++) {
            for (uint32_t j = 0; j < N; j++) {
                block[j * GSID_LSQ_BLOCK + t] = (gsid_real)(scale * (double)a[first + t][j]);
            }
            block[N * GSID_LSQ_BLOCK + t] = (gsid_real)(scale * (double)b[first + t]);
        }
        assert_int_equal(gsid_lsq_add_block(&q, n, block), GSID_OK);
    }
    return q;
}

/* Against rows one by one, for every size of block, in mid range and where squares leave it. */
static void blocks_of_rows_give_the_result_of_single_rows(void **state) {
    (void)state;
    const double scales[] = {1, sizeof(gsid_real) == 4 ? 1e25 : 1e200, sizeof(gsid_real) == 4 ? 1e-25 : 1e-200};
    draw_problem();
    gsid_real want[N], got[N], cost_want, cost_got;
    gsid_lsq one_by_one = load(N);
    assert_int_equal(gsid_lsq_solve(&one_by_one, 0, want, &cost_want), GSID_OK);
    for (uint32_t n_rows = 1; n_rows <= GSID_LSQ_BLOCK; n_rows++) {
        for (int s = 0; s < 3; s++) {
            gsid_lsq q = load_blocks(n_rows, scales[s]);
            assert_int_equal(q.n_rows, N_ROWS);
            assert_int_equal(gsid_lsq_solve(&q, 0, got, s == 0 ? &cost_got : NULL), GSID_OK);
            for (int j = 0; j < N; j++) { /* both are within 100 roundings of the exact solution */
                assert_true(fabs((double)(got[j] - want[j])) <= 200 * (double)EPSILON * (1 + fabs((double)want[j])));
            }
            assert_true(s > 0 || fabs((double)(cost_got - cost_want)) <= 200 * (double)EPSILON * (double)cost_want);
        }
    }
}

static void refused_blocks_change_nothing(void **state) {
    (void)state;
    draw_problem();
    gsid_lsq q = load(N);
    gsid_real block[(N + 1) * GSID_LSQ_BLOCK] = {0}, before[(N + 1) * (N + 1)];
    memcpy(before, q.r, sizeof before);
    assert_int_equal(gsid_lsq_add_block(&q, GSID_LSQ_BLOCK + 1, block), GSID_E_CONFIG);
    assert_int_equal(gsid_lsq_add_block(&q, 1, NULL), GSID_E_NULL);
    assert_int_equal(gsid_lsq_add_block(NULL, 1, block), GSID_E_NULL);
    block[N * GSID_LSQ_BLOCK + 1] = (gsid_real)NAN;
    assert_int_equal(gsid_lsq_add_block(&q, 2, block), GSID_E_NONFINITE);
    assert_int_equal(gsid_lsq_add_block(&q, 1, block), GSID_OK); /* the bad row is not among those given */
    assert_memory_equal(q.r, before, sizeof before);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(solution_cost_and_covariance_are_those_of_the_normal_equations),
        cmocka_unit_test(as_many_rows_as_unknowns_leave_no_residual),
        cmocka_unit_test(a_linearly_dependent_column_is_pinned_and_the_rest_stays_optimal),
        cmocka_unit_test(reset_forgets_rows_and_pins),
        cmocka_unit_test(the_rank_tolerance_is_relative_to_the_column),
        cmocka_unit_test(entries_near_the_ends_of_the_range_are_no_rank_loss),
        cmocka_unit_test(blocks_of_rows_give_the_result_of_single_rows),
        cmocka_unit_test(refused_blocks_change_nothing),
        cmocka_unit_test(refused_rows_change_nothing),
        cmocka_unit_test(failures_leave_the_outputs),
        cmocka_unit_test(not_initialised),
        cmocka_unit_test(memory_is_counted_and_checked),
    };
    return cmocka_run_group_tests_name("lsq", tests, NULL, NULL);
}
