"""Time of a grey-box fit of an axis with Coulomb friction, beside scipy's solve_ivp; JSON on stdout.

    .venv/bin/python benchmarks/bench_greybox.py

Figure to reach (design, section 7): 6 records of 3 periods of 6000 samples, 5 parameters with the delay
among them (gain, viscous rate, spring, Coulomb level, delay; inertia 1), from a start 5 % off: every
parameter within 2 standard deviations of the truth, in at most 0.5 s. The records come from the simulated
axis, which shares no code with the plant.

solve_ivp is not run to the end: one period is timed, with friction as tanh(w / 0.05), and scaled to the
simulations that a fit with differences of two points needs (7 Jacobians of 5 parameters, 3 periods of 6
records).
"""

import json
import platform
import time

import numpy as np
import scipy
from scipy.integrate import solve_ivp

from gsid._lib import ffi, lib, version
from gsid.excitation.multisine import Multisine
from gsid.greybox.fit import fit_plant
from gsid.plant.model import PlantModel
from gsid.records.record import Record
from gsid.rig.axis import SimulatedAxis
from gsid.spectrum.realisation import spectra

FS_HZ, N, PERIODS, RECORDS, TURNS = 3000.0, 6000, 3, 6, 7
AXIS = {"gain": 900.0, "viscous_rate": 11.0, "spring_stiffness": 400.0, "delay_s": 0.0051}
AXIS |= {"coulomb_level": 60.0}
OFF = {"mode_f_hz": 0, "mode_residue": 0, "gyro_lag_s": 0, "noise_low_rms": 0, "fan_amplitude": 0}
OFF |= {"command_limit": 0, "command_bits": 0}
NAMES = {
    "rigid_body.gain": "gain",
    "viscous_friction.rate": "viscous_rate",
    "cable_spring.stiffness": "spring_stiffness",
    "coulomb_friction.level": "coulomb_level",
    "transport_delay.delay_s": "delay_s",
}
SETTLE = 12  # periods; the slowest time constant is 0.2 s, a period 2 s
NOISE = 0.01  # of the output's rms
SCIPY_SIMULATIONS = 7 * (5 + 1) * RECORDS * PERIODS


def make_records() -> list[Record]:
    """Records in steady state, each with its own phases and noise."""
    records = []
    for i in range(RECORDS):
        u = Multisine.design(FS_HZ, N, (0.5, 250), amplitude=0.1, phases="random", seed=i).table()
        axis = SimulatedAxis(fs_hz=FS_HZ, noise_rms=0, **AXIS, **OFF)
        y = axis.step(np.tile(u, SETTLE + PERIODS))[1][SETTLE * N :]
        y = y + NOISE * np.std(y) * np.random.default_rng(100 + i).standard_normal(len(y))
        records.append(Record(np.tile(u, PERIODS), y, FS_HZ, N, 0, hold="zoh", name=f"r{i}", y_unit="deg/s"))
    return records


def start() -> PlantModel:
    """The model with values 5 % off, up and down in turn."""
    effects = []
    for i, (name, of_axis) in enumerate(NAMES.items()):
        effect, parameter = name.split(".")
        effects.append({"effect": effect, "params": {parameter: AXIS[of_axis] * 1.05 ** (-1) ** i}})
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "effects": effects})


def seconds_of_solve_ivp(record: Record) -> dict[str, float]:
    """Time of one period [s]: the defaults (RK45, inaccurate), and LSODA with steps of a sample at most."""
    u, delay = record.u[:N], AXIS["delay_s"]

    def slope(t: float, x: np.ndarray) -> tuple[float, float]:
        command = u[int((t - delay) * FS_HZ) % N]
        friction = AXIS["viscous_rate"] * x[1] + AXIS["coulomb_level"] * np.tanh(x[1] / 0.05)
        return x[1], AXIS["gain"] * command - friction - AXIS["spring_stiffness"] * x[0]

    times = {}
    for name, options in (("RK45", {}), ("LSODA", {"method": "LSODA", "max_step": 1 / FS_HZ})):
        begin = time.perf_counter()
        solve_ivp(slope, (0, N / FS_HZ), (0.0, 0.0), t_eval=np.arange(N) / FS_HZ, **options)
        times[name] = time.perf_counter() - begin
    return times


def main() -> None:
    """Run the benchmark and print its figures."""
    records = make_records()
    times = dict.fromkeys(("fit", "spectra_and_fit", "cpu_of_fit"), np.inf)
    for _ in range(TURNS):
        begin = time.perf_counter()
        lines = [spectra(record) for record in records]
        middle, cpu = time.perf_counter(), time.process_time()
        fit = fit_plant(start(), lines)
        end = time.perf_counter()
        times["fit"] = min(times["fit"], end - middle)
        times["cpu_of_fit"] = min(times["cpu_of_fit"], time.process_time() - cpu)
        times["spectra_and_fit"] = min(times["spectra_and_fit"], end - begin)
    parameters = {
        name: {"true": AXIS[of_axis], "value": fit.model[name].value, "std": fit.model[name].std}
        for name, of_axis in NAMES.items()
    }
    for p in parameters.values():
        p["z"] = (p["value"] - p["true"]) / p["std"]
    scipy_times = seconds_of_solve_ivp(records[0])
    figures = {
        "records": {"samples": RECORDS * PERIODS * N, "records": RECORDS, "periods": PERIODS, "period": N},
        "versions": {
            "gsid": version(),
            "nlopt": ffi.string(lib.gsid_build_library_version(b"nlopt")).decode(),
            "suitesparse": ffi.string(lib.gsid_build_library_version(b"suitesparse")).decode(),
            "scipy": scipy.__version__,
            "numpy": np.__version__,
            "python": platform.python_version(),
            "machine": platform.machine(),
        },
        "seconds": times,
        "iterations": fit.n_iterations,
        "cost_per_dof": fit.cost_per_dof,
        "parameters": parameters,
        "within_2_sigma": all(abs(p["z"]) <= 2 for p in parameters.values()),
        "solve_ivp_seconds_of_one_period": scipy_times,
        "solve_ivp_seconds_of_a_fit_estimated": {
            name: seconds * SCIPY_SIMULATIONS for name, seconds in scipy_times.items()
        },
    }
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
