"""Requirements on a node under overload, judged from runs that meet them or do not."""

from dataclasses import replace

import numpy as np
import pytest

from studies.endurance.overload import QUICK
from studies.endurance.overload_requirements import (
    Case,
    bounded_memory,
    counted_losses,
    eviction,
    fresh_updates,
    recovery,
    recovery_time,
)

WINDOW = replace(QUICK, window_s=10.0)


def measured(factor=4, peak_mb=500.0, early=9, groups=40, **counts):
    """A run with an update per second, of which the second half is calm."""
    stamp = np.arange(40.0)
    report = {
        "clouds received": 400,
        "clouds lost by DDS": 0,
        "updates": 30,
        "updates coalesced": 10,
    }
    report |= {"updates dropped": 0, "points evicted": early}
    texts = {name: f"{count}" for name, count in (report | counts).items()}
    return Case(factor, 1e5, stamp, 0 * stamp, 0 * stamp, 20.0, 400, groups, texts, peak_mb)


@pytest.mark.parametrize(("late", "seconds"), [(0, 0.0), (4, 3.0), (12, 11.0)])
def test_recovery_lasts_until_the_last_late_update_except_two(late, seconds):
    stamp = np.arange(40.0)
    latency = np.where((stamp < 20 + late) | np.isin(stamp, [35.0, 36.0]), 5.0, 0.5)
    case = replace(measured(), latency=latency)
    assert recovery_time(case, 10.0) == seconds
    assert recovery([case], WINDOW).met


@pytest.mark.parametrize("end", [5.0, 15.0])  # s of latency
def test_a_node_that_is_never_calm_does_not_recover(end):
    case = replace(measured(), latency=np.interp(np.arange(40.0), [20.0, 39.0], [5.0, end]))
    assert recovery_time(case, 10.0) == 0.0
    assert not recovery([case], WINDOW).met


@pytest.mark.parametrize(
    ("second", "holds", "within_limits"),
    [
        ({}, True, True),
        ({"peak_mb": 590.0}, True, True),
        ({"peak_mb": 610.0}, True, False),
        ({"peak_mb": 590.0, "early": 0}, False, True),  # only one is at the bound
    ],
)
def test_memory_is_bounded_if_two_loads_at_the_bound_need_the_same(second, holds, within_limits):
    row = bounded_memory([measured(), measured(8, **second)], QUICK, 1000)
    assert (row.holds, row.within_limits) == (holds, within_limits)


@pytest.mark.parametrize(
    ("early", "holds"),
    [
        ((0, 1_700_000), True),
        ((0, 1_600_001), True),
        ((0, 1_599_999), False),  # 2,000,000 were sent, of which the window has 400,000
        ((0, 0), False),
        ((9, 1_700_000), False),
    ],
)
def test_all_points_beyond_the_window_must_be_counted(early, holds):
    few, many = (measured(early=count) for count in early)
    assert not eviction([replace(few, rate=1e5)], WINDOW, "", 2_000_000).met  # none is too much
    cases = [replace(few, rate=3e4), replace(many, rate=1e5)]
    assert eviction(cases, WINDOW, "", 400_000).met == holds


@pytest.mark.parametrize(("late", "met"), [(1, True), (3, False)])
def test_an_update_that_dds_sends_again_is_not_stale(late, met):
    stale = np.where(np.arange(40) < late, 4.0, 1.5)  # 3 are many in 20, but few in 40
    assert fresh_updates([replace(measured(), stale=stale)]).met == met


@pytest.mark.parametrize(
    ("counts", "met"),
    [
        ({}, True),
        ({"updates": 29, "updates dropped": 1}, True),
        ({"updates": 29}, False),
        ({"updates coalesced": 11}, False),
        ({"clouds received": 399}, False),
        ({"clouds received": 399, "clouds lost by DDS": 1, "updates": 29}, True),
    ],
)
def test_every_cloud_and_every_group_must_be_counted(counts, met):
    assert counted_losses([measured(), measured(8, **counts)]).met == met
