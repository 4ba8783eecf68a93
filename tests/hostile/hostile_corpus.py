"""Bad input of every kind, made by a seed: records, models, tables and excitations.

Each entry has the commands that read it. What is at fault is always a file, never how the command was typed:
every run must end with exit status 3, or with 0 where the file can be read in spite of its fault.
"""

import io
import itertools
import json
import sys
import warnings
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

sys.path.append(str(Path(__file__).parents[1] / "python"))
from foreign_files import flipped, npy_claiming, write_ulog, write_v73

SEED = 1500
N_PERIOD, N_PERIODS, FS_HZ = 60, 6, 1000.0
ESCAPE = "\x1b[31mred\x1b]0;title\x07"


@dataclass
class Entry:
    """One bad input: its files by name, what is wrong, and the commands that read it."""

    kind: str  # class of fault
    name: str
    files: dict[str, bytes]
    commands: list[list[str]] = field(default_factory=list)


# ---------------------------------------------------------------- sound files


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


# ---------------------------------------------------------------- commands

# For each kind of file those that are quick, then those that take seconds.

RECORD_VERBS = (
    [
        ["frf", "@", "--json"],
        ["noise", "@", "--json"],
        ["distortion", "@"],
        ["fit", "@", "--order", "1/0", "-o", "m.json"],
        ["compare", "--model", "rational.json", "@", "--json"],
        ["frf", "@", "--lpm"],
        ["run", "--port", "none", "--u", "@", "-o", "x.csv"],
        ["distortion", "sound.csv", "--other-level", "@"],
        ["compare", "--model", "plant.json", "@"],
        ["frf", "@", "--window", "30", "-o", "f.mat"],
    ],
    [
        ["fit", "sound.csv", "@", "--order", "auto", "--json"],
        ["report", "@", "-o", "r.html"],
        ["fit", "@", "--model", "plant.json", "--json"],
        ["add", "coulomb_friction", "--model", "plant.json", "sound.csv", "--held-out", "@", "-o", "m.json"],
        ["diagnose", "--model", "plant.json", "@", "-o", "m.json"],
    ],
)
EXCITATION_VERBS = ([["run", "--port", "none", "--u", "@", "-o", "x.csv"], ["frf", "@", "--y", "u"]], [])
DESIGN = (
    "design multisine --fs 1000 --period 60 --band 10:300 --limit-travel-deg 2 --limit-command 500 -o u.csv"
)
PLANT_VERBS = (
    [
        ["compare", "--model", "@", "sound.csv", "--json"],
        ["export-c", "@", "-o", "axis.c"],
        ["add", "--undo", "--model", "@", "-o", "m.json"],
        ["fit", "sound.csv", "--model", "@", "-o", "m.json"],
    ],
    [
        [*DESIGN.split(), "--model", "@"],
        ["add", "coulomb_friction", "--model", "@", "sound.csv", "-o", "m.json"],
        ["report", "sound.csv", "--model", "@", "-o", "r.html"],
        ["diagnose", "--model", "@", "sound.csv", "--json"],
    ],
)
RATIONAL_VERBS = (
    [
        ["compare", "--model", "@", "sound.csv", "--json"],
        ["export-c", "@", "-o", "axis.c", "--json"],
        ["diagnose", "--model", "@", "sound.csv"],
    ],
    [
        ["compare", "--model", "@", "sound.csv", "--plot", "c.svg"],
        ["report", "sound.csv", "--model", "@", "-o", "r.html"],
        [*DESIGN.split(), "--model", "@"],
    ],
)
MATRIX_VERBS = (
    [
        ["compare", "--model", "@", "sound.csv"],
        ["compare", "--model", "@", "--u", "u1", "--y", "y1,y2", "two.csv"],
        ["export-c", "@", "-o", "axis.c"],
    ],
    [],
)
BESIDE_VERBS = ([["frf", "@"], ["compare", "--model", "rational.json", "@"]], [])
TABLE_VERBS = ([["add", "--table", "@", "--model", "plant.json", "sound.csv", "-o", "m.json"]], [])


def read_by(verbs, file, *more, turn=0):
    """The commands with a file's name in the place of @; each turn begins with another of the quick ones."""
    ordered = [part[(turn + i) % len(part)] for part in verbs for i in range(len(part))]
    return [[file if word == "@" else word for word in command] + list(more) for command in ordered]


# ---------------------------------------------------------------- records

