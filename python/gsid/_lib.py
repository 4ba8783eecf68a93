"""Load both builds of the C library, and turn its status codes into exceptions."""

import numpy as np

from gsid.base.errors import GsidError

try:
    from gsid._gsid32 import ffi as ffi32
    from gsid._gsid32 import lib as lib32
    from gsid._gsid64 import ffi, lib
except ImportError as error:
    raise ImportError(f"{error}; hint: `make` in the clone builds the C library for Python") from error

__all__ = ["check", "ffi", "ffi32", "lib", "lib32", "version"]


def version() -> str:
    """Return the version of the C library."""
    return ffi.string(lib.GSID_VERSION).decode()


@ffi.def_extern()
def gsid_python_to_lines(n, x, lines) -> None:
    """Transform n samples (`gsid_transform.to_lines`)."""
    samples = np.frombuffer(ffi.buffer(x, 8 * n))
    np.frombuffer(ffi.buffer(lines, 16 * (n // 2 + 1)), complex)[:] = np.fft.rfft(samples)


@ffi.def_extern()
def gsid_python_to_samples(n, lines, x) -> None:
    """Transform lines 0 .. n/2 into n samples (`gsid_transform.to_samples`)."""
    spectrum = np.frombuffer(ffi.buffer(lines, 16 * (n // 2 + 1)), complex)
    np.frombuffer(ffi.buffer(x, 8 * n))[:] = np.fft.irfft(spectrum, n, norm="forward")


@ffi.def_extern(error=1)
def gsid_python_each(user, n, work, of_work) -> int:
    """Run work(of_work, i) for each i (`gsid_each`), by the function whose handle `user` is."""
    return ffi.from_handle(user)(n, lambda i: work(of_work, i))


def use_numpy_transforms(use: bool = True) -> None:
    """Let the C library transform with numpy instead of what it was built with, or no longer."""
    functions = (lib.gsid_python_to_lines, lib.gsid_python_to_samples)
    check(lib.gsid_transform_use(ffi.new("gsid_transform *", functions) if use else ffi.NULL))


def check(status: int, doing: str = "") -> int:
    """Raise an exception if a status means failure.

    Parameters
    ----------
    status : int
        Return value of a library function.
    doing : str
        The operation that failed, for the message.

    Returns
    -------
    int
        The status: 0 means success, a positive status is success with a remark.

    Raises
    ------
    GsidError
        The status is negative.
    """
    if status >= 0:
        return status
    meaning = ffi.string(lib.gsid_status_str(status)).decode()
    hint = ffi.string(lib.gsid_status_hint(status)).decode()
    raise GsidError(status, f"{doing}: {meaning}" if doing else meaning, hint)


if ffi.string(lib.gsid_build_library_version(b"fftw")) == b"":
    use_numpy_transforms()
