"""Drives with odd stamps, and detection of a node that processes or reports them wrongly."""

import pytest

from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from studies.endurance.stamps import (
    CLOUDS,
    PARTS,
    Record,
    differences,
    misreported,
    offline,
    random_drive,
)

GAPS = 4


@pytest.fixture(scope="module")
def updates():
    return offline(random_drive(0))


@pytest.fixture
def record(updates):
    """What a correct node publishes, reports and logs."""
    reasons = [update.restart for update in updates if update.restart]
    return Record(
        {
            "/segments": [bytes(write_segments(update)) for update in updates],
            "/segmented_points": [bytes(write_labelled(update)) for update in updates],
        },
        {"restarts": str(len(reasons)), "stamp gaps": str(GAPS), "clouds rejected": "0"},
        "".join(f"[WARN] the window restarts: {reason}\n" for reason in reasons),
    )


def test_a_correct_node_has_no_differences(record, updates):
    assert differences(record, updates) == 0
    assert misreported(record, updates, GAPS) == []


def test_a_changed_byte_and_a_missing_message_are_differences(record, updates):
    cloud = record.messages["/segmented_points"]
    cloud[3] = cloud[3][:200] + bytes([cloud[3][200] ^ 1]) + cloud[3][201:]
    assert differences(record, updates) == 1
    cloud.pop()
    assert differences(record, updates) == len(updates)


def test_wrong_counts_and_log_lines_are_reported(record, updates):
    record.report["restarts"] = "0"
    record.log += "the window restarts: again\n"
    count = sum(bool(update.restart) for update in updates)
    assert misreported(record, updates, GAPS) == [
        f"restarts 0, not {count}",
        f"{count + 1} restarts in the log",
    ]


def test_drives_differ_by_seed_only():
    def stamps(seed):
        return [(sweep.stamp_ns, sweep.frame_id) for sweep in random_drive(seed)]

    drive = stamps(1)
    assert drive == stamps(1) != stamps(2)
    assert len(drive) == CLOUDS * (len(PARTS) + 1) + 2 * CLOUDS  # one part has three per cloud
