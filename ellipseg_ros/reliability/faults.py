"""Everything that can be killed, filled up, interrupted, damaged or crowded, one after another."""

from ellipseg_ros.reliability.fault_caches import damaged_caches, shared_caches
from ellipseg_ros.reliability.fault_company import (
    hanging_subscribers,
    namespaces,
    second_nodes,
)
from ellipseg_ros.reliability.fault_files import forbidden_places, full_disks, killed_writers
from ellipseg_ros.reliability.fault_kills import (
    killed_nodes,
    killed_replayers,
    killed_subscribers,
)
from ellipseg_ros.reliability.fault_signals import signals
from ellipseg_ros.reliability.promises import Promise, Trial


def faults(trial: Trial) -> list[Promise]:
    """All of it; the short version what no other test tries, for each process costs seconds."""
    if trial.quick:
        return [
            *killed_nodes(trial),
            killed_replayers(trial),
            killed_writers(trial),
            full_disks(trial),
            *signals(trial),
            second_nodes(trial),
            hanging_subscribers(trial),
        ]
    return [
        *killed_nodes(trial),
        killed_replayers(trial),
        killed_subscribers(trial),
        killed_writers(trial),
        full_disks(trial),
        forbidden_places(trial),
        *signals(trial),
        damaged_caches(trial),
        shared_caches(trial),
        second_nodes(trial),
        namespaces(trial),
        hanging_subscribers(trial),
    ]
