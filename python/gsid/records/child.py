"""Worker process that reads foreign binary files: .npz, .mat (v5 and v7.3), .h5 and ULog.

The readers of these formats trust the contents of a file. One wrong byte can crash the process, allocate
gigabytes or make HDF5 open other files. They therefore run in this process, with limits on memory and time,
and never in the process of the command. `gsid.records.foreign` starts this file as a script and communicates
over stdin and stdout. A request is one line of JSON. An answer is the length of a JSON header (8 bytes,
little endian), the header, then the bytes of its arrays in order. To start quickly, it imports only the
standard library, numpy and the reader of the format.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import signal
import struct
import sys

NUMBERS = "fiubc"
SIZE_OF_KEY = 65536  # bytes: a key is one number or a short text
N_NAMES = 200  # names listed if the requested one is missing
DEFLATE_MAX = 1032  # largest compression ratio of deflate: the largest array over its stored size
UNCHECKED_BYTES = 64e6  # bytes: the ratio is not checked for smaller arrays


class Refused(Exception):
    """A file is refused: message, value and hint of the error."""


def not_real(name, kind):
    return Refused(f"{name} does not hold real numbers", f"type {kind}", "save it as an array of numbers")


class Missing(Exception):
    """A requested name is not in the file. The argument lists the names in the file."""


class Request:
    """What to read: names of the arrays and keys, and the memory limit."""

    def __init__(self, line):
        fields = json.loads(line)
        self.kind, self.path, self.memory = fields["kind"], fields["path"], fields["memory"]
        self.arrays, self.keys, self.seconds = fields["arrays"], fields["keys"], fields["seconds"]
        self.like = self.arrays[0] if self.arrays else None  # other arrays of its length are columns
        self.left = self.memory

    def claim(self, name, size):
        """Count the declared size of an array before it is read."""
        self.left -= size
        if self.left < 0:
            raise Refused(
                f"array {name} is too large for its file",
                f"{size / 1e9:.3g} GB declared, at most {self.memory / 1e9:.3g} GB are read",
                "write the file again, or export a shorter record",
            )

    def has_room(self, size):
        """Whether another column still fits into the memory left."""
        return size <= self.left / 2


# ---------------------------------------------------------------- npz


def read_npz(request):
    import zipfile

    from numpy.lib import format as npy

    entries = {}
    with zipfile.ZipFile(request.path) as archive:
        members = {
            i.filename.removesuffix(".npy"): i for i in archive.infolist() if i.filename.endswith(".npy")
        }

        def head(name):
            """Read shape, type and size of a member, and check the size against the member."""
            with archive.open(members[name]) as file:
                version = npy.read_magic(file)
                read_head = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
                shape, _, dtype = read_head(file)
                declared = math.prod(shape) * dtype.itemsize
                if dtype.kind != "O" and declared != members[name].file_size - file.tell():
                    raise ValueError("size of the member")
            return shape, dtype, declared

        def load(name):
            with archive.open(members[name]) as file:
                return npy.read_array(file, allow_pickle=False)

        for name in request.keys + request.arrays:
            if name not in members:
                continue
            shape, dtype, declared = head(name)
            if name in request.keys and declared > SIZE_OF_KEY:
                continue
            if dtype.kind not in NUMBERS + "US":
                if name in request.arrays:
                    raise Refused(
                        f"{name} does not hold real numbers",
                        f"type {dtype}",
                        "save it as an array of numbers",
                    )
                continue
            request.claim(name, declared)
            entries[name] = load(name)
        others = [name for name in members if name not in request.keys + request.arrays]
        for name in others[:N_NAMES]:
            with contextlib.suppress(Exception):  # another array may be of any kind, or damaged
                shape, dtype, declared = head(name)
                if is_column(request, entries, shape, dtype) and request.has_room(declared):
                    request.claim(name, declared)
                    entries[name] = load(name)
    return entries, [*members]


def is_column(request, entries, shape, dtype):
    """Whether an array holds real numbers and has the length of the input."""
    like = entries.get(request.like)
    return like is not None and dtype.kind in "fiub" and 0 < math.prod(shape) == like.size and like.ndim > 0


# ---------------------------------------------------------------- mat


def read_mat(request):
    import numpy as np
    from scipy.io import loadmat, whosmat

    try:
        listed = whosmat(request.path)
    except NotImplementedError:  # v7.3 is HDF5
        return read_h5(request)
    item = {"double": 8, "int64": 8, "uint64": 8, "single": 4, "int32": 4, "uint32": 4}
    shape_of, class_of = {n: s for n, s, _ in listed}, {n: c for n, _, c in listed}
    size_of = {n: math.prod(s) * item.get(class_of[n], 2) for n, s in shape_of.items()}
    named = [n for n in request.arrays if n in shape_of]
    named += [n for n in request.keys if size_of.get(n, SIZE_OF_KEY + 1) <= SIZE_OF_KEY]
    for name in named:
        request.claim(name, size_of[name])
    n = math.prod(shape_of.get(request.like, (0,)))
    for name in [name for name in shape_of if name not in request.arrays + request.keys][:N_NAMES]:
        is_number = class_of[name] in item or class_of[name] in (
            "int8",
            "uint8",
            "int16",
            "uint16",
            "logical",
        )
        if is_number and math.prod(shape_of[name]) == n > 0 and request.has_room(size_of[name]):
            request.claim(name, size_of[name])
            named.append(name)
    found = loadmat(request.path, squeeze_me=True, variable_names=named) if named else {}
    entries = {name: np.asarray(found[name]) for name in named if name in found}
    for name in request.arrays:
        if name in entries and entries[name].dtype.kind not in NUMBERS + "US":
            fields = f"save the fields of it as vectors: save('FILE.mat', '-struct', '{name}')"
            hint = fields if class_of[name] == "struct" else "save it as a vector"
            raise Refused(f"{name} does not hold real numbers", f"type {class_of[name]}", hint)
    return entries, [name for name in shape_of if not name.startswith("__")]


# ---------------------------------------------------------------- HDF5


def read_h5(request):
    import h5py

    entries = {}
    with h5py.File(request.path, "r") as file:
        for name in request.keys:
            if name in file.attrs and file.attrs.get_id(name).get_storage_size() <= SIZE_OF_KEY:
                entries[name] = file.attrs[name]
        for name in request.keys + request.arrays:
            node = h5_node(file, name)
            if not isinstance(node, h5py.Dataset):
                continue
            if name in request.arrays:
                h5_check(request, name, node)
            elif not is_plain(node) or node.nbytes > SIZE_OF_KEY:
                continue
            entries[name] = h5_value(node, h5py)
        names = h5_names(file, h5py)
        for name in [name for name in names if name not in entries]:
            with contextlib.suppress(Exception):  # another array may be of any kind, or damaged
                node = h5_node(file, name)
                is_needed = is_plain(node) and is_column(request, entries, node.shape, node.dtype)
                if is_needed and request.has_room(node.nbytes):
                    request.claim(name, node.nbytes)
                    entries[name] = node[()]
    return {name: value for name, value in entries.items() if value is not None}, names


def h5_node(file, name, depth=0):
    """Find an object by name, following links inside the file only; None if it does not exist."""
    import h5py

    node, parts = file, [part for part in name.split("/") if part and part != "."]
    for i, part in enumerate(parts):
        link = node.get(part, getlink=True) if isinstance(node, h5py.Group) else None
        if link is None:
            return None
        if isinstance(link, h5py.ExternalLink):
            raise Refused(f"{name} is a link to another file", link.filename, "copy the data into one file")
        if isinstance(link, h5py.SoftLink):
            if depth > 8:
                raise Refused(f"{name} is a circular link", link.path, "write the file again")
            base = "" if link.path.startswith("/") else "/".join(parts[:i])
            return h5_node(file, "/".join([base, link.path, *parts[i + 1 :]]), depth + 1)
        node = node[part]
    return node


def is_plain(node):
    """Whether all data of a dataset are stored in the file itself."""
    return hasattr(node, "nbytes") and not node.external and not node.is_virtual


def h5_check(request, name, node):
    if not is_plain(node):
        where = "external storage" if node.external else "a virtual dataset"
        raise Refused(f"{name} is stored in other files", where, "copy the data into one file")
    if node.dtype.kind not in NUMBERS + "SU":
        raise Refused(
            f"{name} does not hold real numbers", f"type {node.dtype}", "save it as an array of numbers"
        )
    stored = node.id.get_storage_size()
    if node.nbytes > max(DEFLATE_MAX * stored, UNCHECKED_BYTES):
        raise Refused(
            f"array {name} is larger than its file allows",
            f"{node.nbytes / 1e9:.3g} GB declared, {stored} bytes stored",
            "write the file again with all its samples",
        )
    request.claim(name, node.nbytes)


def h5_value(node, h5py):
    import numpy as np

    if node.attrs.get("MATLAB_class") == b"char":
        return "".join(map(chr, np.ravel(node[()])))
    if h5py.check_string_dtype(node.dtype) and node.shape == ():
        return node.asstr()[()]
    return node[()] if node.dtype.kind in NUMBERS + "SU" else None


def h5_names(file, h5py):
    names = []

    def note(name, node):
        if isinstance(node, h5py.Dataset) and not name.startswith("#"):
            names.append(name)
        return len(names) >= N_NAMES or None  # anything but None ends the visit

    with contextlib.suppress(Exception):  # the names serve only as hints and for optional columns
        file.visititems(note)
    return names


# ---------------------------------------------------------------- ULog


def read_ulg(request):
    from pyulog import ULog

    topic = request.like.partition(".")[0]

    def parts(only):
        return ULog(request.path, message_name_filter_list=only).data_list

    data = next((d.data for d in parts([topic]) if d.name == topic and d.multi_id == 0), None)
    if data is None:
        raise Missing(sorted({d.name for d in parts(None)})[:N_NAMES])
    return {f"{topic}.{name}": values for name, values in data.items()}, []


READERS = {"npz": read_npz, "mat": read_mat, "h5": read_h5, "ulg": read_ulg}

# ---------------------------------------------------------------- requests and answers


def limit(request):
    """Limit the memory, and the time in case the parent dies. Without rlimits, limit the time only."""
    with contextlib.suppress(ImportError, AttributeError, ValueError, OSError):
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        most = request.memory if hard == resource.RLIM_INFINITY else min(request.memory, hard)
        resource.setrlimit(resource.RLIMIT_AS, (most, hard))
    with contextlib.suppress(AttributeError, OSError):
        signal.alarm(int(request.seconds) + 5)


def answer(request):
    """Make the header and the arrays that answer a request."""
    notes = io.StringIO()
    try:
        with contextlib.redirect_stdout(notes):  # readers print their warnings
            entries, names = READERS[request.kind](request)
    except Refused as error:
        return {"refused": error.args}, []
    except Missing as error:
        return {"missing": error.args[0]}, []
    except MemoryError:
        return {"memory": True}, []
    except ImportError as error:
        return {"import": str(error)}, []
    except BaseException as error:  # the readers may raise any exception on a damaged file
        return {"damaged": f"{type(error).__name__}: {error}"[:200]}, []
    import numpy as np

    listed, arrays = [], []
    for name, value in entries.items():
        if isinstance(value, str):
            listed.append({"name": name, "text": value})
            continue
        array = np.asarray(value)
        if array.dtype.kind in NUMBERS + "US":
            arrays.append(np.ascontiguousarray(array))
            listed.append({"name": name, "dtype": array.dtype.str, "shape": array.shape})
    return {"entries": listed, "names": names, "notes": notes.getvalue()[:1000]}, arrays


def send(out, header, arrays):
    text = json.dumps(header).encode()
    out.write(struct.pack("<Q", len(text)) + text)
    for array in arrays:
        if array.size:
            out.write(array.reshape(-1).view("u1").data)
    out.flush()


def serve():
    """Answer requests until stdin ends."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # text that a library prints must not mix with the answers
    for line in sys.stdin.buffer:
        request = Request(line)
        limit(request)
        send(out, *answer(request))
        with contextlib.suppress(AttributeError):
            signal.alarm(0)


if __name__ == "__main__":
    serve()
