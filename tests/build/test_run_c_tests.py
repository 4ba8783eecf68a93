"""tools/run_c_tests fails when a program fails, and under valgrind when valgrind finds something."""

import shutil

import pytest

PROGRAM = """
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <cmocka.h>

static void planted(void **state) {
    (void)state;
    PLANTED
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(planted)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
"""
PASSES = "assert_true(1);"
FAILS = "assert_int_equal(1, 2);"
SKIPS = 'puts("skipped: planted so"); skip();'
LEAKS = "volatile char *lost = malloc(8); lost = NULL; (void)lost;"


@pytest.fixture
def outcome(run, tmp_path):
    """Compile the program with a planted test and run it; give the exit status and what was printed."""

    def outcome(planted, *options):
        (tmp_path / "planted.c").write_text(PROGRAM.replace("PLANTED", planted))
        built = run("cc", "-std=c99", "-o", tmp_path / "planted", tmp_path / "planted.c", "-lcmocka")
        assert built.returncode == 0, built.stderr
        result = run("tools/run_c_tests", *options, tmp_path / "planted")
        return result.returncode, result.stdout

    return outcome


def test_plainly(outcome):
    status, said = outcome(PASSES)
    assert (status, "1 tests" in said) == (0, True)
    status, said = outcome(SKIPS)
    assert (status, "skipped: planted so" in said) == (0, True)
    status, said = outcome(FAILS)
    assert (status, "0x1 != 0x2" in said) == (1, True)


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="no valgrind")
def test_under_valgrind(outcome):
    assert outcome(PASSES, "--valgrind")[0] == 0
    status, said = outcome(LEAKS, "--valgrind")
    assert (status, "definitely lost" in said) == (1, True)


def test_no_programs_is_an_error(run):
    assert run("tools/run_c_tests").returncode == 1
