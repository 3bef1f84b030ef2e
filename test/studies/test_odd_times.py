"""The trial of stamps tells what is wrong."""

import pytest

from ellipseg_ros.io.messages import write_segments
from ellipseg_ros.io.pointcloud2 import write_labelled
from studies.endurance.times import (
    CLOUDS,
    PARTS,
    Notes,
    differences,
    misreported,
    offline,
    random_drive,
)

GAPS = 4


@pytest.fixture(scope="module")
def found():
    return offline(random_drive(0))


@pytest.fixture
def notes(found):
    """What a faultless node says."""
    reasons = [one.restart for one in found if one.restart]
    return Notes(
        {
            "/segments": [bytes(write_segments(one)) for one in found],
            "/segmented_points": [bytes(write_labelled(one)) for one in found],
        },
        {
            "restarts": str(len(reasons)),
            "stamp gaps": str(GAPS),
            "clouds rejected": "0",
        },
        "".join(f"[WARN] the window restarts: {reason}\n" for reason in reasons),
    )


def test_nothing_is_told_of_a_faultless_node(notes, found):
    assert differences(notes, found) == 0
    assert misreported(notes, found, GAPS) == []


def test_a_changed_byte_and_a_lost_message_are_told(notes, found):
    cloud = notes.messages["/segmented_points"]
    cloud[3] = cloud[3][:200] + bytes([cloud[3][200] ^ 1]) + cloud[3][201:]
    assert differences(notes, found) == 1
    cloud.pop()
    assert differences(notes, found) == len(found)


def test_wrong_counts_and_lines_are_told(notes, found):
    notes.said["restarts"] = "0"
    notes.log += "the window restarts: again\n"
    count = sum(bool(one.restart) for one in found)
    assert misreported(notes, found, GAPS) == [
        f"restarts 0, not {count}",
        f"{count + 1} restarts in the log",
    ]


def test_drives_differ_and_are_the_same_again():
    def stamps(seed):
        return [(sweep.stamp_ns, sweep.frame_id) for sweep in random_drive(seed)]

    one = stamps(1)
    assert one == stamps(1) != stamps(2)
    assert len(one) == CLOUDS * (len(PARTS) + 1) + 2 * CLOUDS  # one part comes in thirds
