"""Records through every format, and every way a file can be wrong."""

import json
import struct

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from gsid.base.errors import InputError
from gsid.base.files import write_atomically
from gsid.records.files import columns_of, read_record, write_record
from gsid.records.periods import split_periods
from gsid.records.record import Record

FORMATS = [".csv", ".npz", ".mat", ".h5"]


@pytest.fixture
def record():
    rng = np.random.default_rng(20)
    valid = np.ones(600, bool)
    valid[[150, 151]] = False
    return Record(
        u=np.tile(rng.standard_normal(100), 6),
        y=rng.standard_normal(600) * 10.0 ** rng.integers(-300, 300, 600),
        fs_hz=3000.0,
        period_samples=100,
        settle_samples=30,
        valid=valid,
        u_unit="count",
        y_unit="deg/s",
        hold="zoh",
        columns={"theta_deg": rng.standard_normal(600)},
        meta={"rig": "inner azimuth: no 2", "seed": "7"},
    )


# ---------------------------------------------------------------- round trips


@pytest.mark.parametrize("suffix", FORMATS)
def test_round_trip_is_exact(tmp_path, record, suffix):
    path = tmp_path / f"rec{suffix}"
    write_record(path, record)
    back = read_record(path)
    for name in ("u", "y", "valid"):
        np.testing.assert_array_equal(getattr(back, name), getattr(record, name))
    np.testing.assert_array_equal(back.columns["theta_deg"], record.columns["theta_deg"])
    for name in ("fs_hz", "period_samples", "settle_samples", "u_unit", "y_unit", "hold", "meta"):
        assert getattr(back, name) == getattr(record, name)
    assert back.name == path.name


@pytest.mark.parametrize("suffix", FORMATS)
def test_round_trip_of_a_bare_record(tmp_path, suffix):
    write_record(tmp_path / f"rec{suffix}", Record(np.arange(8.0), np.ones(8), 50.0))
    back = read_record(tmp_path / f"rec{suffix}")
    assert (back.period_samples, back.settle_samples, back.meta, back.columns) == (None, None, {}, {})
    assert back.valid.all()


def test_a_unit_in_a_name_is_taken(tmp_path):
    """A bug: a column `gyro [rad/s]` was fitted with a model in degrees, and nothing was said."""
    path = tmp_path / "rec.csv"
    rows = "cmd [V],gyro [rad/s]\n1,2\n3,4\n"
    path.write_text("# fs_hz: 10\n" + rows)
    record = read_record(path, u="cmd [V]", y="gyro [rad/s]")
    assert (record.u_unit, record.y_unit) == ("V", "rad/s")
    path.write_text("# fs_hz: 10\n# y_unit: deg/s\n" + rows)
    assert read_record(path, u="cmd [V]", y="gyro [rad/s]").y_unit == "deg/s"


@pytest.mark.parametrize("gap", ["nan,0", ",0", " , 0 "])
def test_a_lost_sample_needs_no_filler(tmp_path, gap):
    """A bug: a blank in a row with valid = 0 was refused, with the hint to write valid = 0."""
    path = tmp_path / "rec.csv"
    path.write_text(f"t_s,u,y,valid\n0.0,1,2,1\n0.1,3,{gap}\n0.2,4,5,1\n")
    back = read_record(path)
    np.testing.assert_array_equal(back.y[back.valid], [2, 5])
    np.testing.assert_array_equal(back.valid, [True, False, True])
    assert np.isfinite(back.y).all()
    path.write_text(path.read_text().replace("5,1", ",1"))
    with pytest.raises(InputError, match="line 4, column y"):
        read_record(path)


def test_nothing_half_written(tmp_path, record):
    path = tmp_path / "rec.csv"
    write_record(path, record)
    before = path.read_bytes()

    def fails_midway(part):
        part.write_text("t_s,u,y\n0,")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        write_atomically(path, fails_midway)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["rec.csv"]


