"""What the tests and studies of the fleet run on a unit, and the records of their units."""

import os
import signal
import time
from pathlib import Path

FS_HZ, N_PERIOD, N_PERIODS = 500.0, 500, 6
POLE = 0.97


def work(job):
    """Do as the arguments of the job say, in their order, and return `value`."""
    from gsid.base.threads import n_threads

    for what, how in job.arguments.items():
        match what:
            case "log":  # a line for each time that the unit runs
                with open(how, "a") as file:
                    file.write(f"{job.unit}\n")
            case "seconds":
                time.sleep(how)
            case "busy_s":  # work, not waiting
                end = time.process_time() + how
                while time.process_time() < end:
                    pass
            case "signal":
                os.kill(os.getpid(), how)
            case "bytes":
                bytearray(how)
            case "exit":
                os._exit(how)
            case "text":
                raise ValueError(how)
    return {"value": job.arguments.get("value"), "threads": n_threads(8)}


def diagnose_or_crash(job):
    """Run the verb of the recipe; a record named "crash" ends its process, as a fault in C code would."""
    if any(Path(path).stem == "crash" for path in job.records):
        os.kill(os.getpid(), signal.SIGSEGV)
    from gsid.cli.fleet_verb import run

    return run(job)


def write_records(folder, n, seed=7, *, crash=None):
    """Write one record for each of n units: first-order axes whose gain varies by 5 %; returns the folder."""
    import numpy as np  # the fork server of the tests starts faster without them
    from scipy.signal import lfilter

    lines = np.arange(1, 100, 2)
    for i in range(n):
        rng = np.random.default_rng([seed, i])
        spectrum = np.zeros(N_PERIOD // 2 + 1, complex)
        spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines))) * N_PERIOD / 20
        u = np.tile(np.fft.irfft(spectrum, N_PERIOD), N_PERIODS + 2)
        y = lfilter([0, 0.1 * (1 + 0.05 * rng.standard_normal())], [1, -POLE], u)[2 * N_PERIOD :]
        y += 0.01 * rng.standard_normal(len(y))
        place = Path(folder) / f"SN{i:04d}"
        place.mkdir(parents=True, exist_ok=True)
        keys = {"fs_hz": FS_HZ, "period_samples": N_PERIOD, "settle_samples": 0, "hold": "zoh"}
        name = "crash" if i == crash else "record"
        units = {"u_unit": "V", "y_unit": "deg/s"}
        np.savez(
            place / f"{name}.npz", u=u[2 * N_PERIOD :], y=y, valid=np.ones(len(y), bool), **keys, **units
        )
    return Path(folder)
