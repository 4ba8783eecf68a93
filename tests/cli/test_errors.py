"""Every kind of bad input and usage: exit code, place, hint, and the whole text as a snapshot."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gsid.base.errors import GsidError
from gsid.base.files import write_atomically
from gsid.cli.main import gsid as verbs

COMMAND = Path(sys.executable).parent / "gsid"


def rows(n=100, period=20, columns="t_s,u,y", **changed):
    """A sound CSV file, but for the lines given as `line7="..."` (line 1 is the header)."""
    lines = [columns] + [f"{i / 100:.2f},{i % period},{i % 3}" for i in range(n)]
    for key, text in changed.items():
        lines[int(key.removeprefix("line")) - 1] = text
    return "\n".join(line for line in lines if line != "-") + "\n"


NOISE = "u,y\n" + "".join(f"{u:.4f},0\n" for u in np.random.default_rng(40).standard_normal(500))

# name: text of rec.csv, arguments after `gsid frf rec.csv`, what stands behind `where:`
BAD_INPUT = {
    "unequal_steps": (rows(line20="-"), [], "rec.csv line 20, column t_s"),
    "nan": (rows(line9="0.07,nan,1"), [], "rec.csv line 9, column u: nan"),
    "inf": (rows(line9="0.07,1,inf"), [], "rec.csv line 9, column y: inf"),
    "not_a_number": (rows(line30="0.28,1,over"), [], "rec.csv line 30, column y: over"),
    "missing_column": (rows(columns="t_s,u,omega_motor"), ["--y", "omega_moter"], "rec.csv"),
    "less_than_two_periods": (rows(n=30), [], "u repeats after 20 of 30 samples"),
    "less_than_two_after_settling": (rows(), ["--settle", "70", "--period", "20"], "settle 70"),
    "not_periodic": (NOISE, ["--fs", "100"], "rec.csv"),
    "wrong_period": (rows(), ["--period", "19"], "rec.csv"),
    "constant": (rows(period=1), [], "rec.csv"),
    "cut_short": (rows().rstrip("\n")[:-2], [], "rec.csv line 101"),
    "empty": ("", [], "rec.csv: 0 bytes"),
    "header_only": ("t_s,u,y\n", [], "rec.csv"),
    "no_rate": (NOISE, [], "rec.csv"),
    "wrong_rate": (rows(), ["--fs", "3000"], "3000 Hz given, 100 Hz in the file"),
    "band_without_lines": (rows(), ["--band", "48:49"], "rec.csv"),
}


@pytest.mark.parametrize("kind", BAD_INPUT)
def test_bad_input(gsid, snapshot, kind):
    text, arguments, where = BAD_INPUT[kind]
    Path("rec.csv").write_text(text)
    result = gsid("frf", "rec.csv", *arguments)
    assert result.code == 3
    assert result.out == ""
    assert result.err.startswith(("error: ", "note: "))
    assert where in result.err
    assert "  hint: " in result.err
    assert "Traceback" not in result.err
    snapshot(f"error_{kind}", result.err)


@pytest.mark.parametrize(
    ("name", "arrays"),
    [
        ("unequal_lengths", {"u": np.arange(40.0), "y": np.ones(39), "fs_hz": 5.0}),
        ("wrong_shape", {"u": np.arange(40.0), "y": np.ones((20, 2)), "fs_hz": 5.0}),
    ],
)
def test_bad_arrays(gsid, snapshot, name, arrays):
    np.savez("rec.npz", **arrays)
    result = gsid("frf", "rec.npz")
    assert result.code == 3
    snapshot(f"error_{name}", result.err)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("rec.npz", b"PK\x03\x04 cut"),
        ("rec.mat", b"MATLAB 5.0"),
        ("rec.h5", b"\x89HDF"),
        ("rec.ulg", b"ULog"),
    ],
)
def test_damaged_files(gsid, name, content):
    Path(name).write_bytes(content)
    result = gsid("frf", name, "--u", "a.u", "--y", "a.y")
    assert result.code == 3
    assert f"where: {name}" in result.err
    assert "hint: " in result.err


def test_files_that_cannot_be_read(gsid, snapshot):
    Path("folder.csv").mkdir()
    texts = [gsid("frf", name) for name in ("none.csv", "folder.csv", "rec.xyz")]
    assert [t.code for t in texts] == [3, 3, 3]
    snapshot("error_unreadable", "".join(t.err for t in texts))


def test_bad_model(gsid, rec_csv):
    Path("model.json").write_text('{"gsid_model": 1')
    for name in ("model.json", "none.json"):
        result = gsid("compare", rec_csv, "--model", name)
        assert result.code == 3
        assert name in result.err
        assert "hint: " in result.err


def test_output_that_cannot_be_written(gsid, rec_csv):
    result = gsid("frf", rec_csv, "-o", "nofolder/frf.csv")
    assert result.code == 3
    assert "where: nofolder/frf.csv" in result.err
    # Bugs: it was said after minutes of work, and of a file .frf.4711.part.csv.
    assert "found from" not in result.err


def test_a_write_that_fails_names_the_requested_file(tmp_path):
    def fail(part):
        raise OSError(28, "No space left on device", str(part))

    with pytest.raises(OSError, match="No space left") as caught:
        write_atomically(tmp_path / "m.json", fail)
    assert caught.value.filename == str(tmp_path / "m.json")


DESIGN = ["design", "multisine", "--fs", "100", "--period", "50"]

# name: arguments
BAD_USAGE = {
    "unknown_verb": ["comprae", "rec.csv"],
    "unknown_option": ["frf", "rec.csv", "--peroid", "4"],
    "no_record": ["frf"],
    "bad_band": ["frf", "rec.csv", "--band", "250:11"],
    "band_of_one_number": ["frf", "rec.csv", "--band", "250"],
    "bad_order": ["fit", "rec.csv", "--order", "4"],
    "no_order": ["fit", "rec.csv"],
    "bad_delay": ["fit", "rec.csv", "--order", "4/3", "--delay", "-1"],
    "bad_method": ["fit", "rec.csv", "--order", "4/3", "--method", "best"],
    "order_too_high": ["fit", "rec.csv", "--order", "90/3"],
    "band_above_half_the_rate": [*DESIGN, "--band", "1:60"],
    "two_sizes": [*DESIGN, "--band", "1:20", "--peak", "1", "--amplitude", "1"],
    "unknown_design": ["design", "multisin"],
    "output_extension": ["frf", "rec.csv", "-o", "frf.xls"],
}


@pytest.mark.parametrize("kind", BAD_USAGE)
def test_bad_usage(gsid, snapshot, rec_csv, kind):
    result = gsid(*BAD_USAGE[kind])
    assert result.code == 2
    assert result.out == ""
    assert "  where: gsid" in result.err
    assert "  hint: " in result.err
    snapshot(f"usage_{kind}", result.err)


@pytest.fixture
def broken_frf(gsid, rec_csv, monkeypatch):
    """Run `gsid frf` with a body that raises: what remains is what the command makes of it."""

    def run(error):
        def body(*_, **__):
            raise error

        monkeypatch.setattr(verbs.get_command(None, "frf"), "callback", body)
        return gsid("frf", rec_csv)

    return run


def test_failure_of_the_library_is_code_4(broken_frf):
    result = broken_frf(GsidError(-9, "transforming: out of memory"))
    assert result.code == 4
    assert result.err == "error: transforming: out of memory (status -9)\n"


@pytest.mark.parametrize("status", [-4, -6, -7, -8, -11])
def test_data_that_the_library_refuses_are_bad_input(broken_frf, status):
    """A bug: a fit to a constant output was an internal error, since its equations are singular."""
    result = broken_frf(GsidError(status, "fit"))
    assert result.code == 3
    assert "hint: " in result.err


def test_faults_of_gsid_are_code_4_and_traced_on_request(broken_frf, monkeypatch):
    result = broken_frf(ZeroDivisionError("division by zero"))
    assert result.code == 4
    assert "Traceback" not in result.err
    assert "GSID_DEBUG=1" in result.err
    monkeypatch.setenv("GSID_DEBUG", "1")
    assert "Traceback" in broken_frf(ZeroDivisionError("division by zero")).err


def test_interrupt(broken_frf):
    assert broken_frf(KeyboardInterrupt()).code == 130


def test_real_process(rec_csv):
    """Exit codes and streams as a shell sees them."""
    good = subprocess.run([COMMAND, "frf", rec_csv, "--json"], capture_output=True, text=True)
    assert good.returncode == 0
    assert json.loads(good.stdout)["n_realisations"] == 1
    bad = subprocess.run([COMMAND, "frf", "none.csv", "--json"], capture_output=True, text=True)
    assert (bad.returncode, bad.stdout) == (3, "")
    assert bad.stderr.startswith("error: cannot read the file\n  where: none.csv")
    usage = subprocess.run([COMMAND, "frg"], capture_output=True, text=True)
    assert usage.returncode == 2
    assert "did you mean frf?" in usage.stderr


def test_reader_that_goes_away(rec_csv):
    """`gsid frf ... | head -1` ends quietly."""
    command = f"'{COMMAND}' frf {rec_csv} | head -1; echo ${{PIPESTATUS[0]}}"
    result = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert result.stdout.splitlines()[1] == "0"
    assert "error" not in result.stderr
    assert "Traceback" not in result.stderr
