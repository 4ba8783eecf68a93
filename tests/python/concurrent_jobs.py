"""Jobs that between them call every C function the package calls: alone, then in threads beside each other.

Run as a script, since what it looks for ends the process. Prints JSON: the C functions that were called, and
the jobs whose answers in threads differ from those alone.
"""

# ruff: noqa: E402  (the recorders take the place of the libraries before the package is imported)
import itertools
import json
import random
import sys
import threading

import gsid._lib as library


class Recorder:
    """A C library that notes which of its names are used."""

    def __init__(self, lib):
        self._gsid, self.called = lib, set()

    def __getattr__(self, name):
        value = getattr(self._gsid, name)
        self.called.add(name)
        return value


library.lib, library.lib32 = Recorder(library.lib), Recorder(library.lib32)

import mimo_gimbal
import numpy as np

import gsid
from gsid import effects
from gsid.base.errors import GsidError
from gsid.comparison import compare
from gsid.diagnosis.missing_torque.stage import first_stage
from gsid.excitation.generators import Prbs, SteppedSine, Sweep
from gsid.excitation.limits import optimise
from gsid.excitation.multisine import Multisine
from gsid.excitation.periodic import Limits
from gsid.fitting.mimo import fit_mimo
from gsid.fitting.rational import fit
from gsid.greybox.fit import fit_plant
from gsid.models.misfit import Errors, misfit
from gsid.models.rational import RationalModel
from gsid.plant.model import PlantModel
from gsid.records.record import Record
from gsid.report import words
from gsid.response.estimate import frf
from gsid.response.estimate_distortion import StreamingDistortion, distortion
from gsid.response.frf import merged
from gsid.response.mimo import frf_mimo
from gsid.response.streaming import StreamingFrf
from gsid.rig.axis import SimulatedAxis
from gsid.rig.frames import Receiver, encode, frames
from gsid.spectrum.line_test import exponential_score
from gsid.structure.start import start

FS_HZ, N_THREADS, N_ROUNDS = 1000.0, 4, 2
AXIS = RationalModel([7.4, 200], [1, 30, 4e4], 0.002, fs_hz=FS_HZ, hold="zoh")


