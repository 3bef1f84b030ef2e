"""Optional packages of the studies: import, and the reason if that fails."""

from importlib import import_module
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
