"""The library in threads beside each other, and in children forked while they run."""

import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from threadpoolctl import ThreadpoolController

import gsid
from gsid.base.threads import with_one_thread_for_algebra

pytestmark = pytest.mark.xdist_group("clock")  # CONTRIBUTING.md
HERE = Path(__file__).parent
PACKAGE = Path(gsid.__file__).parent
SEED = 14
N_FORKS = 200  # a hang in 1 of 20 is missed with a probability of 4e-5
NOT_CALLED = {
    "gsid_arrow_reduce_dense",  # stands in for gsid_arrow_reduce in builds without SuiteSparse; no state
    "gsid_transform_use",  # called before other threads use the library
}
# Without a use of their own in the package: called where the other function is.
CALLED_WITHIN = {
    "gsid_arrow_covariance": "gsid_plant_fit",
    "gsid_arrow_reduce": "gsid_plant_fit",
    "gsid_minimise": "gsid_plant_fit",
    "gsid_plant_fit_n": "gsid_plant_fit",
    "gsid_squares_defaults": "gsid_plant_fit_defaults",
    "gsid_squares_search": "gsid_plant_fit",
    "gsid_steady_keep": "gsid_plant_fit",
    "gsid_steady_run_near": "gsid_steady_run",
}
# Functions in Python, not of the library.
CALLED_BY_C = {"gsid_python_to_lines", "gsid_python_to_samples", "gsid_python_each"}


def run(script, *arguments, seconds):
    """What a script prints; what it looks for may end it, so that it has a process of its own."""
    command = [sys.executable, "-X", "faulthandler", HERE / script, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=seconds)
    assert done.returncode == 0, f"exit code {done.returncode}\n{done.stderr[-3000:]}"
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def in_threads():
    return run("concurrent_jobs.py", SEED, seconds=300)


def called(in_threads):
    directly = set(in_threads["called"])
    return directly | {name for name, by in CALLED_WITHIN.items() if by in directly}


def test_answers_in_threads_are_those_alone(in_threads):
    """Bug: two searches of phases at once (`gsid.excitation.limits.optimise`) corrupted the heap."""
    assert in_threads["different"] == []


def test_every_c_function_that_the_package_calls_is_called_in_threads(in_threads):
    """cffi releases the lock of the interpreter in each of them."""
    sources = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    called_by_package = set(re.findall(r"\b_?lib(?:32)?\.(gsid_\w+)", sources))
    assert len(called_by_package) > 60
    assert called_by_package - called(in_threads) - CALLED_BY_C <= NOT_CALLED


def test_every_function_of_the_host_headers_is_called_in_threads(in_threads):
    headers = (HERE.parents[1] / "include/gsid/host").glob("*.h")
    text = re.sub(r"/\*.*?\*/", "", "\n".join(path.read_text() for path in headers), flags=re.S)
    declared = set(re.findall(r"^[a-z][\w *]*\b(gsid_\w+)\(", text, re.M))
    assert "gsid_fit_run" in declared
    assert declared - called(in_threads) == NOT_CALLED


@pytest.mark.long
def test_children_forked_beside_threads_do_not_hang():
    """Bug: a child hung in 1 of 5 cases, on a lock that a thread of the parent held."""
    assert run("forked_jobs.py", N_FORKS, SEED, seconds=300) == {"ended": [0] * N_FORKS, "alive": True}


FORKED_IN_A_PROPERTY = """
import os, signal, threading
from gsid.spectrum.realisation import spectra
import gsid.spectrum.spectra as module
from concurrent_jobs import record

inside, measured = threading.Event(), [spectra(record(400, seed=seed)) for seed in (1, 2)]
quick = module.variance_between_lines

def slow(*arguments):
    inside.set()
    threading.Event().wait(5)
    return quick(*arguments)

module.variance_between_lines = slow
threading.Thread(target=lambda: measured[0].noise_y, daemon=True).start()
inside.wait()
module.variance_between_lines = quick
pid = os.fork()
if pid == 0:
    signal.alarm(20)
    measured[1].noise_y
    os._exit(0)
print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
os._exit(0)
"""


def test_a_child_does_not_wait_for_a_property_that_a_thread_computed():
    """Bug: functools.cached_property of Python 3.11 has a lock, which the child found locked for ever."""
    command = [sys.executable, "-c", FORKED_IN_A_PROPERTY]
    done = subprocess.run(command, cwd=HERE, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("0\n", "")
    for path in PACKAGE.rglob("*.py"):
        assert "functools import cached_property" not in path.read_text(encoding="utf-8")


@pytest.mark.parametrize("fails", [False, True])
def test_matrix_algebra_keeps_to_one_thread_while_a_fit_runs(fails):
    """With two, a first draft took twice the processor time, and three times on busy cores."""
    seen = []

    @with_one_thread_for_algebra
    def fit(error):
        seen.append(n_of_algebra())
        if error:
            raise error
        return "a fit"

    with ThreadpoolController().limit(limits=2, user_api="blas"):
        if fails:
            with pytest.raises(KeyError):
                fit(KeyError("a reason"))
        else:
            assert fit(None) == "a fit"
        assert n_of_algebra() == {2}
    assert seen == [{1}]


def n_of_algebra():
    libraries = ThreadpoolController().select(user_api="blas")
    assert len(libraries)
    return {one["num_threads"] for one in libraries.info()}


@pytest.mark.parametrize("function", [gsid.start, gsid.diagnose_records, gsid.fit_plant])
def test_the_long_functions_keep_matrix_algebra_to_one_thread(function):
    """Whatever a program that calls them has set; their text and signature stay."""
    code = inspect.unwrap(function)
    assert code is not function
    assert (function.__doc__, inspect.signature(function)) == (code.__doc__, inspect.signature(code))
