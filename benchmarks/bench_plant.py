"""Time of a plant per sample, with and without sensitivities; JSON on stdout.

    .venv/bin/python benchmarks/bench_plant.py

The axis of the thesis in its periodic steady state, 6000 samples, linear and with friction that sticks and
slips. Figures to reach: well under 1 us a sample for the value alone, about 3 us with 10 free parameters.
The value alone is what one more settling period costs; "all sensitivities" is a period with the columns of
the free parameters and of the start's states, which the search needs. The best of several turns counts.
"""

import json
import platform
import time

import numpy as np

from gsid._lib import ffi, lib, version

FS_HZ, N, TURNS, SEED = 3000.0, 6000, 7, 1
SOURCE = [
    ("transport_delay", [5.4e-3]),
    ("rigid_body", [7.4]),
    ("viscous_friction", [11.0]),
    ("cable_spring", [170.0]),
    ("flexible_mode", [179.0, 0.015, 0.15]),
    ("sensor_lag", [1e-3]),
]
FRICTION = [("coulomb_friction", [15.0]), ("torque_bias", [0.0])]


def make_command() -> np.ndarray:
    """Return one period of odd lines up to 200 Hz with random phases, peak 100."""
    rng = np.random.default_rng(SEED)
    lines = np.zeros(N // 2 + 1, complex)
    line = np.arange(1, 400, 2)
    lines[line] = np.exp(2j * np.pi * rng.random(len(line)))
    u = np.fft.irfft(lines, N)
    return 100 * u / np.abs(u).max()


class Plant:
    """A stack in the library's own words, every parameter free."""

    def __init__(self, stack: list[tuple[str, list[float]]]) -> None:
        self.item = ffi.new("gsid_plant_item[]", len(stack))
        self.free = ffi.new("gsid_plant_free[]", 32)
        self.cfg = ffi.new("gsid_plant_cfg *", {"fs_hz": FS_HZ, "n_items": len(stack)})
        self.cfg.item, self.cfg.free_parameter = self.item, self.free
        for i, (name, values) in enumerate(stack):
            self.item[i].effect = lib.gsid_catalogue_find(name.encode())
            for k, value in enumerate(values):
                self.item[i].value[k] = value
                self.free[self.cfg.n_free] = {"item": i, "parameter": k}
                self.cfg.n_free += 1
        self.n_bytes = lib.gsid_plant_mem_size(self.cfg)
        self.memory = ffi.new("double[]", self.n_bytes // 8 + 1)
        self.plant = ffi.new("gsid_plant *")
        assert lib.gsid_plant_init(self.plant, self.cfg, self.memory, self.n_bytes) == 0
        self.y = np.empty(N)
        self.dy = np.empty((self.cfg.n_free, N))

    def run(self, u: np.ndarray, n_settle: int, n_newton: int, sensitivities: bool) -> float:
        """Run the search for the periodic state; return its residual."""
        residual = ffi.new("double *")
        u_c, y_c, dy_c = (ffi.from_buffer("double[]", a) for a in (u, self.y, self.dy))
        out = (y_c, dy_c if sensitivities else ffi.NULL, ffi.NULL, ffi.NULL, residual)
        status = lib.gsid_plant_periodic(self.plant, N, u_c, n_settle, n_newton, *out)
        assert status >= 0
        return residual[0]


def best_time(job) -> float:
    """Return the best time of a job [s]."""
    best = float("inf")
    for _ in range(TURNS):
        start = time.perf_counter()
        job()
        best = min(best, time.perf_counter() - start)
    return best


def measure(stack: list[tuple[str, list[float]]], u: np.ndarray) -> dict:
    """Return the figures of one stack."""
    plant = Plant(stack)
    residual = plant.run(u, 2, 10, True)
    search = best_time(lambda: plant.run(u, 0, 0, False))
    one_more = best_time(lambda: plant.run(u, 1, 0, False)) - search
    with_dy = best_time(lambda: plant.run(u, 0, 0, True))
    from_rest = best_time(lambda: (lib.gsid_plant_reset(plant.plant), plant.run(u, 1, 10, True)))
    update = best_time(lambda: lib.gsid_plant_update(plant.plant))
    return {
        "n_free": plant.cfg.n_free,
        "value_ns_per_sample": round(one_more / N * 1e9),
        "all_sensitivities_ns_per_sample": round(with_dy / N * 1e9),
        "periodic_from_rest_ms": round(from_rest * 1e3, 2),
        "update_us": round(update * 1e6),
        "residual": residual,
        "bytes": plant.n_bytes,
    }


def main() -> None:
    """Measure and print."""
    u = make_command()
    result = {"linear": measure(SOURCE, u), "coulomb": measure(SOURCE + FRICTION, u)}
    stribeck = [("stribeck_friction", [15.0, 5.0, 1.0]), ("cubic_spring", [10.0])]
    result["stribeck_and_cubic"] = measure(SOURCE + stribeck, u)
    where = {"gsid": version(), "machine": platform.machine(), "python": platform.python_version()}
    print(json.dumps(result | where, indent=2))


if __name__ == "__main__":
    main()