def test_unknown_extension_is_not_written(tmp_path, record):
    with pytest.raises(InputError, match="cannot write"):
        write_record(tmp_path / "rec.txt", record)


# ---------------------------------------------------------------- CSV


def csv(tmp_path, text, **kwargs):
    path = tmp_path / "rec.csv"
    path.write_text(text)
    return read_record(path, **kwargs)


def test_csv_dialects(tmp_path):
    """Byte order mark, Windows line ends, quotes, blanks, blank lines, other columns of text."""
    text = '\ufeff# fs_hz: 10\r\n# note\r\n"u", y ,state\r\n1, 2,run\r\n\r\n3,4,stop\r\n'
    record = csv(tmp_path, text)
    assert record.u.tolist() == [1, 3]
    assert record.y.tolist() == [2, 4]
    assert record.columns == {}
    assert record.fs_hz == 10


@pytest.mark.parametrize(("fs_hz", "decimals"), [(3000, 4), (3000, 6), (2500, 9), (610.3515625, 9), (0.2, 1)])
def test_rate_from_rounded_times(tmp_path, fs_hz, decimals):
    """Times printed with few decimals are equally spaced within their last digit."""
    rows = "".join(f"{n / fs_hz:.{decimals}f},{n % 7},0\n" for n in range(6000))
    measured = csv(tmp_path, "t_s,u,y\n" + rows).fs_hz
    resolution = 2 * 10.0**-decimals * fs_hz / 6000  # of the last time over the span
    assert measured == pytest.approx(fs_hz, rel=0 if fs_hz == int(fs_hz) else resolution)


def test_rate_given_and_period_given(tmp_path):
    record = csv(tmp_path, "u,y\n" + "1,2\n3,4\n" * 8, fs_hz=5.0, period=4, settle=2)
    assert (record.fs_hz, record.period_samples, record.settle_samples) == (5.0, 4, 2)


def test_other_columns_may_have_holes(tmp_path):
    record = csv(tmp_path, "# fs_hz: 5\nu,y,temperature\n1,2,nan\n3,4,20\n")
    np.testing.assert_array_equal(record.columns["temperature"], [np.nan, 20])


ROWS = "".join(f"{n / 100:.2f},{n % 5},{n % 3}\n" for n in range(50))


def rows(**changed):
    """The rows above, with line `lineN` of the file replaced (line 1 is the header)."""
    lines = ("t_s,u,y\n" + ROWS).splitlines(keepends=True)
    for key, text in changed.items():
        lines[int(key.removeprefix("line")) - 1] = text
    return "".join(lines)


