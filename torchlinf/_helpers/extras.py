"""Packages that only some features need: imported where they are used, with one message where they are missing."""

from importlib import import_module
from types import ModuleType


def require(module: str, feature: str, extra: str) -> ModuleType:
    """Import a package of an extra, or say which extra is to be installed.

    Args:
        module: what to import, such as "pyarrow.parquet".
        feature: what needs it, as the subject of the message, in the singular.
        extra: the extra of torchlinf that holds it.

    Raises:
        ImportError: the package is not installed.

    >>> require("no_such_package", "reading Parquet", "parquet")
    Traceback (most recent call last):
    ImportError: reading Parquet needs no_such_package; it is not installed. Run: pip install 'torchlinf[parquet]'
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ImportError(
            f"{feature} needs {package}; it is not installed. Run: pip install 'torchlinf[{extra}]'"
        ) from error
