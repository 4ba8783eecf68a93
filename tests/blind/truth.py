"""The blind trials' own plant, from Python: runs, the periodic steady state, the linear axis in closed form.

Nothing here or in truth.c comes from the product: a test must not share the errors of what it tests.
"""

from __future__ import annotations

import ctypes
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import expm

LIBRARY = Path(os.environ.get("BUILD", Path(__file__).parents[2] / "build")) / "blind" / "libtruth.so"
FINE = 16  # Runge-Kutta steps per sample: 48 kHz at 3 kHz
COARSE = 4  # the same where a size is only searched for, and for the slopes of the shooting

_VECTOR = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")


class TruthError(RuntimeError):
    """The truth could not be simulated: the trial has to be drawn anew."""


def _load() -> ctypes.CDLL:
    if not LIBRARY.exists():
        raise FileNotFoundError(f"{LIBRARY} is missing; hint: make {LIBRARY.relative_to(Path.cwd())}")
    library = ctypes.CDLL(str(LIBRARY))
    library.truth_parameter_name.restype = ctypes.c_char_p
    library.truth_torque.restype = ctypes.c_double
    library.truth_torque.argtypes = [_VECTOR, ctypes.c_double, ctypes.c_double, ctypes.c_double]
    library.truth_command.restype = None
    library.truth_command.argtypes = [_VECTOR, ctypes.c_size_t, _VECTOR, _VECTOR]
    size = ctypes.c_size_t
    library.truth_run.argtypes = [
        _VECTOR,
        size,
        _VECTOR,
        size,
        ctypes.c_int,
        _VECTOR,
        _VECTOR,
        _VECTOR,
        _VECTOR,
    ]
    return library


_lib = _load()
NAMES = [_lib.truth_parameter_name(i).decode() for i in range(_lib.truth_n_parameters())]
STATES = ["theta", "rate", "motor_theta", "motor_rate", "actuator", "mode", "mode_rate", "sensor", "bristle"]
STATES += ["creep", "work", "dissipated"]
N_DYNAMIC = 10  # states before the two energies
RATE_SCALE = 10.0  # deg/s, beside 1 deg
_STATUS = {-1: "bad argument", -2: "not finite", -3: "too many events in one step"}


def vector(params: dict[str, float]) -> np.ndarray:
    """Parameters by name to the simulator's vector; those not named are 0 (absent)."""
    values = np.zeros(len(NAMES))
    for name, value in params.items():
        values[NAMES.index(name)] = value
    return values


def torque(params: dict[str, float], theta: float, rate: float, actuator: float = 0.0) -> float:
    """Torque that is subtracted from gain times command [deg/s^2]."""
    return _lib.truth_torque(vector(params), theta, rate, actuator)


def command(params: dict[str, float], u: np.ndarray) -> np.ndarray:
    """The periodic command after the maps that act on it as it enters."""
    u = np.ascontiguousarray(u, float)
    v = np.empty_like(u)
    _lib.truth_command(vector(params), len(u), u, v)
    return v


def run(params: dict[str, float], u: np.ndarray, x: np.ndarray | None = None, *, n_periods=1, n_steps=FINE):
    """Run periods of the periodic command u from the state x (default: at rest).

    Returns
    -------
    y, theta, rate : (n,) of the last period; x : (12,) state after it.
    """
    u = np.ascontiguousarray(u, float)
    x = np.zeros(len(STATES)) if x is None else np.array(x, float)
    y, theta, rate = np.empty((3, len(u)))
    # Stable lags: steps of two time constants. Short ones act as delays, which Runge-Kutta keeps exactly.
    lags = [params[name] for name in ("motor_lag_s", "sensor_lag_s") if params.get(name)]
    n_steps = max([n_steps, *(int(np.ceil(0.5 / (lag * params["fs_hz"]))) for lag in lags)])
    status = _lib.truth_run(vector(params), len(u), u, n_periods, n_steps, x, y, theta, rate)
    if status != 0 or not np.all(np.isfinite(x)):
        raise TruthError(f"truth_run: {_STATUS.get(status, 'not finite')}")
    return y, theta, rate, x


@dataclass
class Start:
    """Where a search for the periodic answer begins: the state, and the inverse of I - Phi there."""

    x: np.ndarray
    inverse: np.ndarray
    scale: np.ndarray


