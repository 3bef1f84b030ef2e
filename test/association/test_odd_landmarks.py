"""Nonsense in landmarks and in lists of segments: refused, or harmless."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import worlds

from ellipseg_ros.association import constants
from ellipseg_ros.association.associate import associate
from ellipseg_ros.association.landmark_map import LandmarkMap, check_landmarks, no_landmarks
from ellipseg_ros.config import MapConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io import landmark_messages
from ellipseg_ros.io.landmark_messages import read_landmarks
from ellipseg_ros.io.segment_mirror import SegmentMirror
from ellipseg_ros.records import SECOND, Kind
from studies.endurance import odd_landmarks
from studies.endurance.odd_landmarks import associate_odd_landmarks, mirror_odd_segments


@pytest.fixture(scope="module")
def good():
    return read_landmarks(odd_landmarks.odd_landmarks(0, 0))


@pytest.mark.parametrize("seed", [1, 2])  # the first world of 2 is vast
def test_odd_landmarks_are_associated_or_refused_in_a_short_line(seed):
    tally = associate_odd_landmarks(seed, 60)
    assert not tally.faults
    assert tally.updates > 15 and len(tally.rejected) >= 3


def test_distant_and_uncertain_landmarks_are_associated():
    """The prior is lost to rounding beside the information of a landmark 1e8 m away."""
    places = [[-1e8, 1e8, 1e8], [1e8, 1e8, -1e8]]
    covariance = np.diag([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]) * np.array([[[1e-7]], [[1e10]]])
    far = worlds.landmarks(
        [Kind.BLOB] * 2, places, np.tile(np.eye(3), (2, 1, 1)), np.ones((2, 3)), covariance
    )
    stored = LandmarkMap(MapConfig())
    for number, live in enumerate((far, no_landmarks(), far)):
        stored.update(live, (100, 101, 200)[number] * SECOND, "odom", number)
    known = stored.recognizable().landmarks
    assert len(known) == 2
    found = associate(known, far)
    variances = np.linalg.eigvalsh(found.covariance)
    assert variances.min() >= 0.0 and variances.max() < 20.0  # at most those of the bounds


def test_a_synchronised_mirror_holds_all_points():
    tally = mirror_odd_segments(1, 500)
    assert not tally.faults
    assert 20 < tally.updates < tally.cases


def test_an_invalid_association_is_a_fault(monkeypatch):
    def wrong(*_):
        found = associate(*_)
        return replace(found, covariance=found.covariance * np.nan)

    monkeypatch.setattr(odd_landmarks, "associate", wrong)
    assert "covariance of the association" in associate_odd_landmarks(0, 10).faults[0]


def altered(column, value, place):
    """A copy of an array with another value somewhere."""
    changed = column.copy()
    changed[place] = value
    return changed


@pytest.mark.parametrize(
    ("name", "value", "place", "why"),
    [
        ("position", 1e9, (0, 0), "beyond"),
        ("box_min", 5.0, (1, 2), "box_min above box_max"),
        ("sigma", -1.0, (0, 1), "below 0"),
        ("covariance", 1e30, (0, 0, 0), "beyond"),
        ("covariance", 1e13, (0, 0, 0), "beyond"),
        ("covariance", 1.0, (2, 0, 1), "not symmetric"),
        ("covariance", -1.0, (2, 0, 0), "below 0"),
    ],
)
def test_impossible_values_are_refused(good, name, value, place, why):
    check_landmarks(good)
    with pytest.raises(InputError, match=why):
        check_landmarks(replace(good, **{name: altered(getattr(good, name), value, place)}))


def test_too_many_landmarks_are_refused_unread(monkeypatch):
    monkeypatch.setattr(landmark_messages, "MAX_LANDMARKS", 10)
    with pytest.raises(InputError) as error:
        read_landmarks(SimpleNamespace(landmarks=[None] * 11))
    assert error.value.reason == "many"


def test_too_many_candidates_are_refused_before_they_are_made(good, monkeypatch):
    assert len(associate(good, good)) > 5
    monkeypatch.setattr(constants, "MAX_CANDIDATES", 5)
    with pytest.raises(InputError, match="more than 5 pairs"):
        associate(good, good)


def full(counts, segmented):
    rows = [SimpleNamespace(id=k + 1, count=n, state=0) for k, n in enumerate(counts)]
    return SimpleNamespace(
        sequence=0, full=True, segments=rows, objects=[], removed=[], segmented=segmented
    )


def test_an_inconsistent_full_list_is_rejected():
    assert SegmentMirror().update(full([3, 4], 7))
    assert SegmentMirror().update(full([], 0))
    assert not SegmentMirror().update(full([3, 4], 8))
    assert not SegmentMirror().update(full([7, 0], 7))  # a segment has points


def test_a_repeated_message_with_other_counts_is_rejected():
    mirror = SegmentMirror()
    assert mirror.update(full([3, 4], 7))
    same = SimpleNamespace(**(vars(full([], 7)) | {"full": False}))
    assert mirror.update(same)
    same.segmented = 8
    assert not mirror.update(same)
