"""A simulated gimbal axis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsid._lib import check, ffi, lib
from gsid.base.errors import InputError, close
from gsid.effects.types import catalogue, find

#: Effects that the axis implements itself: their parameters, and the names of these in the axis.
HIDDEN = {
    effect.id: {p.name: p.axis_field for p in effect.parameters}
    for effect in catalogue().values()
    if all(p.axis_field for p in effect.parameters)
}


def parameter_types() -> dict[str, type]:
    """Names of the axis's parameters and their types, as in the C struct gsid_axis_cfg."""
    return {
        name: int if field.type.cname.startswith("uint") else float
        for name, field in ffi.typeof("gsid_axis_cfg").fields
    }


def hidden_parameters(effect: str, params: Mapping[str, float]) -> dict[str, float]:
    """Parameters of the axis that give it an effect of the catalogue.

    Parameters
    ----------
    effect : str
        One of `HIDDEN`.
    params : dict of float
        Names and units are those of the catalogue; the default of each is its typical value.

    Returns
    -------
    dict of float

    Raises
    ------
    InputError
        The axis has no such effect, or the effect no such parameter.
    """
    known = find(effect)
    if effect not in HIDDEN:
        raise InputError(
            "the simulated axis does not have this effect",
            "",
            effect,
            f"it has {', '.join(HIDDEN)}",
        )
    for name in params:
        if name not in known.names:
            hint = close(name, known.names) or f"it has {', '.join(known.names)}"
            raise InputError("unknown parameter", f"{effect}.{name}", None, hint)
    return {field: params.get(name, known[name].typical) for name, field in HIDDEN[effect].items()}


class SimulatedAxis:
    """Simulated axis. The defaults are those of the inner azimuth axis of the thesis.

    Parameters
    ----------
    **parameters
        Fields of gsid_axis_cfg; include/gsid/host/axis.h states units and ranges.

    Raises
    ------
    ValueError
        No such parameter.
    GsidError
        A value is out of its range.
    """

    def __init__(self, **parameters: float) -> None:
        cfg = ffi.new("gsid_axis_cfg *")
        lib.gsid_axis_cfg_init(cfg)
        types = parameter_types()
        for name, value in parameters.items():
            if name not in types:
                raise ValueError(f"no axis parameter {name}; the axis has {', '.join(types)}")
            setattr(cfg, name, types[name](value))
        self.parameters: dict[str, float] = {name: getattr(cfg, name) for name in types}
        handle = ffi.new("gsid_axis **")
        check(lib.gsid_axis_create(handle, cfg), "making the simulated axis")
        self._axis = ffi.gc(handle[0], lib.gsid_axis_destroy)

    def __repr__(self) -> str:
        return f"SimulatedAxis({', '.join(f'{name}={value:g}' for name, value in self.parameters.items())})"

    @property
    def fs_hz(self) -> float:
        """Ticks per second [Hz]."""
        return self.parameters["fs_hz"]

    def reset(self) -> None:
        """Reset the axis to rest at tick 0, and restart the noise."""
        lib.gsid_axis_reset(self._axis)

    def with_noise_of_run(self, n: int) -> SimulatedAxis:
        """Return the same axis with noise that is independent of this axis's.

        Parameters
        ----------
        n : int
            Number of the run. Each run has different noise.
        """
        (seed,) = np.random.SeedSequence([int(self.parameters["seed"]), n]).generate_state(1, np.uint64)
        return type(self)(**{**self.parameters, "seed": int(seed)})

    def step(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Advance by n ticks.

        Parameters
        ----------
        u : (n,) array_like
            Command of each tick.

        Returns
        -------
        u_applied : (n,) float64
            Command, clipped and rounded.
        y : (n,) float64
            Gyro [deg/s], sampled at the instant from which the command of the same tick is applied.
        angle_deg : (n,) float64
            True angle [deg] at that instant.

        Raises
        ------
        GsidError
            A command is not finite; the axis did not advance.
        """
        u = np.ascontiguousarray(u, dtype=np.float64)
        out = np.empty((3, len(u)))
        pointers = [ffi.from_buffer("double[]", row) for row in (u, *out)]
        check(lib.gsid_axis_step(self._axis, len(u), *pointers), "advancing the axis")
        return out[0], out[1], out[2]

    def truth(self) -> dict:
        """Parameters of the axis, and the transfer function of its linear part from command to gyro.

        Returns
        -------
        dict
            parameters: {name: value}; num, den: coefficients of s, highest power first, den[0] = 1 (rigid
            body, flexible mode and gyro lag); delay_s.
        """
        p = self.parameters
        w0 = 2 * np.pi * p["mode_f_hz"]
        body = np.array([1.0, p["viscous_rate"], p["spring_stiffness"]])
        num, den = np.array([p["gain"], 0.0]), body
        if w0 > 0:
            mode = np.array([1.0, 2 * p["mode_zeta"] * w0, w0**2])
            num = np.polyadd(np.polymul(num, mode), p["mode_residue"] * np.polymul(num, body))
            den = np.polymul(body, mode)
        if p["gyro_lag_s"] > 0:
            num, den = num / p["gyro_lag_s"], np.polymul(den, [1.0, 1 / p["gyro_lag_s"]])
        return {
            "parameters": dict(p),
            "num": num.tolist(),
            "den": den.tolist(),
            "delay_s": p["delay_s"],
        }
