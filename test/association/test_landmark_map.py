"""Map of expired landmarks, and its file."""

import zipfile
from dataclasses import replace

import numpy as np
import pytest
import worlds

from ellipseg_ros.association.landmark_map import (
    ROW_SHAPES,
    LandmarkMap,
    StoredMap,
    no_landmarks,
    select_landmarks,
)
from ellipseg_ros.config import MapConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io import map_file
from ellipseg_ros.io.map_file import read_map, write_map
from ellipseg_ros.records import SECOND

CONFIG = MapConfig(min_age=2.0, delay=10.0, max_instability=3.0)


def world(seed=0, **changes):
    return replace(worlds.world(np.random.default_rng(seed)), **changes)


def filled(config=CONFIG):
    """A map of a whole world that expired at 5 s."""
    found = LandmarkMap(config)
    found.update(world(), 5 * SECOND, "odom", 5)
    found.update(no_landmarks(), 6 * SECOND, "odom", 6)
    return found


def same(one, other):
    for name in ROW_SHAPES:
        np.testing.assert_array_equal(getattr(one.landmarks, name), getattr(other.landmarks, name))
    np.testing.assert_array_equal(one.last_seen_ns, other.last_seen_ns)
    assert (one.frame_id, one.next_id) == (other.frame_id, other.next_id)


def test_expired_landmarks_are_stored_with_map_id_and_last_stamp():
    found, live = LandmarkMap(CONFIG), world()
    found.update(live, 5 * SECOND, "odom", 5)
    assert not len(found.stored)
    found.update(select_landmarks(live, slice(10, None)), 6 * SECOND, "odom", 6)
    assert found.stored.landmarks.ids.tolist() == list(range(1, 11))
    assert set(found.stored.last_seen_ns) == {5 * SECOND}
    np.testing.assert_array_equal(found.stored.landmarks.position, live.position[:10])
    found.update(select_landmarks(live, slice(12, None)), 7 * SECOND, "odom", 7)
    assert found.stored.landmarks.ids.tolist() == list(range(1, 13))


def test_only_stable_and_old_landmarks_are_stored():
    n = len(world())
    instability, first = np.zeros(n), np.zeros(n, np.int64)
    instability[3], first[4] = 3.1, 4 * SECOND
    found = LandmarkMap(CONFIG)
    found.update(world(instability=instability, first_seen_ns=first), 5 * SECOND, "odom", 5)
    found.update(no_landmarks(), 6 * SECOND, "odom", 6)
    assert len(found.stored) == n - 2


def test_recognized_landmarks_are_not_stored_again():
    found = filled()
    n = len(found.stored)
    found.update(world(1), 20 * SECOND, "odom", 20)
    found.mark_recognized(np.array([2, 3], np.uint32))
    found.update(world(1), 21 * SECOND, "odom", 21)
    found.update(no_landmarks(), 22 * SECOND, "odom", 22)
    assert len(found.stored) == 2 * n - 2


def test_landmarks_are_recognizable_after_the_delay():
    found = filled()
    found.update(no_landmarks(), 14 * SECOND, "odom", 14)
    assert not len(found.recognizable())
    found.update(no_landmarks(), 15 * SECOND, "odom", 15)
    assert len(found.recognizable()) == len(found.stored) > 0


def test_a_full_map_drops_the_oldest_and_ids_go_on():
    found = filled(replace(CONFIG, max_landmarks=5))
    n = len(world())
    assert found.stored.landmarks.ids.tolist() == list(range(n - 4, n + 1))
    found.clear()
    assert not len(found.stored) and found.stored.next_id == n + 1


def test_a_time_jump_back_expires_all_live_landmarks():
    found = LandmarkMap(CONFIG)
    found.update(world(), 50 * SECOND, "odom", 50)
    found.update(world(1), 1 * SECOND, "odom", 1)  # of another run, with the same ids
    assert len(found.stored) == len(world()) == len(found.recognizable())


def first_seen(second, seed=0):
    """A world whose landmarks were seen first at a time."""
    return world(seed, first_seen_ns=np.full(len(world()), second * SECOND))


@pytest.mark.parametrize(
    ("again", "number"),
    [
        (first_seen(0, 1), 0),  # sequence numbers start over
        (first_seen(52, 1), 51),  # they continue: the first updates were lost
    ],
)
def test_a_restart_of_the_segmenter_expires_all_live_landmarks(again, number):
    found, before = LandmarkMap(CONFIG), first_seen(0)
    found.update(before, 50 * SECOND, "odom", 50)
    found.update(again, 60 * SECOND, "odom", number)  # the ids are the same
    np.testing.assert_array_equal(found.stored.landmarks.position, before.position)
    found.update(again, 61 * SECOND, "odom", number + 1)
    assert len(found.stored) == len(before)


def test_a_repeated_update_changes_nothing():
    found = LandmarkMap(CONFIG)
    for _ in range(2):
        found.update(world(), 50 * SECOND, "odom", 50)
    assert not len(found.stored)


