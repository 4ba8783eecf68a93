"""Plants and records of the tests: made by the simulated axis, which shares no code with the plants."""

import numpy as np

from gsid.plant.model import PlantModel
from gsid.records.record import Record
from gsid.rig.axis import SimulatedAxis

FS_HZ = 3000.0
OFF = {
    "mode_f_hz": 0,
    "mode_residue": 0,
    "gyro_lag_s": 0,
    "noise_rms": 0,
    "noise_low_rms": 0,
    "fan_amplitude": 0,
}
OFF |= {"command_limit": 0, "command_bits": 0, "coulomb_level": 0, "viscous_rate": 0, "spring_stiffness": 0}
OFF |= {"delay_s": 0, "fs_hz": FS_HZ}


def plant(stack, **more):
    """A model of {effect: {parameter: value}}, all free."""
    effects = [{"effect": effect, "params": params} for effect, params in stack.items()]
    return PlantModel.from_dict({"gsid_model": 1, "fs_hz": FS_HZ, "effects": effects} | more)


def axis_period(u, settle=30, **parameters):
    """One settled period of the axis's answer."""
    return SimulatedAxis(**OFF | parameters).step(np.tile(u, settle + 1))[1][-len(u) :]


def axis_record(u, n_periods, noise, seed, name="", **parameters):
    """Settled periods of the axis's answer with white noise of its own; the delay is in seconds."""
    y = np.tile(axis_period(u, **parameters), n_periods)
    y = y + noise * np.random.default_rng(seed).standard_normal(len(y))
    return Record(np.tile(u, n_periods), y, FS_HZ, len(u), 0, hold="zoh", name=name, y_unit="deg/s")