BAD_CSV = {
    "lost row": (rows(line20=""), "unequal time steps", "line 20"),
    "times go back": (rows(line20="0.01,1,1\n"), "unequal time steps", "line 20"),
    "nan": (rows(line9="0.07,nan,1\n"), "not finite", "line 9, column u"),
    "inf": (rows(line9="0.07,1,-inf\n"), "not finite", "line 9, column y"),
    "nan after blank lines": ("\n\n" + rows(line9="\n0.07,1,nan\n"), "not finite", "line 12, column y"),
    "word": (rows(line30="0.28,1,overflow\n"), "not a number", "line 30, column y"),
    "empty cell": (rows(line30="0.28,,1\n"), "empty value in column u, line 30", "rec.csv"),
    "decimal comma": (rows(line30="0,28,1,1\n"), "columns", "line 30"),
    "missing column": (rows(line1="t_s,u,Y_1\n"), "no column named y", ""),
    "cut last row": (rows(line51="0.49,4"), "columns", "line 51"),
    "no header": (ROWS, "no header", ""),
    "header only": ("t_s,u,y\n", "no samples", ""),
    "keys only": ("# fs_hz: 5\n", "no samples", ""),
    "word between semicolons": (
        rows(line30="0.28,1,overflow\n").replace(",", ";"),
        "not a number",
        "line 30, column y",
    ),
    "tabs and semicolons": (
        rows(line30="0.28,1,1\n").replace(",", ";").replace(";", "\t", 2),
        "columns",
        "line 2",
    ),
    "twice": (rows(line1="u,u,y\n"), "same name", ""),
    "fs not a number": ("# fs_hz: fast\n" + rows(), "fs_hz is not", ""),
    "fs does not match the times": ("# fs_hz: 200\n" + rows(), "not match the times", ""),
    "period not whole": ("# period_samples: 2.5\n" + rows(), "period_samples", ""),
    "no rate": ("u,y\n1,2\n3,4\n", "sample rate is unknown", ""),
    "negative rate": ("# fs_hz: -5\nu,y\n1,2\n3,4\n", "sample rate", ""),
    "unknown hold": ("# hold: foh\n" + rows(), "hold", ""),
    "empty": ("", "empty", ""),
}


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("point", [".", ","])
def test_columns_are_separated_by_semicolons_or_tabs(tmp_path, separator, point):
    """Bug: the export of a spreadsheet in German or French was refused."""
    text = rows().replace(",", separator).replace(".", point)
    (tmp_path / "plain.csv").write_text(rows())
    (tmp_path / "other.csv").write_text("# u_unit: V, peak\n" + text)
    plain, other = (read_record(tmp_path / name) for name in ("plain.csv", "other.csv"))
    assert np.array_equal(plain.u, other.u)
    assert np.array_equal(plain.y, other.y)
    assert (other.fs_hz, other.u_unit) == (plain.fs_hz, "V, peak")


@pytest.mark.parametrize("kind", BAD_CSV)
def test_bad_csv_is_refused_with_its_place(tmp_path, kind):
    text, what, where = BAD_CSV[kind]
    with pytest.raises(InputError, match=what) as caught:
        csv(tmp_path, text)
    assert where in caught.value.where
    assert caught.value.hint


@pytest.mark.parametrize(("fs_hz", "words"), [(200.0, "not match the times"), (0.0, "not a positive")])
def test_bad_rate_given(tmp_path, fs_hz, words):
    with pytest.raises(InputError, match=words):
        csv(tmp_path, rows(), fs_hz=fs_hz)


def test_did_you_mean(tmp_path):
    with pytest.raises(InputError) as caught:
        csv(tmp_path, rows(line1="t_s,u,omega_motor\n"), y="omega_moter")
    assert caught.value.hint.startswith("did you mean omega_motor?")
    assert "--y" in caught.value.hint


def test_binary_in_csv(tmp_path):
    (tmp_path / "rec.csv").write_bytes(b"\x89PNG\xff\xfe\x00\x01")
    with pytest.raises(InputError, match="not text"):
        read_record(tmp_path / "rec.csv")


# ---------------------------------------------------------------- arrays


def save(path, **arrays):
    if path.suffix == ".npz":
        np.savez(path, **arrays)
    elif path.suffix == ".mat":
        savemat(path, arrays)
    else:
        with h5py.File(path, "w") as file:
            for name, value in arrays.items():
                file[name] = value


ARRAYS = {"u": np.arange(20.0), "y": np.ones(20), "fs_hz": 5.0}
BAD_ARRAYS = {
    "missing": ({"u": np.ones(20), "fs_hz": 5.0}, "no array named y"),
    "unequal": ({**ARRAYS, "y": np.ones(19)}, "unequal lengths"),
    "matrix": ({**ARRAYS, "y": np.ones((10, 2))}, "not one row"),
    "complex": ({**ARRAYS, "y": np.ones(20) * 1j}, "real numbers"),
    "nan": ({**ARRAYS, "y": np.r_[np.ones(7), np.nan, np.ones(12)]}, "not finite.*sample 7"),
    "no rate": ({"u": np.ones(20), "y": np.ones(20)}, "sample rate is unknown"),
    "empty": ({**ARRAYS, "u": np.ones(0), "y": np.ones(0)}, "no samples"),
    "valid too short": ({**ARRAYS, "valid": np.ones(7, bool)}, "unequal lengths"),
    "times": ({"u": np.ones(20), "y": np.ones(20), "t_s": np.r_[0:10, 11:21] * 0.1}, "unequal.*sample 10"),
}


