"""Children forked while threads measure, fit, plan and simulate: each fits, and ends with 0.

Run as a script: N forks, and a seed. Prints JSON: the exit code of each child (a negative one is the signal
that ended it; the alarm is number 14), and whether the threads of the parent still run at the end.
"""

import faulthandler
import json
import os
import random
import signal
import sys
import threading
import time
import traceback

import concurrent_jobs as jobs

SECONDS = 60  # until a child that hangs is ended
N_THREADS = 3
BUSY = (
    "spectra_of_several_periods",
    "phases",
    "rational ml",
    "rational ga",
    "stack lm",
    "streamed double spread",
)
IN_THE_CHILD = ("spectra_of_several_periods", "phases", "rational ml", "stack lm")


def keep_busy(seed, stop, failed):
    choose = random.Random(seed)
    while not stop.is_set():
        try:
            jobs.JOBS[choose.choice(BUSY)]()
        except BaseException:
            failed.append(traceback.format_exc())
            raise


def child(name, alone):
    """Do a job in the child, and end it without what the parent has registered for its own end."""
    code = 3
    try:
        faulthandler.dump_traceback_later(SECONDS - 2)  # says on stderr where it hangs
        signal.alarm(SECONDS)
        code = 0 if jobs.same(jobs.JOBS[name](), alone[name]) else 2
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def main(n_forks, seed):
    alone = {name: jobs.JOBS[name]() for name in BUSY}
    stop, failed = threading.Event(), []
    threads = [threading.Thread(target=keep_busy, args=(seed + i, stop, failed)) for i in range(N_THREADS)]
    for thread in threads:
        thread.start()
    pause, ended = random.Random(seed), []
    for i in range(n_forks):
        time.sleep(pause.uniform(0, 0.01))
        pid = os.fork()
        if pid == 0:
            child(IN_THE_CHILD[i % len(IN_THE_CHILD)], alone)
        ended.append(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
    alive = all(thread.is_alive() for thread in threads) and not failed
    stop.set()
    for thread in threads:
        thread.join()
    print(json.dumps({"ended": ended, "alive": alive}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
