"""Load both builds of the C library, and turn its status codes into exceptions."""

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
