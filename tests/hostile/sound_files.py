"""Sound files: what the bad ones are made from, and what the commands need beside them."""

import json

import numpy as np

SEED = 1500
N_PERIOD, N_PERIODS, FS_HZ = 60, 6, 1000.0
ESCAPE = "\x1b[31mred\x1b]0;title\x07"


def samples():
    """A held multisine through a first-order lag, with noise: what the plants below answer."""
    rng = np.random.default_rng(SEED)
    spectrum = np.zeros(N_PERIOD // 2 + 1, complex)
    spectrum[1:20] = np.exp(2j * np.pi * rng.random(19))
    u = np.tile(np.fft.irfft(spectrum, N_PERIOD), N_PERIODS + 2) * N_PERIOD / 2
    y = np.zeros(len(u))
    for n in range(1, len(u)):
        y[n] = 0.8 * y[n - 1] + 0.5 * u[n - 1]
    noise = np.random.default_rng(SEED + 2)  # a draw far from the level of the test: no search follows
    y = y[2 * N_PERIOD :] + 0.01 * noise.standard_normal(N_PERIODS * N_PERIOD)
    return u[2 * N_PERIOD :], y


U, Y = samples()
T = np.arange(len(U)) / FS_HZ
KEYS = {
    "fs_hz": "1000",
    "period_samples": "60",
    "settle_samples": "0",
    "hold": "zoh",
    "u_unit": "A",
    "y_unit": "deg/s",
}


def csv(keys=None, columns=None):
    """A record as text; keys and columns in the place of the sound ones."""
    columns = {"t_s": T, "u": U, "y": Y} if columns is None else columns
    lines = [f"# {key}: {value}" for key, value in (KEYS if keys is None else keys).items()]
    lines.append(",".join(columns))
    lines += [
        ",".join(map(repr, row))
        for row in zip(*[np.asarray(c).tolist() for c in columns.values()], strict=True)
    ]
    return ("\n".join(lines) + "\n").encode()


def plant():
    """A stack of effects with everything that a model file may have, some of it next to nothing."""
    table = {
        "variable": "w",
        "unit": "deg/s",
        "at": [-2.0, -1.0, 0.0, 1.0, 2.0],
        "torque": [-2.0, -1.5, 0.0, 1.5, 2.0],
    }
    law = {"torque": "c*tanh(w/10)", "bounds": {"c": [0.0, 10.0]}}
    effects = [
        {
            "effect": "rigid_body",
            "params": {"gain": {"value": 557.9, "free": True, "std": 1.0, "limits": [1.0, 1e4]}},
        },
        {"effect": "viscous_friction", "params": {"rate": 223.1}},
        {"effect": "motor_lag", "params": {"time_constant_s": {"value": 1e-7, "free": False}}},
        {"effect": "expression", "params": {"c": {"value": 1e-3, "free": True}}, **law},
        {"effect": "table", "params": {"scale": {"value": 1e-6, "free": False}}, **table},
    ]
    figures = {"cost_per_dof": 1.0, "rms_error": 0.1, "noise_floor_rms": 0.1}
    rung = {
        "effect": "viscous_friction",
        "params": {"rate": {"value": 200.0, "std": 1.0}},
        "before": figures,
        "after": figures,
        "held_out": {"before": 1.0, "after": 0.1},
        "noise_floor_rms": 0.1,
        "kept_out": "the later periods",
        "y_unit": "deg/s",
        "data": {"fitted": ["a.csv"], "kept_out": ["b.csv"], "band_hz": [10.0, 300.0]},
        "judged_on": "later_periods",
        "fall_p_value": 0.01,
    }
    previous = {"effects": [{"effect": "rigid_body", "params": {"gain": 500.0}}]}
    history = [{"add": "viscous_friction", "rung": rung, "previous": previous}]
    return {
        "gsid_model": 1,
        "made_by": "gsid 0",
        "fs_hz": FS_HZ,
        "output": "rate",
        "angle_unit": "deg",
        "u_unit": "A",
        "y_unit": "deg/s",
        "effects": effects,
        "covariance": {
            "names": ["rigid_body.gain", "viscous_friction.rate", "expression.c"],
            "matrix": np.diag([1.0, 1.0, 0.1]).tolist(),
        },
        "fit": {"cost": 40.0, "cost_per_dof": 1.0, "n_lines": 19},
        "history": history,
    }


def small_plant():
    """A stack of two effects: quick to simulate."""
    effects = [
        {"effect": "rigid_body", "params": {"gain": 557.9}},
        {"effect": "viscous_friction", "params": {"rate": 223.1}},
    ]
    return {"gsid_model": 1, "fs_hz": FS_HZ, "effects": effects}


def catalogue_plant():
    """A stack of the catalogue's effects, one of each stage, that can be exported as C.

    What the sound record does not determine is not free: a fit would take it to where simulations are slow.
    """
    stack = {
        "rigid_body": {"gain": 500.0},
        "transport_delay": {"delay_s": 1e-3},
        "motor_lag": {"time_constant_s": 1e-3},
        "drive_saturation": {"limit": 100.0},
        "viscous_friction": {"rate": 200.0},
        "stribeck_friction": {"level": 0.1, "extra": 0.1, "velocity": 1.0},
        "flexible_mode": {"f_hz": 100.0, "zeta": 0.1, "residue": 1e-6},
        "sensor_lag": {"time_constant_s": 1e-3},
    }
    for effect in ("drive_saturation", "flexible_mode"):
        stack[effect] = {name: {"value": x, "free": False} for name, x in stack[effect].items()}
    effects = [{"effect": effect, "params": params} for effect, params in stack.items()]
    return {"gsid_model": 1, "fs_hz": FS_HZ, "y_unit": "deg/s", "effects": effects}


def rational(domain="s"):
    """A fitted transfer function with its covariance."""
    from gsid.models.rational import RationalModel

    num, den = ([500.0], [1.0, 220.0]) if domain == "s" else ([0.0, 0.5], [1.0, -0.8])
    fitted = {"method": "ml", "cost": 19.0, "cost_expected": 18.0, "n_lines": 19, "converged": True}
    p = len(num) + len(den)
    how = {"fs_hz": FS_HZ, "cov": 1e-6 * np.eye(p), "free_delay": True, "band_hz": (10.0, 350.0)}
    units = {"u_unit": "A", "y_unit": "deg/s"}
    return RationalModel(num, den, 1e-3, domain, **how, **fitted, **units).to_dict()


def pieces():
    """A set of transfer functions in adjoining bands."""
    from gsid.models.piecewise import PiecewiseModel
    from gsid.models.rational import RationalModel

    first = RationalModel.from_dict(rational())
    second = RationalModel.from_dict(rational())
    first.band_hz, second.band_hz = (10.0, 100.0), (100.0, 350.0)
    return PiecewiseModel((first, second), (100.0,)).to_dict()


def matrix():
    """A 2 x 1 matrix of transfer functions."""
    from gsid.models.mimo import MimoModel

    model = MimoModel(
        sections=[4e4, 100.0],
        num=[[[2e4, 0.0]], [[1e4, 1.0]]],
        delay_s=[[5e-4], [1e-3]],
        fs_hz=FS_HZ,
        cov=1e-6 * np.eye(8),
        delay_of=[[0], [1]],
        method="ml",
        cost=40.0,
        cost_expected=38.0,
        n_lines=19,
        converged=True,
        band_hz=(10.0, 350.0),
    )
    return model.to_dict()


def sound_files():
    """What the commands need beside the bad file."""
    return {
        "sound.csv": csv(),
        "plant.json": json.dumps(small_plant()).encode(),
        "rational.json": json.dumps(rational()).encode(),
        "curve.csv": b"w,torque\n-2,-2\n-1,-1.5\n0,0\n1,1.5\n2,2\n",
    }