def steady(params, u, *, tolerance: float, start: Start | None = None, n_steps=FINE, n_periods_max=60):
    """The periodic answer: Newton on the state at the period's start.

    Slopes come from differences at the coarse step; where the Newton step does not help (sticking makes the
    slopes jump) the axis is left to settle by itself for a while.

    Parameters
    ----------
    tolerance : difference of the state between a period's ends that counts as settled, as a rate [deg/s].
    start : of a like axis; taken when it has the same states.

    Returns
    -------
    y, theta, rate : (n,); start : Start, its state that of the period's start

    Raises
    ------
    TruthError
        Not settled after n_periods_max periods, or not finite.
    """
    scale = _scales(params)
    if start is None or np.any((start.scale > 0) != (scale > 0)):
        x = run(params, u, n_steps=COARSE)[3]
        x[N_DYNAMIC:] = 0.0
        start = Start(x, _newton_matrix(params, u, x, scale), scale)
    x, inverse, best = start.x.copy(), start.inverse, np.inf
    active = scale > 0
    for _ in range(n_periods_max):
        y, theta, rate, end = run(params, u, x, n_steps=n_steps)
        gap = (end - x)[:N_DYNAMIC]
        error = np.linalg.norm(gap[active] / scale[active])
        if error * RATE_SCALE < tolerance:
            return y, theta, rate, Start(x, inverse, scale)
        if error < 0.2 * best:
            best = error
            x[:N_DYNAMIC] += inverse @ gap
        else:
            best = np.inf
            x = run(params, u, end, n_steps=n_steps)[3]
            inverse = _newton_matrix(params, u, x, scale)
        x[N_DYNAMIC:] = 0.0
    raise TruthError(f"not settled after {n_periods_max} periods")


def _scales(params: dict[str, float]) -> np.ndarray:
    """Size of each state, 0 where it plays no part."""
    has = {name for name, value in params.items() if value}
    mode_rad_s = 2 * np.pi * params.get("mode_hz", 0.0)
    geared = "gear_stiffness" in has
    return np.array(
        [
            1.0,
            RATE_SCALE,
            float(geared),
            RATE_SCALE * geared,
            10.0 * ("motor_lag_s" in has),
            RATE_SCALE / mode_rad_s if mode_rad_s else 0.0,
            RATE_SCALE if mode_rad_s else 0.0,
            RATE_SCALE * ("sensor_lag_s" in has),
            float("presliding_level" in has),
            float("creep_time_s" in has),
        ]
    )


def _newton_matrix(params, u, x, scale) -> np.ndarray:
    """Inverse of I - Phi by differences;
    where nothing pulls back (an angle without spring) nothing is moved.
    """
    at = run(params, u, x, n_steps=COARSE)[3]
    phi = np.zeros((N_DYNAMIC, N_DYNAMIC))
    active = np.flatnonzero(scale)
    for i in active:
        moved = x.copy()
        moved[i] += 1e-5 * scale[i]
        phi[:, i] = (run(params, u, moved, n_steps=COARSE)[3] - at)[:N_DYNAMIC] / 1e-5
    scaled = np.eye(len(active)) - phi[np.ix_(active, active)] / scale[active, None]
    inverse = np.eye(N_DYNAMIC)
    inverse[np.ix_(active, active)] = (
        scale[active, None] * np.linalg.pinv(scaled, rcond=1e-7) / scale[None, active]
    )
    return inverse


# ---- the linear axis in closed form --------------------------------------------------------------


def linear_response(params: dict[str, float], f_hz: np.ndarray, *, output: str = "y") -> np.ndarray:
    """Response of the sampled, held linear axis, exactly: x[n+1] from the two pieces of the delayed hold.

    Parameters
    ----------
    params : linear ones only are looked at
    f_hz : (F,) > 0
    output : "y" or "theta"
    """
    get = params.get
    fs_hz, gain = params["fs_hz"], params["gain"]
    theta, rate, act, mode, mode_rate, sensor, held = range(7)
    a = np.zeros((7, 7))  # the held command is a state: its column is B
    a[theta, rate] = 1.0
    a[rate, theta], a[rate, rate] = -get("spring_stiffness", 0.0), -get("viscous_rate", 0.0)
    drive = held
    if get("motor_lag_s", 0.0) > 0:
        a[act, act], a[act, held] = -1 / params["motor_lag_s"], 1 / params["motor_lag_s"]
        drive = act
    a[rate, drive] = gain
    c = np.zeros(6)
    c[rate] = 1.0
    if get("mode_hz", 0.0) > 0:
        w0 = 2 * np.pi * params["mode_hz"]
        a[mode, mode_rate] = 1.0
        a[mode_rate, [mode, mode_rate]] = -(w0**2), -2 * params["mode_zeta"] * w0
        a[mode_rate, drive] = params["mode_residue"] * gain
        c[mode_rate] = 1.0
    if get("sensor_lag_s", 0.0) > 0:
        a[sensor, :6] = c / params["sensor_lag_s"]
        a[sensor, sensor] = -1 / params["sensor_lag_s"]
        c = np.eye(6)[sensor]
    if output == "theta":
        c = np.eye(6)[theta]
    whole, fraction = divmod(get("delay_s", 0.0) * fs_hz, 1.0)
    first, second = expm(a * fraction / fs_hz), expm(a * (1 - fraction) / fs_hz)
    # Modal form: expensive once, cheap per line.
    pole, modes = np.linalg.eig(second[:6, :6] @ first[:6, :6])
    seen = c @ modes
    old = np.linalg.solve(modes, second[:6, :6] @ first[:6, 6]) * seen
    new = np.linalg.solve(modes, second[:6, 6]) * seen
    z = np.exp(2j * np.pi * np.asarray(f_hz) / fs_hz)[:, None]
    return np.sum((old / z + new) * z**-whole / (z - pole), axis=1)
