"""Periods measured apart, in other processes, and merged in one order: the same bits as in one process."""

import subprocess
import sys
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from gsid.base.errors import InputError
from gsid.response.streaming import StreamingFrf

FS_HZ, N, N_PARTS = 100.0, 60, 3
LINES = np.arange(1, 25)
HERE = Path(__file__).parent


def measure(number, precision="double", engine="direct", is_known=False):
    """Part of a measurement: some periods of one seed each."""
    rng = np.random.default_rng([11, number])
    u = np.tile(np.random.default_rng(3).standard_normal(N), number + 3)
    y = np.convolve(u, [0.5, 0.3, 0.1])[: len(u)] + 0.1 * rng.standard_normal(len(u))
    known = 2 / N * np.fft.fft(u[:N])[LINES] if is_known else None
    part = StreamingFrf(FS_HZ, N, LINES, precision=precision, engine=engine, u_known=known)
    part.step(u + (0 if is_known else 0.01 * rng.standard_normal(len(u))), y)
    return part


def merged(parts):
    """Periods, and bits of the result, of parts that are added in this order."""
    whole = parts[0]
    for part in parts[1:]:
        whole.merge(part)
    response = whole.result()
    fields = (response.g, response.var_g, response.u, response.y, response.cov_yu, response.var_u)
    return whole.n_periods, b"".join(np.ascontiguousarray(field).tobytes() for field in fields)


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("engine", ["direct", "spread"])
@pytest.mark.parametrize("is_known", [False, True])
def test_parts_that_were_kept_in_files_merge_to_the_same_bits(tmp_path, precision, engine, is_known):
    kind = precision, engine, is_known
    for i in range(N_PARTS):
        measure(i, *kind).save(tmp_path / f"{i}.npz")
    for order in permutations(range(N_PARTS)):
        loaded = merged([StreamingFrf.load(tmp_path / f"{i}.npz") for i in order])
        assert loaded == merged([measure(i, *kind) for i in order])
        assert loaded[0] == sum(i + 3 for i in range(N_PARTS))


def test_parts_of_other_processes_merge_to_the_same_bits(tmp_path):
    """Each process has another number of threads, and another state of its memory."""
    running = []
    for i in range(N_PARTS):
        script = (
            f"import sys; sys.path.insert(0, {str(HERE)!r}); noise = bytearray({i + 1} << 20); "
            f"from test_merged_parts import measure; measure({i}).save({str(tmp_path / f'{i}.npz')!r})"
        )
        running.append(
            subprocess.Popen([sys.executable, "-c", script], env={"OPENBLAS_NUM_THREADS": str(i + 1)})
        )
    assert [one.wait() for one in running] == [0] * N_PARTS
    for order in permutations(range(N_PARTS)):
        parts = [StreamingFrf.load(tmp_path / f"{i}.npz") for i in order]
        assert merged(parts) == merged([measure(i) for i in order])


def test_another_order_differs_by_rounding_only():
    first, last = (merged([measure(i) for i in order])[1] for order in ((0, 1, 2), (2, 1, 0)))
    assert np.frombuffer(first) == pytest.approx(np.frombuffer(last), rel=1e-9, abs=1e-12)


def test_a_loaded_part_goes_on_with_whole_periods(tmp_path):
    part = measure(0)
    part.save(tmp_path / "a.npz")
    loaded = StreamingFrf.load(tmp_path / "a.npz")
    u = np.random.default_rng(4).standard_normal(2 * N)
    part.step(u, 2 * u)
    loaded.step(u, 2 * u)
    assert loaded.n_periods == part.n_periods == 5
    assert loaded.result().g.tobytes() == part.result().g.tobytes()


@pytest.mark.parametrize("damage", ["mean", "shape", "nan", "text"])
def test_a_file_that_is_no_part_is_refused(tmp_path, damage):
    path = tmp_path / "a.npz"
    measure(0).save(path)
    with np.load(path) as file:
        kept = dict(file)
    if damage == "mean":
        del kept["mean"]
    elif damage == "shape":
        kept["m2"] = kept["m2"][1:]
    elif damage == "nan":
        kept["m2"][0] = np.nan
    np.savez(path, **kept)
    if damage == "text":
        path.write_text("no zip file")
    with pytest.raises(InputError, match="no part of a measurement"):
        StreamingFrf.load(path)