BAD_NUMBERS = [
    "0",
    "-1",
    "0.5",
    "nan",
    "inf",
    "-inf",
    "1e30",
    "1e400",
    "1e-320",
    "",
    "fast",
    "1" + "0" * 400,
    "9" * 20,
]
BAD_TEXTS = ["", ESCAPE, "deg/s\u202e", "x" * 100_000, "\x00", "# fs_hz: 7", "[]", "\u0130" * 50]


def filled(value, at=None):
    """y with one value in the place of others."""
    y = Y.copy()
    y[slice(None) if at is None else at] = value
    return y


def wrong_arrays() -> Iterator[tuple[str, dict]]:
    """Arrays that no record has, by what is wrong: for every format."""
    n = len(U)
    good = {"u": U, "y": Y, "fs_hz": FS_HZ}
    for value in (0.0, 1.0, 1e30, -1e300, 1e308, 1e-320, 5e-324):
        yield f"y constant {value:g}", {**good, "y": np.full(n, value)}
        yield f"u constant {value:g}", {**good, "u": np.full(n, value)}
    for value in (1e30, 1e150, 1e300, -1.7e308, 1e-320, np.nan, np.inf):
        yield f"y has {value:g}", {**good, "y": filled(value, 100)}
        yield f"u has {value:g}", {**good, "u": np.where(np.arange(n) == 100, value, U)}
    for scale in (1e300, 1e160, 1e-160, 1e-300, 1e-320):
        yield f"y times {scale:g}", {**good, "y": Y * scale}
        yield f"u times {scale:g}", {**good, "u": U * scale}
        yield f"both times {scale:g}", {**good, "u": U * scale, "y": Y * scale}
    for name, t in wrong_times():
        yield name, {"t_s": t, "u": U, "y": Y}
    for length in (0, 1, 2, 3, 5, 59, 60, 119, 120):
        yield f"{length} samples", {name: x[:length] for name, x in (("u", U), ("y", Y))} | {"fs_hz": FS_HZ}
    for name, valid in (
        ("none", 0.0),
        ("text", 2.0),
        ("one in each period", (np.arange(n) % 60 > 0) * 1.0),
        ("nan", np.nan),
    ):
        yield f"valid {name}", {**good, "valid": np.ones(n) * valid}
    yield "noise for u", {**good, "u": np.random.default_rng(SEED).standard_normal(n)}
    yield "u is a ramp", {**good, "u": np.arange(n) * 1.0}
    yield "u is one pulse", {**good, "u": (np.arange(n) == 7) * 1.0}
    yield "u alternates", {**good, "u": np.arange(n) % 2 * 1.0}
    yield "y is u", {**good, "y": U}
    yield "y grows", {**good, "y": np.exp(np.arange(n) * 1.9)}
    for value in (0.0, -1.0, np.nan, np.inf, 1e30, 1e300, 1e-320, 1e-30):
        yield f"fs_hz {value:g}", {**good, "fs_hz": value}
    for value in (0.0, -60.0, 1.0, 3.0, 7.0, 60.5, 1e30, np.inf, np.nan, 2.0**63):
        yield f"period_samples {value:g}", {**good, "period_samples": value}
        yield f"settle_samples {value:g}", {**good, "settle_samples": value}


def wrong_times():
    n = len(U)
    yield "times zero", np.zeros(n)
    yield "times denormal", np.arange(n) * 5e-324
    yield "times tiny", np.arange(n) * 1e-310
    yield "times huge", np.arange(n) * 1e305
    yield "times far away", T + 1e300
    yield "times nan", np.full(n, np.nan)
    yield "times infinite", np.where(np.arange(n) > 9, np.inf, T)
    yield "times fall", T[::-1].copy()
    yield "times rest", np.where(np.arange(n) < 200, T, T[200])
    yield "times of one huge step", np.where(np.arange(n) < 359, T, 1e308)
    yield "times alternate", np.arange(n) % 2 * 1.0