def record(n, n_periods=6, seed=0, lines="full"):
    """Steady state of AXIS, with noise of its own for each seed."""
    u = Multisine.design(FS_HZ, n, (5, 200), grid=lines, phases="random", seed=seed).table()
    f_hz = np.arange(1, n // 2 + 1) * FS_HZ / n
    y = np.fft.irfft(np.fft.rfft(u) * np.r_[0, AXIS.response(f_hz)], n)
    noise = 0.01 * np.random.default_rng(seed).standard_normal(n * n_periods)
    return Record(
        np.tile(u, n_periods),
        np.tile(y, n_periods) + noise,
        FS_HZ,
        hold="zoh",
        period_samples=n,
        settle_samples=0,
    )


def plant(fs_hz=FS_HZ, **more):
    stack = {"rigid_body": {"gain": 7.0}, "viscous_friction": {"rate": 10.0}} | more
    entries = [{"effect": name, "params": params} for name, params in stack.items()]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": fs_hz, "effects": entries})


def spectra_of_several_periods():
    responses = [frf(record(n, seed=n)) for n in (400, 440, 486, 400)]
    return [one.g for one in (*responses, merged([responses[0], responses[-1]]))]


def a_long_period():
    """Longer than a plan that is kept."""
    u = np.random.default_rng(1).standard_normal(2**20 + 2)
    return gsid.spectrum.lines.period_lines(u[None], np.arange(1, 9, dtype=np.uint32), 0)


def phases(limits=None, model=None):
    found = []
    for seed, n in enumerate(range(400, 520, 4)):
        start = Multisine.design(FS_HZ, n, (5, 150), phases="random", seed=seed)
        found.append(optimise(start, limits, model, effort=1).phase_rad)
    return found


def phases_of_command_and_travel():
    return phases(Limits(command=3, travel=1), AXIS)


def rational(method, **how):
    model = fit(frf(record(400)), "2/1", method=method, **how)
    return model.num, model.den, model.delay_s


def comparison():
    found = compare(AXIS, [record(400, seed=seed) for seed in (1, 2)])
    tail = library.ffi.new("gsid_tail *")
    sides = []
    for name, values in (("gamma", (3, 4)), ("chi2", (3, 4)), ("beta", (2, 3, 0.25, 0.75)), ("f", (1, 5, 4))):
        getattr(library.lib, f"gsid_tail_{name}")(*map(float, values), tail)
        sides += [tail.lower, tail.log_upper]
    test = misfit_of(found)
    return found.log10_p_value, found.cost, sides, test


def misfit_of(found):
    n, variance = len(found.error), found.sigma**2
    columns = (np.full(n, 5.0), variance, np.arange(n) == 0, np.ones((n, 1), complex))
    errors = Errors(found.error, variance, *columns)
    return misfit(errors).p_value, exponential_score(errors.t, 5.0)


def several_inputs():
    model = fit_mimo(frf_mimo(mimo_gimbal.experiments(7, n_periods=2)).in_band((1, 20)), "2/1")
    return model.poles, model.delay_s


def stack_of_effects(**how):
    records = [simulated(seed) for seed in (1, 2, 3)]
    return fit_plant(plant(coulomb_friction={"level": 3.0}), records, **how).model.free_values


def stops():
    sprung = {"cable_spring": {"stiffness": 100.0}, "hard_stop": {"angle_deg": 0.1, "stiffness": 1e4}}
    return plant(**sprung).predict(simulated(1)).y


def missing_torque():
    found = first_stage([simulated(seed) for seed in (1, 2)], plant())
    return [[one.gain for one in found.ranking], found.cost_per_dof]


def linear_structure():
    found = start([simulated(seed) for seed in (1, 2)])
    return list(found.effects), np.array(found.rational.den), found.cost_per_line


def simulated(seed):
    u = 5 * Multisine.design(FS_HZ, 400, (5, 100), phases="random", seed=seed).table()
    y = plant(coulomb_friction={"level": 4.0}).simulate(u).y
    noise = 0.01 * np.random.default_rng(seed).standard_normal(4 * len(y))
    return Record(
        np.tile(u, 4), np.tile(y, 4) + noise, FS_HZ, hold="zoh", period_samples=400, settle_samples=0
    )


def streamed(precision, engine):
    one = record(400)
    parts = []
    for valid in (np.ones(len(one.u), bool), np.arange(len(one.u)) != 500):
        part = StreamingFrf(FS_HZ, 400, np.arange(2, 40), precision=precision, engine=engine)
        part.step(one.u, one.y, valid)
        parts.append(part)
    parts[0].merge(parts[1])
    return parts[0].result().g


def distorted():
    one = distortion([record(400, seed=seed, lines="odd") for seed in range(3)])
    return one.bla, one.var_noise


def distorted_streaming(precision):
    excited = np.arange(3, 41, 2)
    measured = StreamingDistortion(FS_HZ, 400, excited, np.arange(2, 41, 2), precision=precision)
    for seed in (1, 2):
        one = record(400, seed=seed, lines="odd")
        measured.start()
        measured.step(np.where(np.arange(len(one.u)) == 700, np.nan, one.u), one.y)
        measured.finish()
    return measured.result().bla


def excitations():
    grids = [
        Multisine.design(FS_HZ, 1000, (5, 200), grid=grid, phases=how, seed=3, shape_db_per_decade=-10)
        for grid, how in itertools.product(
            ["full", "odd", "odd-random", "quasi-log"], ["schroeder", "random"]
        )
    ]
    others = [
        Prbs.design(FS_HZ, 1018, (5, 200)),
        Sweep.design(FS_HZ, 1000, (5, 200)),
        SteppedSine.design(FS_HZ, 1000, (5, 200)),
    ]
    return [one.table() for one in [*grids, *others]]


def axis():
    served = SimulatedAxis(seed=5)
    u = record(400).u[:800]
    first = served.step(u)
    served.reset()
    return first, served.step(u), served.fs_hz


def frames_there_and_back():
    sent = frames(1, np.arange(200), np.sin(np.arange(200)), np.cos(np.arange(200)))
    receiver = Receiver()
    receiver.session = 5
    return receiver.decode(encode(sent, 5))


def responses():
    f_hz = np.linspace(1, 400, 50)
    other = RationalModel(AXIS.num, AXIS.den, 0.001, fs_hz=FS_HZ)
    return AXIS.response(f_hz), other.response(f_hz), AXIS.poles, AXIS.zeros


def laws():
    own = effects.expression("c*tanh(w/width)", {"c": 1.0, "width": 0.5})
    curve = effects.table(("w", [-2, -1, 0, 1, 2], [-1, -1, 0, 1, 1]))
    return own.names, curve.names, sorted(effects.catalogue())


def versions():
    return library.version(), words.versions()


def failures():
    try:
        StreamingFrf(FS_HZ, 400, [5]).result()
    except GsidError as error:
        return str(error), error.hint
    raise AssertionError("a response without periods")


JOBS = {
    job.__name__: job
    for job in (spectra_of_several_periods, a_long_period, phases, phases_of_command_and_travel,
                several_inputs, comparison, linear_structure, missing_torque, stops, distorted, excitations,
                axis, frames_there_and_back, responses, laws, versions, failures)
}  # fmt: skip
for name in ("ls", "iwls", "ga", "nls", "log", "ml", "ml-io", "nls-output"):
    JOBS[f"rational {name}"] = lambda name=name: rational(name)
JOBS["rational z"] = lambda: rational("ml", domain="z", delay=0.002)
for name in ("nlopt", "lm"):
    JOBS[f"stack {name}"] = lambda name=name: stack_of_effects(solver=name)
for precision, engine in itertools.product(("double", "single"), ("direct", "spread")):
    JOBS[f"streamed {precision} {engine}"] = lambda p=precision, e=engine: streamed(p, e)
for precision in ("double", "single"):
    JOBS[f"distortion {precision}"] = lambda p=precision: distorted_streaming(p)


def same(one, other):
    """Equal to the last bit."""
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.tobytes() == other.tobytes()
    return one == other


def main(seed):
    alone = {name: job() for name, job in JOBS.items()}
    called = sorted(library.lib.called | library.lib32.called)
    different = []

    def work(thread):
        order = list(JOBS) * N_ROUNDS
        random.Random(seed + thread).shuffle(order)
        for name in order:
            try:
                if not same(JOBS[name](), alone[name]):
                    different.append(name)
            except Exception as error:
                different.append(f"{name}: {error!r}")

    threads = [threading.Thread(target=work, args=(i,)) for i in range(N_THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(json.dumps({"called": called, "different": different}))


if __name__ == "__main__":
    main(int(sys.argv[1]))
