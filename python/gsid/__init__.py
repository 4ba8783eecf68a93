"""gsid: measure a servo axis, fit a model, and see where the two differ."""

from gsid._lib import version
from gsid.errors import GsidError, InputError

__version__ = version()
__all__ = ["GsidError", "InputError", "__version__"]