@pytest.mark.parametrize(("stamp", "number"), [(20, 51), (60, 0)])
def test_recognition_before_a_restart_has_no_effect_after_it(stamp, number):
    found = LandmarkMap(CONFIG)
    found.update(world(), 50 * SECOND, "odom", 50)
    found.mark_recognized(world().ids)
    found.update(world(1), stamp * SECOND, "odom", number)
    assert not len(found.stored)
    found.update(no_landmarks(), (stamp + 1) * SECOND, "odom", number + 1)
    np.testing.assert_array_equal(found.stored.landmarks.position, world(1).position)


def test_an_empty_map_has_no_frame():
    found = LandmarkMap(CONFIG)
    found.update(no_landmarks(), 1 * SECOND, "elsewhere", 1)
    found.update(world(1), 2 * SECOND, "elsewhere", 2)
    found.update(world(), 5 * SECOND, "odom", 3)  # the landmarks of the other frame are forgotten
    assert not len(found.stored)
    found.update(no_landmarks(), 6 * SECOND, "odom", 4)
    assert found.stored.frame_id == "odom"
    np.testing.assert_array_equal(found.stored.landmarks.position, world().position)


def test_a_cleared_map_takes_another_frame():
    found = filled()
    found.update(world(), 7 * SECOND, "odom", 7)
    found.clear()
    assert found.stored.frame_id == ""
    found.update(world(1), 8 * SECOND, "map", 8)
    found.update(no_landmarks(), 9 * SECOND, "map", 9)
    assert found.stored.frame_id == "map"
    np.testing.assert_array_equal(found.stored.landmarks.position, world(1).position)


def test_loading_a_map_in_another_frame_is_refused():
    found = LandmarkMap(CONFIG)
    found.update(world(), 5 * SECOND, "odom", 5)
    with pytest.raises(InputError, match="in frame map; the map is in odom"):
        found.load(replace(filled().stored, frame_id="map"))


def test_landmarks_in_another_frame_are_refused():
    found = filled()
    with pytest.raises(InputError, match="in frame map; the map is in odom"):
        found.update(world(), 7 * SECOND, "map", 7)
    with pytest.raises(InputError, match="in frame map; the map is in odom"):
        found.load(StoredMap(no_landmarks(), np.zeros(0, np.int64), "map", 1))


def test_a_map_file_round_trip_is_exact(tmp_path):
    path = tmp_path / "map.npz"
    stored = filled().stored
    write_map(path, stored)
    same(read_map(path), stored)
    write_map(path, replace(stored, frame_id="elsewhere"))  # over the old one
    assert read_map(path).frame_id == "elsewhere"
    assert [p.name for p in tmp_path.iterdir()] == ["map.npz"]
    empty = StoredMap(no_landmarks(), np.zeros(0, np.int64), "", 1)
    write_map(path, empty)
    same(read_map(path), empty)


def spoil(path, **changes):
    """Write a map with some arrays replaced, None to leave one out."""
    write_map(path, filled().stored)
    with np.load(path) as file:
        values = dict(file) | changes
    np.savez(path, **{name: value for name, value in values.items() if value is not None})


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"version": 2}, "version 2; this program reads 1"),
        ({"format": "something else"}, "its format is another"),
        ({"axes": None}, "it has no axes"),
        ({"position": np.zeros((3, 3))}, "position is float64 of shape"),
        ({"kind": np.full(53, 3, np.uint8)}, "kind is 3"),
        ({"kind": np.zeros(53, np.int64)}, "kind is int64"),
        ({"sigma": np.full((53, 3), np.nan)}, "not finite"),
        ({"axes": np.ones((53, 3, 3))}, "no rotation"),
        ({"ids": np.ones(53, np.uint32)}, "must ascend"),
        ({"ids": np.uint32(1)}, "ids must be a row"),
        ({"next_id": 3}, "below its next id"),
        ({"next_id": "many"}, "next_id an integer"),
        ({"last_seen_ns": np.zeros(2, np.int64)}, "2 times for 53"),
        ({"last_seen_ns": np.zeros(53)}, "a row of int64"),
        ({"frame_id": np.array([{}], object)}, "no map of landmarks"),  # a pickle
    ],
)
def test_invalid_map_files_are_refused_in_one_line(tmp_path, changes, why):
    path = tmp_path / "map.npz"
    spoil(path, **changes)
    with pytest.raises(InputError, match=why) as caught:
        read_map(path)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_files_of_other_formats_are_refused_in_one_line(tmp_path):
    path = tmp_path / "map.npz"
    for content in (b"", b"no archive", b"PK\x03\x04 and then nothing"):
        path.write_bytes(content)
        with pytest.raises(InputError, match="no map of landmarks"):
            read_map(path)
    with pytest.raises(InputError, match="there is no file"):
        read_map(tmp_path / "nowhere.npz")
    with pytest.raises(InputError, match="can't be written"):
        write_map(tmp_path / "nowhere" / "map.npz", filled().stored)


def test_a_decompression_bomb_is_refused_unread(tmp_path, monkeypatch):
    path = tmp_path / "map.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("position.npy", bytes(2_000_000))
    monkeypatch.setattr(map_file, "MAX_UNPACKED_BYTES", 1_000_000)
    with pytest.raises(InputError, match="unpacks to 2000000 bytes"):
        read_map(path)