@pytest.mark.parametrize("suffix", FORMATS[1:])
@pytest.mark.parametrize("kind", BAD_ARRAYS)
def test_bad_arrays_are_refused(tmp_path, suffix, kind):
    arrays, words = BAD_ARRAYS[kind]
    path = tmp_path / f"rec{suffix}"
    save(path, **arrays)
    with pytest.raises(InputError, match=words) as caught:
        read_record(path)
    assert caught.value.hint


@pytest.mark.parametrize("suffix", [*FORMATS[1:], ".ulg"])
@pytest.mark.parametrize("keep", [0.6, 0.0, None])
def test_damaged_files_are_refused(tmp_path, record, suffix, keep):
    """Cut short, emptied, and something else altogether under this name."""
    path = tmp_path / f"rec{suffix}"
    (save_ulog if suffix == ".ulg" else write_record)(path, record)
    whole = path.read_bytes()
    path.write_bytes(b"not what the name says\n" * 40 if keep is None else whole[: int(keep * len(whole))])
    if suffix == ".ulg" and keep == 0.6:
        return  # a log that ends early is a shorter log
    with pytest.raises(InputError, match=r"damaged|empty") as caught:
        read_record(path, u="torque.cmd", y="torque.rate")
    assert caught.value.hint


def test_names_and_columns_of_arrays(tmp_path):
    path = tmp_path / "rec.npz"
    save(
        path,
        iq=np.arange(20.0)[:, None],
        omega=np.ones((1, 20)),
        temperature=np.full(20, 30),
        design=np.ones(4),
    )
    record = read_record(path, u="iq", y="omega", fs_hz=2500)
    assert record.u.shape == (20,)
    assert list(record.columns) == ["temperature"]


def test_objects_in_npz_are_left_alone(tmp_path):
    """Reading a pickled array would run what it says."""
    path = tmp_path / "rec.npz"
    np.savez(path, u=np.arange(20.0), y=np.ones(20), fs_hz=5.0, notes=np.array([{"a": 1}], dtype=object))
    assert len(read_record(path)) == 20


def test_mat_v73(tmp_path):
    """As MATLAB writes it: HDF5 behind a header of 512 bytes, rows as columns, text as numbers."""
    path = tmp_path / "rec.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["u"] = np.arange(20.0)[None, :]
        file["y"] = np.ones((1, 20))
        file["fs_hz"] = np.array([[2500.0]])
        file["y_unit"] = np.array([[ord(c)] for c in "rad/s"], np.uint16)
        file["y_unit"].attrs["MATLAB_class"] = np.bytes_("char")
    header = b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + struct.pack("<H", 0x0200) + b"IM"
    with open(path, "r+b") as file:
        file.write(header)
    record = read_record(path)
    assert (len(record), record.fs_hz, record.y_unit) == (20, 2500.0, "rad/s")


def test_path_inside_h5(tmp_path):
    path = tmp_path / "rec.h5"
    save(path, **{"axis1/command": np.arange(20.0), "axis1/gyro": np.ones(20), "fs_hz": 5.0})
    assert len(read_record(path, u="axis1/command", y="axis1/gyro")) == 20
    with pytest.raises(InputError) as caught:
        read_record(path, u="axis1/comand", y="axis1/gyro")
    assert "axis1/command" in caught.value.hint


