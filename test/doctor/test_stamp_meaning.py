"""The meaning of an odometry's stamps is found from the agreement of neighbouring sweeps."""

import numpy as np
import pytest
import raw_rooms
from raw_rooms import Motion

from ellipseg_ros.config import PlacementConfig
from ellipseg_ros.doctor.findings import OK, WARN
from ellipseg_ros.doctor.recording import check_recording
from ellipseg_ros.doctor.stamp_meaning import compare_stamps, disagreement
from ellipseg_ros.io.sources import Source

SWEEPS = 20
CONFIG = PlacementConfig(pose_source="odometry")


def events(stamp, motion):
    """Poses first, as their stamps do not say when they were published."""
    clouds = raw_rooms.clouds(SWEEPS, points=1500, motion=motion)
    return [*raw_rooms.odometry(SWEEPS, stamp, motion), *clouds]


@pytest.mark.parametrize(
    ("stamp", "best"), [("exact", "exact"), ("scan_end", "exact"), ("scan_begin", "scan_begin")]
)
def test_true_meaning_is_recommended_at_12_m_and_30_deg_per_second(stamp, best):
    found = compare_stamps(events(stamp, Motion(12.0, 30.0)), SWEEPS, CONFIG)
    (wrong,) = {"exact", "scan_begin"} - {best}
    assert found.best == best
    assert found.scores[best] < 0.05  # m; the noise is 0.01, poses may be 0.1 s apart
    assert found.scores[wrong] > 0.3


def test_straight_drive_shows_no_difference():
    found = compare_stamps(events("scan_begin", Motion(12.0, 0.0)), SWEEPS, CONFIG)
    assert found.best == "" and found.pairs > 10


def test_disagreement_is_the_offset_of_a_plane():
    rng = np.random.default_rng(3)
    plane = np.column_stack([rng.uniform(0.0, 10.0, (2, 4000)).T, np.zeros(4000)])
    lifted = plane[:500] + [0.0, 0.0, 0.25]
    assert disagreement(lifted, plane) == pytest.approx(0.25, abs=1e-9)
    assert disagreement(lifted, plane[:5]) is None
    assert disagreement(lifted + 50.0, plane) is None
    line = plane * [1.0, 1e-4, 1.0]
    assert disagreement(lifted, line) is None


def source(stamp, present):
    placement = PlacementConfig(pose_source="odometry", odometry_stamp=present)
    found = events(stamp, Motion())
    return Source("drive", "odom", SWEEPS, 2.0, found, placement, "the topic /odom")


@pytest.mark.parametrize(
    ("stamp", "present", "level", "text"),
    [
        ("exact", "exact", OK, "odometry_stamp exact is right"),
        ("scan_begin", "exact", WARN, "--set odometry_stamp=scan_begin"),
        ("scan_end", "scan_begin", WARN, "--set odometry_stamp=exact"),
    ],
)
def test_recording_is_reported_with_scores_and_recommendation(stamp, present, level, text):
    times, poses, placed, *_, stamps = check_recording(source(stamp, present))
    assert "times of points: t [ns] from the stamp, over" in times.text
    assert "frame 'lidar'; poses: the topic /odom" in poses.text
    assert placed.text.endswith("clouds are placed")
    assert stamps.level == level and text in f"{stamps.text} {stamps.remedy}"
    assert "mm as exact or scan_end" in stamps.text and "mm as scan_begin" in stamps.text


def test_registered_recording_needs_no_poses():
    clouds = raw_rooms.clouds(2, frame_id="odom")
    registered = Source("drive", "odom", 2, 0.1, clouds)
    assert [f.level for f in check_recording(registered)] == [OK, OK]
    raw = Source("drive", "lidar", 2, 0.1, raw_rooms.clouds(2))
    assert [f.level for f in check_recording(raw)] == [OK, WARN]
