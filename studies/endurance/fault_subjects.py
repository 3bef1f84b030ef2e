"""Subjects about what can be killed, filled up, interrupted, damaged or crowded."""

from studies.endurance.fault_caches import damaged_caches, shared_caches
from studies.endurance.fault_files import forbidden_places, full_disks, killed_writers
from studies.endurance.fault_kills import (
    killed_nodes,
    killed_replayers,
    killed_subscribers,
)
from studies.endurance.fault_multi_node import (
    hanging_subscribers,
    namespaces,
    second_nodes,
)
from studies.endurance.promises import Promise, Trial


def kills(trial: Trial) -> list[Promise]:
    """kill -9 of everything that has to do with the node."""
    return [
        *killed_nodes(trial),
        killed_replayers(trial),
        killed_subscribers(trial),
        killed_writers(trial),
    ]


def disks(trial: Trial) -> list[Promise]:
    """Where one can't write, or not enough."""
    return [full_disks(trial), forbidden_places(trial)]


def caches(trial: Trial) -> list[Promise]:
    """The compiled kernels on the disk."""
    return [damaged_caches(trial), shared_caches(trial)]


def company(trial: Trial) -> list[Promise]:
    """Other nodes, and subscribers that hang."""
    return [second_nodes(trial), namespaces(trial), hanging_subscribers(trial)]