def wrong_kinds():
    """Arrays of other types and shapes: not for CSV."""
    n = len(U)
    good = {"u": U, "y": Y, "fs_hz": FS_HZ}
    for name in ("u", "y", "t_s", "valid", "fs_hz", "period_samples", "settle_samples", "u_unit", "hold"):
        yield f"{name} of texts", {**good, name: np.array(["word"] * n)}
        yield f"{name} of digits", {**good, name: np.array(["1.0"] * n)}
        yield f"{name} of bytes", {**good, name: np.array([b"1"] * n)}
        yield f"{name} complex", {**good, name: U * 1j}
        yield f"{name} a matrix", {**good, name: U.reshape(60, 6)}
        yield f"{name} without an axis", {**good, name: np.array(1.5)}
        yield f"{name} empty", {**good, name: np.empty(0)}
        yield f"{name} a bool", {**good, name: np.array(True)}
    for name in ("hold", "u_unit", "y_unit", "meta"):
        for i, text in enumerate(BAD_TEXTS[1:]):
            if "\0" not in text:
                yield f"{name} text {i}", {**good, name: np.array(text)}
    yield "u of small ints", {**good, "u": (U * 10).astype(np.int8)}
    yield "u of halves", {**good, "u": U.astype(np.float16)}
    yield "y of unsigned", {**good, "y": (Y * 10).astype(np.int64).astype(np.uint64)}


