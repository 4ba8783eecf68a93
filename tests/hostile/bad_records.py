"""Records and excitations with one fault each: keys, samples, types, text and damaged containers."""

import io
import itertools
import json
import sys
import warnings
import zipfile
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

sys.path.append(str(Path(__file__).parents[1] / "python"))
from entries import EXCITATION_VERBS, RECORD_VERBS, Entry, read_by
from foreign_files import flipped, npy_claiming, write_ulog, write_v73
from sound_files import (
    ESCAPE,
    FS_HZ,
    KEYS,
    N_PERIOD,
    SEED,
    T,
    U,
    Y,
    csv,
    small_plant,
)

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
    yield from wrong_npz(good)
    yield from wrong_h5()


def wrong_npz(good):
    """Archives of numpy that say more than they hold."""
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
