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
def program(run, tmp_path):
    """Compile a program with a planted test; give its path."""

    def program(planted, name="planted"):
        (tmp_path / f"{name}.c").write_text(PROGRAM.replace("PLANTED", planted))
        built = run("cc", "-std=c99", "-o", tmp_path / name, tmp_path / f"{name}.c", "-lcmocka")
        assert built.returncode == 0, built.stderr
        return tmp_path / name

    return program


@pytest.fixture
def outcome(run, program):
    """Run the program with a planted test; give the exit status and what was printed."""

    def outcome(planted, *options):
        result = run("tools/run_c_tests", *options, program(planted))
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


def test_one_failure_among_many_programs_is_reported_once(run, program):
    """They run at the same time; each prints its report in one piece, and all are run."""
    passing, failing, skipping = program(PASSES, "a b"), program(FAILS, "failing"), program(SKIPS, "skipping")
    programs = [passing] * 5 + [failing] + [skipping] * 4
    result = run("tools/run_c_tests", *programs)
    assert result.returncode == 1
    assert result.stdout.endswith("C tests: 9 of 10 programs passed\n")
    assert result.stdout.count(f"  pass  {passing}: 1 tests") == 5
    assert result.stdout.count(f"  FAIL  {failing} (exit status 1)\n        [") == 1
    skipped = f"  pass  {skipping}: 1 tests \n        skipped planted\n        skipped: planted so\n"
    assert result.stdout.count(skipped) == 4


def test_a_program_that_cannot_start_is_a_failure(run, program, tmp_path):
    result = run("tools/run_c_tests", program(PASSES), tmp_path / "missing")
    assert (result.returncode, "1 of 2 programs passed" in result.stdout) == (1, True)


def test_no_programs_is_an_error(run):
    assert run("tools/run_c_tests").returncode == 1