def test_meta_json_beside(tmp_path, caplog):
    caplog.set_level("INFO", "gsid")
    beside = {
        "fs_hz": 2500.0,
        "period_samples": 5,
        "channels": [{"name": "u", "unit": "A"}, {"name": "y", "unit": "rad/s"}],
        "files": {"rec.npz": {}},
    }
    (tmp_path / "meta.json").write_text(json.dumps(beside))
    arrays = {"u": np.arange(20.0), "y": np.ones(20)}
    save(tmp_path / "rec.npz", **arrays)
    save(tmp_path / "other.npz", **arrays)
    record = read_record(tmp_path / "rec.npz")
    assert (record.fs_hz, record.period_samples, record.u_unit, record.y_unit) == (2500.0, 5, "A", "rad/s")
    assert [r.message for r in caplog.records] == [
        "rec.npz: fs_hz = 2500.0 from meta.json in its folder",
        "rec.npz: period_samples = 5 from meta.json in its folder",
    ]
    given = read_record(tmp_path / "rec.npz", fs_hz=100.0, period=4)
    assert (given.fs_hz, given.period_samples) == (100.0, 4)
    assert len(caplog.records) == 2
    with pytest.raises(InputError, match="sample rate is unknown"):
        read_record(tmp_path / "other.npz")


# ---------------------------------------------------------------- ULog


def save_ulog(path, record=None, step_us=lambda n: 4000 * n):
    """A ULog file written by hand from the format's description: one topic of two floats, another of one."""

    def message(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content

    n = 200 if record is None else len(record)
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), message("B", bytes(40))]
    parts.append(message("F", b"torque:uint64_t timestamp;float cmd;float rate;"))
    parts.append(message("F", b"gyro:uint64_t timestamp;float rate;"))
    parts.append(message("A", struct.pack("<BH", 0, 0) + b"torque"))
    parts.append(message("A", struct.pack("<BH", 0, 1) + b"gyro"))
    for i in range(n):
        t = 1000 + step_us(i)
        parts.append(message("D", struct.pack("<HQff", 0, t, i % 10, np.sin(i % 10))))
        parts.append(message("D", struct.pack("<HQf", 1, t + 70, 0.5)))
    path.write_bytes(b"".join(parts))


def test_ulog_by_topic(tmp_path):
    path = tmp_path / "log.ulg"
    save_ulog(path)
    record = read_record(path, u="torque.cmd", y="torque.rate")
    assert record.fs_hz == 250.0
    np.testing.assert_array_equal(record.u, np.arange(200) % 10)
    assert split_periods(record).period_samples == 10


@pytest.mark.parametrize(
    ("names", "words", "hint"),
    [
        ({"u": "torque.cmd", "y": "gyro.rate"}, "two topics", "one topic"),
        ({"u": "torque.cmd", "y": "torque.rat"}, "no field named torque.rat", "torque.rate"),
        ({"u": "torqe.cmd", "y": "torqe.rate"}, "no topic named torqe", "did you mean torque?"),
        ({}, "topic.field", "--u"),
    ],
)
def test_ulog_names(tmp_path, names, words, hint):
    path = tmp_path / "log.ulg"
    save_ulog(path)
    with pytest.raises(InputError, match=words) as caught:
        read_record(path, **names)
    assert hint in caught.value.hint


def test_ulog_times_jitter(tmp_path):
    """A log's times jitter: taken as equally spaced when the rate is stated; a gap is refused either way."""
    names = {"u": "torque.cmd", "y": "torque.rate"}
    path = tmp_path / "log.ulg"
    save_ulog(path, step_us=lambda n: 4000 * n + 300 * (n % 3))
    with pytest.raises(InputError, match="unequal time steps"):
        read_record(path, **names)
    assert read_record(path, **names, fs_hz=250.0).fs_hz == 250.0
    save_ulog(path, step_us=lambda n: 4000 * (n + (n > 100)))
    with pytest.raises(InputError, match=r"unequal time steps.*sample 101"):
        read_record(path, **names, fs_hz=250.0)


# ---------------------------------------------------------------- files


