"""Packages that only a comparison needs, and that need not be there."""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any


def load(package: str, module: str) -> tuple[Any, str]:
    """The module, and why there is none: a package that is not installed, or does not load."""
    try:
        return import_module(module), ""
    except ModuleNotFoundError as error:
        if error.name == module.partition(".")[0]:
            return None, f"not installed; pip install {package}"
        return None, f"does not load: {error}"
    except ImportError as error:  # a library of the system that it needs
        return None, f"does not load: {error}"


def version_of(package: str, module: str) -> str:
    """The installed version; empty if pip does not know it."""
    for name in (package, module.partition(".")[0]):
        try:
            return version(name)
        except PackageNotFoundError:
            continue
    return ""
