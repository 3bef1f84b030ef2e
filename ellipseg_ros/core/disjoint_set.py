"""Disjoint sets over an array `above`: above[i] is i at a root."""

from ellipseg_ros.core.jit import kernel


@kernel
def find(above, item):
    """The root over `item`; halves the path to it (Tarjan & van Leeuwen 1984)."""
    while above[item] != item:
        above[item] = above[above[item]]
        item = above[item]
    return item
