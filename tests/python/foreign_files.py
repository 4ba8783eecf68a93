"""Sound binary records of each kind, small, and copies of them with wrong bytes."""

import struct

import h5py
import numpy as np
from scipy.io import savemat

N = 200
U = np.tile(np.random.default_rng(61).standard_normal(20), N // 20)
Y = np.cumsum(U) / 10
NAMES = {".ulg": {"u": "torque.cmd", "y": "torque.rate"}}


def arrays():
    """What a sound record holds."""
    return {"u": U, "y": Y, "fs_hz": 250.0, "period_samples": 20, "u_unit": "A", "valid": np.ones(N, bool)}


def write(path):
    """Write a sound record; a .mat is v5, `v73.mat` v7.3."""
    if path.suffix == ".npz":
        np.savez_compressed(path, **arrays())
    elif path.name == "v73.mat":
        write_v73(path)
    elif path.suffix == ".mat":
        savemat(path, arrays(), do_compression=path.stem.endswith("z"))
    elif path.suffix == ".ulg":
        write_ulog(path)
    else:
        with h5py.File(path, "w") as file:
            for name, value in arrays().items():
                file.create_dataset(name, data=value, compression="gzip" if np.ndim(value) else None)


def write_v73(path):
    """As MATLAB does: HDF5 behind a header of 512 bytes, rows as columns."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in arrays().items():
            if not isinstance(value, str):
                file[name] = np.atleast_2d(np.asarray(value, float))
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + struct.pack("<H", 0x0200) + b"IM")


def write_ulog(path):
    """One topic of two floats, by the format's description."""

    def message(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), message("B", bytes(40))]
    parts.append(message("F", b"torque:uint64_t timestamp;float cmd;float rate;"))
    parts.append(message("A", struct.pack("<BH", 0, 0) + b"torque"))
    for i in range(N):
        parts.append(message("D", struct.pack("<HQff", 0, 1000 + 4000 * i, U[i], Y[i])))
    path.write_bytes(b"".join(parts))


def flipped(data, rng):
    """The bytes with one to three of them wrong."""
    wrong = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        wrong[rng.integers(len(wrong))] ^= 1 << rng.integers(8)
    return bytes(wrong)


def npy_claiming(shape, descr="<f8", body=b""):
    """An .npy whose header declares more than it has."""
    head = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    head = head.ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + body
