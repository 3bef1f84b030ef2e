"""Flow control of a replayer by the updates of the node."""

from dataclasses import replace

import numpy as np
import pytest

from ellipseg_ros.config import Config
from ellipseg_ros.node.flow_control import FlowControl
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.records import SECOND, Sweep
from ellipseg_ros.segmenter import Segmenter


def cloud(stamp, **options):
    return Sweep(round(stamp * SECOND), np.zeros((1, 3)), **options)


def clouds(start, count, step=0.1):
    return [cloud(start + k * step) for k in range(count)]


def with_field(sweep, field):
    return replace(sweep, fields=np.zeros(len(sweep), [field]))


def ends(sweeps, config):
    """When the windows of a segmenter end that gets these clouds; an open group has no update."""
    segmenter, grouping = Segmenter(config), Grouping(config)
    groups = [group for sweep in sweeps for group in grouping.push(sweep)]
    return [segmenter.process(group).end_ns for group in groups]


def test_clouds_may_be_sent_until_too_far_ahead():
    flow = FlowControl(Config(), ahead=0.5)
    sent = 0
    for sweep in clouds(10.0, 30):
        if not flow.may_send(sweep):
            break
        flow.send(sweep)
        sent += 1
    # The first update is closed by the cloud at 11.0 s; nothing has come back since 10.0 s.
    assert sent == 11 and flow.updates == flow.outstanding == 1
    flow.acknowledge(11 * SECOND)
    assert flow.outstanding == 0
    assert flow.may_send(cloud(99.0))  # over a gap too, as nothing is outstanding


DRIVES = {
    "plain": clouds(0.0, 50),
    "gap": clouds(0.0, 25) + clouds(60.0, 25),
    "jump back": clouds(100.0, 25) + clouds(90.0, 25),
    "loop": clouds(5.0, 25) * 3,
    "frame": clouds(0.0, 25) + [replace(s, frame_id="map") for s in clouds(2.5, 25)],
    "late": [s for pair in zip(clouds(0.1, 30), clouds(0.0, 30), strict=True) for s in pair],
    "sparse": clouds(0.0, 10, step=3.3),
    "offsets": [replace(s, offsets_ns=np.array([7_000_000])) for s in clouds(0.0, 40)],
    "stamped at the end": [
        replace(s, offsets_ns=np.array([-99_000_000])) for s in clouds(5.0, 40)
    ],
    "other fields": [
        with_field(s, ("a", "f4", (2 + k // 20,))) for k, s in enumerate(clouds(0.0, 40))
    ],
    "empty": [
        s if k % 5 else Sweep(s.stamp_ns, np.zeros((0, 3))) for k, s in enumerate(clouds(1.0, 40))
    ],
}


@pytest.mark.parametrize("name", DRIVES)
@pytest.mark.parametrize("ahead", [0.001, 1.0, 5.0])
@pytest.mark.parametrize("period", [1.0, 0.5])  # of the node; the replayer reckons with 1.0
def test_no_deadlock_between_segmenter_and_replayer(name, ahead, period):
    drive = DRIVES[name]
    coming = iter(ends(drive, Config(update_period=period)))
    flow = FlowControl(Config(), ahead)
    for sweep in drive:
        while not flow.may_send(sweep):
            flow.acknowledge(next(coming))  # StopIteration: both would wait for ever
        flow.send(sweep)
    for end in coming:
        flow.acknowledge(end)
    assert flow.outstanding == 0


def test_longer_update_period_of_the_node_is_tolerated():
    drive = clouds(0.0, 100)
    coming = iter(ends(drive, Config(update_period=2.0)))
    flow = FlowControl(Config(update_period=1.0), ahead=3.0)
    for sweep in drive:
        while not flow.may_send(sweep):
            flow.acknowledge(next(coming))
        flow.send(sweep)
    for end in coming:
        flow.acknowledge(end)
    assert flow.outstanding <= 1


def test_abandoned_updates_are_not_waited_for():
    flow = FlowControl(Config(), ahead=0.1)
    for sweep in clouds(0.0, 11):
        flow.send(sweep)
    assert not flow.may_send(cloud(5.0))
    assert flow.abandon() == 1
    assert flow.may_send(cloud(5.0))
    flow.acknowledge(SECOND)  # late after all
    assert flow.outstanding == 0