def as_npz(arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def as_mat(arrays):
    file = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        savemat(file, arrays)
    return b"MATLAB 5.0 MAT-file".ljust(116) + file.getvalue()[116:]  # scipy writes the time there


def as_h5(arrays):
    file = io.BytesIO()
    with h5py.File(file, "w") as h5:
        for name, value in arrays.items():
            array = np.asarray(value)
            h5[name] = array.astype(h5py.string_dtype()) if array.dtype.kind == "U" else array
    return file.getvalue()


def record_entries(rng):
    def entry(kind, name, file, content, *more):
        number = next(numbers)
        file = f"{number}{file}"
        commands = read_by(RECORD_VERBS, file, *more, turn=number)
        if more:  # `gsid run` reads files of its own only
            commands = [command for command in commands if command[0] != "run"]
        return Entry(kind, name, {file: content}, commands)

    numbers = itertools.count()
    for key, value in itertools.product(("fs_hz", "period_samples", "settle_samples"), BAD_NUMBERS):
        yield entry(
            "key",
            f"csv {key}: {value[:20]}",
            "r.csv",
            csv(keys=KEYS | {key: value}, columns={"u": U, "y": Y}),
        )
    for key, (i, text) in itertools.product(("hold", "u_unit", "y_unit", "note"), enumerate(BAD_TEXTS)):
        yield entry("text", f"csv {key} text {i}", "r.csv", csv(keys=KEYS | {key: text}))
    formats = {".npz": as_npz, ".mat": as_mat, ".h5": as_h5}
    for i, (name, arrays) in enumerate(wrong_arrays()):
        arrays_only = {k: v for k, v in arrays.items() if np.ndim(v)}
        keys = {k: repr(float(v)) for k, v in arrays.items() if not np.ndim(v)}
        yield entry("samples", f"csv {name}", "r.csv", csv(keys, arrays_only))
        suffix = list(formats)[i % 3]
        yield entry("samples", f"{suffix} {name}", "r" + suffix, formats[suffix](arrays))
    for i, (name, arrays) in enumerate(wrong_kinds()):
        for suffix in list(formats)[i % 3 :: 2]:
            try:
                content = formats[suffix](arrays)
            except (TypeError, ValueError):
                continue  # the format has no such array
            yield entry("type", f"{suffix} {name}", "r" + suffix, content)
    for name, content in wrong_text():
        yield entry("csv", name, "r.csv", content)
    for name, file, content, *more in wrong_containers(rng):
        yield entry("container", name, file, content, *more)


def wrong_text():
    """CSV files that are none."""
    good = csv().decode()
    head, _, rows = good.partition("t_s,u,y\n")
    yield "ESC in a name", csv(columns={"t_s": T, "u": U, "y": Y, ESCAPE: U})
    yield "ESC for a name", csv(columns={"t_s": T, ESCAPE: U, "y": Y})
    yield "ESC in a cell", good.replace("\n0.01,", f"\n0.01{ESCAPE},").encode()
    yield "ESC in a key", f"# {ESCAPE}: {ESCAPE}\n{good}".encode()
    yield "ESC in a column of text", (head + f"t_s,u,y,{ESCAPE}\n" + rows.replace("\n", ",word\n")).encode()
    yield "NUL bytes", good.encode()[:2000] + bytes(200) + good.encode()[2000:]
    yield "all NUL", bytes(5000)
    yield "UTF-16", good.encode("utf-16")
    yield "latin 1", good.replace("deg/s", "\xb0/s").encode("latin-1")
    yield "surrogates", b"# u_unit: \xed\xa0\x80\n" + good.encode()
    yield "carriage returns alone", good.replace("\n", "\r").encode()
    yield "form feeds", good.replace("\n", "\x0c").encode()
    yield "line separators", good.replace("\n", "\u2028").encode()
    yield "semicolons", good.replace(",", ";").encode()
    yield "tabs", good.replace(",", "\t").encode()
    yield "quotes", b'"t_s,u,y\n' + rows.encode()
    yield "no rows", head.encode() + b"t_s,u,y\n"
    yield "commas", b",,,\n,,,\n"
    yield "names alone twice", b"t_s,u,u\n1,2,3\n"
    yield "empty names", (head + ",,\n" + rows).encode()
    yield "one name", b"u\n1\n2\n3\n"
    yield "names that are numbers", b"1,2,3\n" + rows.encode()
    yield (
        "5000 columns",
        (",".join(["u", "y", *map(str, range(5000))]) + "\n" + ",".join(["1"] * 5002) + "\n").encode(),
    )
    yield "a long line", b"t_s,u,y\n" + b"1" * 2_000_000
    yield "a long name", b"t_s,u," + b"y" * 1_000_000 + b"\n1,2,3\n"
    yield "a long comment", b"#" * 2_000_000 + b"\n" + good.encode()
    yield "100000 keys", b"".join(b"# k%d: v\n" % i for i in range(100_000)) + good.encode()
    yield "ragged", (head + "t_s,u,y\n" + rows.replace("\n0.01,", "\n0.01,,")).encode()
    yield "hexadecimal", good.replace("\n0.01,", "\n0x1p-3,").encode()
    yield "underscores", good.replace("\n0.01,", "\n0_0.01,").encode()
    yield "other digits", good.replace("\n0.01,", "\n\u0660.\u0661,").encode()
    yield "decimal commas", good.replace(".", ",").encode()
    yield "overflow", good.replace("\n0.01,", "\n0.01e9999,").encode()
    yield "a cut row", good.encode()[:-9]
    yield "JSON", json.dumps(small_plant()).encode()
    yield "blank lines alone", b"\n" * 1000
    yield "comments alone", b"# a\n" * 1000
    yield "one byte", b"u"
    yield "infinite words", (head + "t_s,u,y\n0,infinity,1\n0.001,1,NaN\n").encode()
    for text in ("1e30", "1e308", "-1e308", "1e-320"):
        yield (
            f"a column of {text}",
            (head + "t_s,u,y,theta_deg\n" + rows.replace("\n", f",{text}\n")).encode(),
        )


def wrong_containers(rng):
    """Binary files that are damaged, or that say more than they hold."""
    good = {"u": U, "y": Y, "fs_hz": FS_HZ, "period_samples": N_PERIOD}
    names = {".ulg": ("--u", "torque.cmd", "--y", "torque.rate")}
    for suffix, content in (
        (".npz", as_npz(good)),
        (".mat", as_mat(good)),
        (".h5", as_h5(good)),
        (".ulg", made(write_ulog, "x.ulg")),
        ("v73.mat", made(write_v73, "x.mat")),
    ):
        more = names.get(suffix, ())
        for i in range(10):
            yield f"{suffix} flipped {i}", suffix, flipped(content, rng), *more
        for share in (0.02, 0.3, 0.9, 0.999):
            yield f"{suffix} cut at {share}", suffix, content[: int(share * len(content))], *more
        yield f"{suffix} of zeros", suffix, bytes(4096), *more
        yield f"{suffix} of text", suffix, csv(), *more
        yield f"{suffix} of noise", suffix, rng.bytes(4096), *more
        yield f"{suffix} with a tail", suffix, content + rng.bytes(1000), *more
        yield f"{suffix} with a head", suffix, rng.bytes(600) + content, *more
    yield "ulg of other names", ".ulg", made(write_ulog, "x.ulg"), "--u", f"{ESCAPE}.a", "--y", f"{ESCAPE}.b"
    yield "npz of objects", ".npz", as_npz(good | {"y": np.array([{1: 2}] * len(U), dtype=object)})
    yield "npz of records", ".npz", as_npz(good | {"y": np.zeros(len(U), [("a", float), ("b", int)])})
    yield "npz of dates", ".npz", as_npz(good | {"y": np.zeros(len(U), "datetime64[s]")})
    yield "npz with meta that is none", ".npz", as_npz(good | {"meta": '{"a": [1, {"b": null}]}'})
    yield "npz with deep meta", ".npz", as_npz(good | {"meta": "[" * 100_000})
    yield "npz with a list for meta", ".npz", as_npz(good | {"meta": "[1, 2]"})
    yield "npz ESC in a name", ".npz", as_npz(good | {ESCAPE: U})
    for shape in (
        "(10000000000,)",
        "(-1,)",
        "(360, 10000000)",
        "()",
        "(1,)*360",
        "(360.0,)",
        "'x'",
        "(" * 500,
    ):
        yield (
            f"npz of shape {shape[:20]}",
            ".npz",
            zipped({"u": npy_claiming(shape, body=U.tobytes()), "y": npy_claiming((360,), body=Y.tobytes())}),
        )
    for descr in ("|O", "<f3", "<U999999999", "<c64", "m8", "<V8"):
        yield f"npz of type {descr}", ".npz", zipped({"u": npy_claiming((360,), descr, U.tobytes())})
    yield "npz without names", ".npz", zipped({})
    yield (
        "npz of 3000 arrays",
        ".npz",
        zipped({f"a{i}": npy_claiming((1,), body=bytes(8)) for i in range(3000)}),
    )
    yield (
        "npz that expands",
        ".npz",
        zipped(
            {
                "u": npy_claiming((10**7,), body=bytes(8 * 10**7)),
                "y": npy_claiming((10**7,), body=bytes(8 * 10**7)),
            }
        ),
    )
    yield from wrong_h5()


def wrong_h5():
    def h5(fill):
        file = io.BytesIO()
        with h5py.File(file, "w") as made_file:
            made_file["u"], made_file.attrs["fs_hz"] = U, FS_HZ
            fill(made_file)
        return file.getvalue()

    size = 8 * len(U)
    yield (
        "h5 external storage",
        ".h5",
        h5(lambda f: f.create_dataset("y", U.shape, "f8", external=[("/etc/passwd", 0, size)])),
    )
    yield "h5 external link", ".h5", h5(lambda f: f.__setitem__("y", h5py.ExternalLink("sound.h5", "/y")))
    yield "h5 soft link to nothing", ".h5", h5(lambda f: f.__setitem__("y", h5py.SoftLink("/none")))
    yield "h5 link to itself", ".h5", h5(lambda f: f.__setitem__("y", h5py.SoftLink("/y")))
    yield "h5 huge", ".h5", h5(lambda f: f.create_dataset("y", (525_000_000,), "f8", chunks=(1000,)))
    yield (
        "h5 huge beside",
        ".h5",
        h5(lambda f: (f.create_dataset("z", (525_000_000,), "f8", chunks=(1000,)), f.__setitem__("y", Y))),
    )
    yield "h5 endless", ".h5", h5(lambda f: f.create_dataset("y", (2**60,), "f8", chunks=(1000,)))
    yield "h5 without values", ".h5", h5(lambda f: f.create_dataset("y", dtype="f8", shape=None))
    yield "h5 a group", ".h5", h5(lambda f: f.create_group("y"))
    yield "h5 texts", ".h5", h5(lambda f: f.__setitem__("y", ["1"] * len(U)))
    yield "h5 references", ".h5", h5(lambda f: f.create_dataset("y", U.shape, h5py.ref_dtype))
    yield "h5 lists", ".h5", h5(lambda f: f.create_dataset("y", U.shape, h5py.vlen_dtype(float)))
    yield "h5 ESC in a name", ".h5", h5(lambda f: f.__setitem__(ESCAPE.replace("/", ""), Y))


def made(write, name):
    """Bytes of a file that is written by its path."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / name)
        return (Path(folder) / name).read_bytes()


def zipped(members):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            member = zipfile.ZipInfo(f"{name}.npy")  # without the time
            archive.writestr(member, content, zipfile.ZIP_DEFLATED)
    return file.getvalue()


def excitation_entries():
    """Files for `gsid run --u`."""
    period = U[:N_PERIOD]
    for i, (name, arrays) in enumerate(wrong_arrays()):
        if i % 4 == 0 and len(np.ravel(arrays["u"])) > 0:
            arrays = {k: v[:N_PERIOD] if np.ndim(v) else v for k, v in arrays.items() if k != "y"}
            columns = {k: v for k, v in arrays.items() if np.ndim(v)}
            keys = {k: repr(float(v)) for k, v in arrays.items() if not np.ndim(v)}
            yield Entry("excitation", name, {"e.csv": csv(keys, columns)}, read_by(EXCITATION_VERBS, "e.csv"))
    for key, value in itertools.product(("fs_hz", "period_samples"), BAD_NUMBERS):
        content = csv(keys={key: value}, columns={"u": period})
        yield Entry(
            "excitation", f"{key}: {value[:20]}", {"e.csv": content}, read_by(EXCITATION_VERBS, "e.csv")
        )


# ---------------------------------------------------------------- meta.json beside a record


def beside_entries():
    good = {
        "fs_hz": FS_HZ,
        "period_samples": 60,
        "channels": [{"name": "u", "unit": "A"}],
        "files": {"r.csv": {}},
    }
    texts = [replaced(good, path, raw) for path in paths(good) for raw in BAD_JSON]
    texts += [
        "[" * 100_000,
        '{"files": ' * 5000,
        "null",
        '"r.csv"',
        "[]",
        '{"files": "r.csv"}',
        '{"files": ["r.csv"]}',
    ]
    for i, text in enumerate(texts):
        if i % 4 and i < len(texts) - 7:
            continue
        files = {
            f"beside{i}/meta.json": text.encode(),
            f"beside{i}/r.csv": csv(keys={}, columns={"u": U, "y": Y}),
        }
        verbs = read_by(BESIDE_VERBS, f"beside{i}/r.csv", turn=i)
        yield Entry("meta.json", text[:60], files, verbs)


# ---------------------------------------------------------------- JSON

BAD_JSON = [
    "null",
    "true",
    "-1",
    "0",
    "1e400",
    "-1e400",
    "NaN",
    "1e30",
    "1e308",
    "1e-320",
    "1" + "0" * 400,
    '""',
    '"NaN"',
    json.dumps(ESCAPE + "\nfs_hz: 7"),
    '"\\ud800"',
    "[]",
    "{}",
    "[[]]",
    "[null]",
    "[1, [2, 3]]",
    '[1, "x"]',
    '{"value": null}',
    "[" * 50 + "]" * 50,
    json.dumps("x" * 100_000),
    "[" + "1," * 50_000 + "1]",
]
PLACE = "@@here@@"


def paths(data, prefix=()):
    """Keys and indices of every value of a document; of a list its first and last element."""
    if isinstance(data, dict):
        items = list(data.items())
    elif isinstance(data, list):
        items = [(i, data[i]) for i in sorted({0, len(data) - 1})] if data else []
    else:
        items = []
    for key, value in items:
        yield (*prefix, key)
        yield from paths(value, (*prefix, key))


def replaced(data, path, raw):
    """The document's text with another value at a place: `raw` is text, since JSON of Python has no 1e400."""
    document = json.loads(json.dumps(data))
    node = document
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = PLACE
    return json.dumps(document).replace(json.dumps(PLACE), raw)


def without(data, path):
    document = json.loads(json.dumps(data))
    node = document
    for key in path[:-1]:
        node = node[key]
    del node[path[-1]]
    return json.dumps(document)


def renamed(data, path, name):
    document = json.loads(json.dumps(data))
    node = document
    for key in path[:-1]:
        node = node[key]
    node[name] = node.pop(path[-1])
    return json.dumps(document)


def model_entries(rng):
    documents = {
        "plant": (plant(), PLANT_VERBS, 5),
        "catalogue": (catalogue_plant(), PLANT_VERBS, 3),
        "rational": (rational(), RATIONAL_VERBS, 5),
        "rational z": (rational("z"), RATIONAL_VERBS, 2),
        "matrix": (matrix(), MATRIX_VERBS, 3),
        "pieces": (pieces(), RATIONAL_VERBS, 1),
    }
    for kind, (data, verbs, most) in documents.items():
        turn = itertools.count()

        def entry(name, text, kind=kind, verbs=verbs, turn=turn):
            i = next(turn)
            content = text if isinstance(text, bytes) else text.encode()
            return Entry(
                kind,
                name,
                {f"{kind[0]}{kind[-1]}{i}.json": content},
                read_by(verbs, f"{kind[0]}{kind[-1]}{i}.json", turn=i),
            )

        for path in paths(data):
            chosen = [BAD_JSON[i] for i in rng.permutation(len(BAD_JSON))[:most]]
            for raw in chosen:
                yield entry(f"{path} = {raw[:40]}", replaced(data, path, raw))
            if isinstance(path[-1], str) and rng.random() < 0.5:
                yield entry(f"without {path}", without(data, path))
                yield entry(f"{path} by another name", renamed(data, path, ESCAPE))
        text = json.dumps(data)
        yield entry("keys in reverse", json.dumps(dict(reversed(data.items()))))
        yield entry("cut", text[: len(text) // 2])
        yield entry("twice", text + text)
        yield entry("byte order mark", "\ufeff" + text)
        yield entry("UTF-16", text.encode("utf-16"))
        yield entry("NUL", text.replace(" ", "\0").encode())
    for text in (
        "",
        "null",
        "[]",
        "7",
        "[" * 100_000,
        '{"a":' * 100_000,
        '"x"',
        "{}",
        '{"gsid_model": 1}',
        "9" * 5000,
    ):
        yield Entry("model", text[:30], {"m.json": text.encode()}, read_by(PLANT_VERBS, "m.json"))
    yield from large_models()
    yield from law_entries()


def large_models():
    """Sound but for their size."""

    def entry(name, data, verbs=PLANT_VERBS):
        return Entry("size", name, {"large.json": json.dumps(data).encode()}, read_by(verbs, "large.json"))

    for n in (100, 3000, 70_000):
        data = small_plant()
        data["effects"] += [{"effect": "viscous_friction", "params": {"rate": 0.1}}] * n
        yield entry(f"{n} effects", data)
    data = small_plant()
    data["history"] = [{"step": "x"}] * 200_000
    yield entry("200000 steps", data)
    data = small_plant()
    data["effects"][0]["params"] |= {f"p{i}": 1.0 for i in range(100_000)}
    yield entry("100000 parameters", data)
    data = rational()
    data["rational"]["num"] = [1.0] * 100_000
    yield entry("order 100000", data, RATIONAL_VERBS)
    data = matrix()
    data["common_denominator"]["sections"] = [1.0] * 5000
    data["common_denominator"]["num"] = [[[1.0] * 5000], [[1.0] * 5000]]
    data["common_denominator"]["covariance"] = None
    yield entry("5000 poles", data, MATRIX_VERBS)
    data = pieces()
    data["pieces"] = data["pieces"] * 3000
    data["breaks_hz"] = list(range(5999))
    yield entry("6000 pieces", data, RATIONAL_VERBS)


def law_entries():
    """Values that the catalogue allows, or that look so, and torque laws."""

    def entry(name, effects, **more):
        data = small_plant() | more
        data["effects"] = data["effects"] + effects
        return Entry("law", name, {"law.json": json.dumps(data).encode()}, read_by(PLANT_VERBS, "law.json"))

    laws = [
        "",
        "c*",
        "c*tanh(w/0)",
        "w^w^w^w",
        "exp(exp(w))",
        "1/0",
        "0/0*w",
        "log(-1)*c",
        "__import__('os')",
        "c.real",
        "w" * 600,
    ]
    laws += [
        "(" * 240 + "w" + ")" * 240,
        "-" * 400 + "w",
        "w+" * 249 + "w",
        "c*1e400",
        "c*" + "9" * 400,
        ESCAPE,
        "lambda: w",
        "c if w else 1",
    ]
    laws += [
        "sign(w)",
        "t",
        "c*w^99",
        "1e308*w*1e308",
        "sqrt(w)",
        "w^0.5",
        "abs(w)^-1",
        "c*1j",
        "c*True",
        "'c'",
        "f'{c}'",
        "w\0",
        "c*w # x",
    ]
    for text in laws:
        yield entry(text[:40], [{"effect": "expression", "torque": text, "params": {"c": 1.0}}])
    for effect, params in (
        ("hard_stop", {"angle_deg": 1e-9, "stiffness": 1e9}),
        ("coulomb_friction", {"level": 1e9}),
        ("cubic_spring", {"stiffness": 1e9}),
        ("transport_delay", {"delay_s": 1e3}),
        ("transport_delay", {"delay_s": 1e-300}),
        ("flexible_mode", {"f_hz": 1e9, "zeta": 1e-9, "residue": 1e9}),
        ("flexible_mode", {"f_hz": 1e-9, "zeta": 0.0, "residue": 1.0}),
        ("sensor_sample_hold", {"rate_hz": 1e-9}),
        ("sensor_sample_hold", {"rate_hz": 1e9}),
        ("motor_lag", {"time_constant_s": 1e-300}),
        ("motor_lag", {"time_constant_s": 1e9}),
        ("motor_cogging", {"level": 1e6, "cycles_per_rev": 1e6, "phase_rad": 1e6}),
        ("periodic_disturbance", {"f_hz": 1e9, "amplitude": 1e9, "phase": 1e9}),
        ("drive_quantization", {"step": 1e-300}),
        ("drive_quantization", {"step": 1e9}),
        ("gear_backlash", {"gap_deg": 1e9, "stiffness": 1e9, "inertia_ratio": 1e9}),
        ("position_velocity_loop", {"kp": 1e9, "kv": 1e9, "limit": 1e-9}),
    ):
        yield entry(f"{effect} {params}", [{"effect": effect, "params": params}])
    for fs_hz in (1e-300, 1e-3, 1e9, 1e300):
        yield entry(f"fs_hz {fs_hz:g}", [], fs_hz=fs_hz)


# ---------------------------------------------------------------- tables


def table_entries():
    good = sound_files()["curve.csv"].decode()
    texts = {
        "empty": "",
        "names alone": "w,torque\n",
        "one point": "w,torque\n0,0\n",
        "no torque": "w,force\n0,0\n1,1\n",
        "unknown variable": "velocity,torque\n0,0\n1,1\n2,2\n3,3\n",
        "ESC variable": f"{ESCAPE},torque\n0,0\n1,1\n2,2\n",
        "ESC cell": good.replace("1.5", ESCAPE),
        "ESC unit": f"# unit: {ESCAPE}\n{good}",
        "cut row": good[:-3],
        "two at one place": good + "2,3\n",
        "ragged": good + "3\n",
        "semicolons": good.replace(",", ";"),
        "huge": "w,torque\n" + "".join(f"{i},{i}\n" for i in range(200_000)),
        "near": "w,torque\n0,0\n5e-324,1\n1e-323,2\n1.5e-323,3\n",
        "far": "w,torque\n-1e308,0\n-1e307,1\n1e307,2\n1e308,3\n",
        "steep": "w,torque\n0,-1e308\n1,1e308\n2,-1e308\n3,1e308\n",
        "NUL": good.replace("1", "\0"),
        "only comments": "# a: b\n" * 100,
        "JSON": "{}",
    }
    for value in ("nan", "inf", "-inf", "1e400", "1e308", "1e30", "1e-320", "", "x", "1_0", "9" * 400):
        texts[f"torque {value[:9]}"] = good.replace("1.5\n2", f"{value}\n2")
        texts[f"place {value[:9]}"] = good.replace("\n1,", f"\n{value},")
    for name, text in texts.items():
        yield Entry("table", name, {"t.csv": text.encode()}, read_by(TABLE_VERBS, "t.csv"))
    yield Entry("table", "UTF-16", {"t.csv": good.encode("utf-16")}, read_by(TABLE_VERBS, "t.csv"))
    yield Entry("table", "bytes", {"t.csv": bytes(range(256)) * 10}, read_by(TABLE_VERBS, "t.csv"))
    yield Entry("library", "text", {"bad.so": b"no library"}, [["--library", "./bad.so:x", "effects"]])


MOST = {
    "samples": 90,
    "catalogue": 50,
    "container": 90,
    "type": 60,
    "plant": 90,
    "rational": 50,
    "matrix": 50,
}
MOST |= {"rational z": 20, "pieces": 20, "meta.json": 40, "excitation": 30}
"""Entries of each class in the short form; all of the others."""


def corpus(*, short=False):
    """Every entry, in an order and with contents that depend on the seed alone."""
    rng = np.random.default_rng(SEED)
    entries = [
        *record_entries(rng),
        *excitation_entries(),
        *beside_entries(),
        *model_entries(rng),
        *table_entries(),
    ]
    for entry in entries:
        if any("two.csv" in command for command in entry.commands):
            entry.files["two.csv"] = csv(columns={"t_s": T, "u1": U, "y1": Y, "y2": 2 * Y})
    return shortened(entries) if short else entries


def shortened(entries):
    """Some of each class, evenly over it."""
    of_kind = {}
    for entry in entries:
        of_kind.setdefault(entry.kind, []).append(entry)
    chosen = []
    for kind, listed in of_kind.items():
        n = min(len(listed), MOST.get(kind, len(listed)))
        chosen += [listed[int(i * len(listed) / n)] for i in range(n)]
    return chosen
