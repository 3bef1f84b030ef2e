"""What is killed, filled up, interrupted or crowded, with the real programs: short versions.

Limits of time are for the long ones: here the machine is busy with other tests.
"""

import pytest

from studies.endurance import fault_caches, fault_files, fault_kills, fault_signals
from studies.endurance import fault_multi_node as fault_company
from studies.endurance.promises import Promise, Trial

TRIALS = [
    fault_kills.killed_nodes,
    fault_kills.killed_replayers,
    fault_kills.killed_subscribers,
    fault_files.killed_writers,
    fault_files.full_disks,
    fault_files.forbidden_places,
    fault_signals.signals,
    fault_caches.damaged_caches,
    fault_caches.shared_caches,
    fault_company.second_nodes,
    fault_company.namespaces,
    fault_company.hanging_subscribers,
]


@pytest.mark.parametrize("tried", TRIALS, ids=lambda tried: tried.__name__)
def test_the_promise_is_kept(tried):
    found = tried(Trial(quick=True))
    rows = [found] if isinstance(found, Promise) else found
    assert rows and not [row for row in rows if not row.holds]