def test_unreadable(tmp_path):
    with pytest.raises(InputError, match=r"cannot read.*No such file"):
        read_record(tmp_path / "none.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match=r"cannot read.*directory"):
        read_record(tmp_path / "folder.csv")
    with pytest.raises(InputError, match=r"unknown kind of file.*\.txt") as caught:
        read_record(tmp_path / "rec.txt")
    assert ".csv" in caught.value.hint


@pytest.mark.parametrize("kind", ["csv", "npz", "mat", "h5"])
def test_the_columns_of_a_file_are_listed_without_reading_them(tmp_path, kind):
    n = 50
    columns = {"speed": np.zeros(n), "temperature": np.ones(n)}
    record = Record(np.arange(n), np.arange(n), 100.0, 10, 0, columns=columns)
    write_record(tmp_path / f"rec.{kind}", record)
    listed = columns_of(tmp_path / f"rec.{kind}")
    assert {"u", "y", "speed"} <= set(listed)
    assert not {"fs_hz", "period_samples"} & set(listed)


def test_a_column_with_a_non_breaking_space_is_written_and_read(tmp_path):
    """CSV refused the name as not printable; a line break stays refused."""
    x = np.arange(6.0)
    record = Record(x, x, 1000.0, columns={"Drive\u00a0[V]": x})
    write_record(tmp_path / "a.csv", record)
    assert list(read_record(tmp_path / "a.csv").columns) == ["Drive\u00a0[V]"]
    for name in ("Drive\u2028[V]", "Drive\x85[V]"):
        with pytest.raises(InputError, match="cannot store the name of a column"):
            write_record(tmp_path / "b.csv", Record(x, x, 1000.0, columns={name: x}))


@pytest.mark.parametrize("name", ["Time (ms)", "timestamp"])
def test_bug_a_column_of_times_of_another_name_was_not_mentioned(tmp_path, name):
    path = tmp_path / "axis.csv"
    path.write_text(f"{name},u,y\n0,1,2\n1,3,4\n2,5,6\n")
    with pytest.raises(InputError, match="sample rate is unknown") as caught:
        read_record(path)
    assert caught.value.hint.endswith(f"if {name} has the times in seconds, name it t_s")


def test_bug_times_under_another_name_contradicted_the_rate_without_a_word(tmp_path, caplog):
    """A wrong --fs, or lost rows, halved every frequency or gave another period."""
    n = 400
    time = 12.5 + np.arange(n) / 2000 + np.random.default_rng(1).normal(0, 2e-5, n)

    def warned(kept, fs_hz, name="Time [s]", times=time):
        path = tmp_path / "axis.csv"
        rows = "".join(f"{times[i]:.9g},{i % 7},{i % 5}\n" for i in kept)
        path.write_text(f"{name},u,y\n{rows}")
        caplog.clear()
        assert read_record(path, fs_hz=fs_hz).fs_hz == fs_hz
        return [record.getMessage() for record in caplog.records]

    every = range(n)
    assert warned(every, 2000.0) == []
    assert warned(every, 2000.0, "t_ms", 1e3 * time) == []
    assert warned(every, 2000.0, "t_ms", np.round(1e3 * time)) == []  # too coarse to show a lost sample
    assert warned(every, 2000.0, "lifetime", np.full(n, 3.0)) == []
    assert warned(every, 1000.0, "gain", time) == []
    (wrong,) = warned(every, 1000.0)
    assert wrong.startswith("axis.csv: the column Time [s] has steps of 0.000")
    assert "1000 Hz was given" in wrong
    (lost,) = warned([i for i in every if i not in (100, 101, 250)], 2000.0)
    assert lost.startswith(
        "axis.csv: samples are lost: the column Time [s] lacks 3, the first after sample 99;"
    )


def test_bug_a_struct_of_matlab_was_to_be_saved_as_a_vector(tmp_path):
    savemat(tmp_path / "axis.mat", {"data": {"u": np.arange(9.0), "y": np.arange(9.0)}})
    with pytest.raises(InputError, match="data does not hold real numbers") as caught:
        read_record(tmp_path / "axis.mat", u="data", y="data", fs_hz=1000.0)
    assert caught.value.hint == "save the fields of it as vectors: save('FILE.mat', '-struct', 'data')"
