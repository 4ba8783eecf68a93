"""gsid: measure a servo axis, fit a model, and see where the two differ."""

from gsid.errors import GsidError, InputError

__all__ = ["GsidError", "InputError", "__version__"]


def __getattr__(name: str) -> str:
    """Load the C library when it is first needed, so that `gsid doctor` can say why it does not load."""
    if name == "__version__":
        from gsid._lib import version

        return version()
    raise AttributeError(f"module 'gsid' has no attribute {name!r}")
