import numpy as np
import pytest

from ellipseg_ros.errors import ConfigError, InputError
from ellipseg_ros.io.bag import BagSink
from ellipseg_ros.io.sources import open_source
from ellipseg_ros.records import Sweep
from ellipseg_ros.simulation.simulator import SCENES


def a_bag(path):
    with BagSink(path) as sink:
        for k in range(3):
            points = np.random.default_rng(k).normal(size=(9, 3))
            sink.write_event(Sweep(k * 10**8, points, np.arange(9), frame_id="map"))
    return path


def a_cloud(path):
    np.savez(path, xyz=np.zeros((9, 3)), t=np.linspace(0.0, 0.29, 9))
    return path


SIMULATED = {"duration": 0.3, "seed": 4}


@pytest.fixture(params=["bag", "file of a bag", "cloud", "scene"])
def source(request, tmp_path):
    """The same length of everything that can be opened."""
    if request.param == "scene":
        return open_source("sim:woodland", **SIMULATED)
    if request.param == "cloud":
        return open_source(a_cloud(tmp_path / "drive.npz"))
    bag = a_bag(tmp_path / "drive")
    return open_source(str(bag / "drive.mcap") if "file" in request.param else bag)


def test_source_describes_itself_and_can_be_iterated_repeatedly(source):
    assert source.name in ("drive", "woodland") and source.frame_id in ("map", "odom")
    assert source.count == 3 and source.duration == pytest.approx(0.25, abs=0.06)
    first, second = list(source), list(source)
    assert len(first) == len(second) == 3
    for a, b in zip(first, second, strict=True):
        assert a.frame_id == source.frame_id
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.times_ns, b.times_ns)


def test_bag_written_from_a_source_equals_it(source, tmp_path):
    with BagSink(tmp_path / "copy") as sink:
        for sweep in source:
            sink.write_event(sweep)
    for a, b in zip(source, open_source(tmp_path / "copy"), strict=True):
        assert (a.stamp_ns, a.frame_id) == (b.stamp_ns, b.frame_id)
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.offsets_ns, b.offsets_ns)


def test_topic_is_passed_to_the_bag(tmp_path):
    bag = a_bag(tmp_path / "drive")
    assert open_source(bag, "points").count == 3
    with pytest.raises(InputError, match="/points"):
        open_source(bag, "/velodyne")


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_has_points(scene):
    assert sum(map(len, open_source(f"sim:{scene}", **SIMULATED))) > 1000


def test_unreadable_source_is_refused_with_a_list_of_formats(tmp_path):
    (tmp_path / "cloud.e57").touch()
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.ply").mkdir()
    for spec in ("missing.bag", "cloud.e57", "folder", "folder.ply"):
        with pytest.raises(InputError) as error:
            open_source(tmp_path / spec)
        text = str(error.value)
        assert spec in text and len(text.splitlines()) == 1
        assert all(kind in text for kind in (".bag", ".mcap", ".laz", "sim:", "woodland"))
    with pytest.raises(InputError, match="woodland") as error:
        open_source("sim:moon")
    assert len(str(error.value).splitlines()) == 1


def test_scene_refuses_invalid_settings():
    with pytest.raises(ConfigError, match="duration"):
        open_source("sim:woodland", duration=-1.0)
