"""Memory for large arrays."""

from typing import Any

import numpy as np

from ellipseg_ros.data import Array


def room(shape: int | tuple[int, ...], dtype: Any = np.float64) -> Array:
    """A new array of zeros that has its pages already.

    Where several threads are the first to touch new memory, the kernel hands it out several times
    slower than to one that walks through it.
    """
    made = np.empty(shape, dtype)
    made.fill(0)
    return made
