"""Sources cut into windows, and one threshold for many of them."""

import numpy as np
import pytest
from clouds import SECOND, street

from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.records import Sweep
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.tuning.choice import choose
from ellipseg_ros.tuning.curve import Curve
from ellipseg_ros.tuning.search import Search
from ellipseg_ros.tuning.tasks import Task, run, run_single_threaded
from ellipseg_ros.tuning.windows import windows

WINDOW = Config(window_duration=2.0)


def drive(seconds, start=100.0, frame_id="odom"):
    """Ten sweeps a second; x of every point is its time."""
    for number in range(round(10 * seconds)):
        stamp = round((start + 0.1 * number) * SECOND)
        points = np.tile([stamp / SECOND, 0.0, 0.0], (3, 1))
        yield Sweep(stamp, points, frame_id=frame_id)


def spans(cuts):
    return [(round(cut.start_s, 6), round(cut.end_s, 6)) for cut in cuts]


def test_windows_lie_end_to_end():
    cuts = list(windows("a", drive(6.2), WINDOW))
    assert spans(cuts) == [(0.1, 2.0), (2.1, 4.0), (4.1, 6.0)]
    assert [cut.number for cut in cuts] == [0, 1, 2]
    assert [len(cut.points) for cut in cuts] == [60, 60, 60]  # none holds points of another
    assert cuts[1].points[:, 0].min() == pytest.approx(102.1)


def test_remainder_of_half_a_step_is_a_window():
    assert spans(windows("a", drive(3.2), WINDOW))[1:] == [(1.2, 3.1)]
    assert len(spans(windows("a", drive(2.9), WINDOW))) == 1


def test_windows_may_overlap_or_leave_gaps():
    assert spans(windows("a", drive(4.1), WINDOW, every=1.0)) == [
        (0.0, 1.0),
        (0.1, 2.0),
        (1.1, 3.0),
        (2.1, 4.0),
    ]
    assert spans(windows("a", drive(6.1), WINDOW, every=3.0)) == [(1.1, 3.0), (4.1, 6.0)]


def test_short_source_is_one_window():
    (cut,) = windows("a", [Sweep(0, street(50, np.random.default_rng(0)))], WINDOW)
    assert len(cut.points) == 50 and (cut.start_s, cut.end_s) == (0.0, 0.0)


def test_a_restart_begins_a_new_window():
    sweeps = [*drive(2.5), *drive(2.5, start=200.0, frame_id="map")]
    cuts = list(windows("a", sweeps, WINDOW))
    assert [round(cut.points[0, 0], 6) for cut in cuts] == [100.1, 200.1]


def test_window_holds_the_accepted_points_of_the_segmenter():
    config = Config(window_duration=1.0, update_period=0.5, max_points_per_second=200)
    rng = np.random.default_rng(1)
    sweeps = [Sweep(k * SECOND // 10, street(60, rng)) for k in range(16)]
    sweeps[3].points[:5] = np.nan
    segmenter = Segmenter(config)
    found = [segmenter.process(group) for group in updates(sweeps, config)]
    for cut, update in zip(windows("a", sweeps, config, every=0.5), found, strict=True):
        np.testing.assert_array_equal(cut.points, update.points[update.labels >= -1])
        np.testing.assert_array_equal(cut.origin, update.origin)


# --- tasks -----------------------------------------------------------------------------------


def task(seed=0, **changes):
    (cut,) = windows("a", [Sweep(0, street(300, np.random.default_rng(seed)))], WINDOW)
    made = {"config": WINDOW, "criteria": ("shape", "density"), "search": Search(count=5)}
    return Task(cut, **(made | changes))


def test_task_result_does_not_depend_on_cores():
    one, other = run(task()), run_single_threaded(task())
    assert {k: c.as_dict() for k, c in one.items()} == {k: c.as_dict() for k, c in other.items()}
    assert list(one) == ["shape", "density"]


def test_task_key_depends_on_its_content():
    assert task().key == task().key
    others = [
        task(seed=1),
        task(config=Config(window_duration=2.0, threshold=5.0)),
        task(criteria=("shape",)),
        task(search=Search(count=6)),
    ]
    assert len({task().key, *(other.key for other in others)}) == 5


def test_given_threshold_applies_to_its_criterion_only():
    found = run(task(config=Config(window_duration=2.0, threshold=5.5)))
    assert 5.5 in found["shape"].threshold
    assert 5.5 not in found["density"].threshold
    assert CRITERIA["density"].default_threshold in found["density"].threshold


# --- one threshold for many ------------------------------------------------------------------


def parabola(middle, gain=100.0, points=10):
    """A curve with its minimum at `middle`, a power of ten."""
    threshold = 10.0 ** np.arange(-2.0, 3.0)
    aicc = gain * (0.1 * (np.log10(threshold) - np.log10(middle)) ** 2 - 1.0)
    count = np.arange(5, 0, -1)
    return Curve("shape", points, 0.0, threshold, aicc, 0.0 * aicc, count)


def test_choice_has_the_least_mean_loss():
    curves = [parabola(0.1), parabola(1.0), parabola(10.0, gain=1e6, points=10**6)]
    found = choose(curves, present=100.0)
    assert found.threshold == 1.0 and found.windows == 3
    assert found.mean_loss == pytest.approx(0.2 / 3) and found.worst_loss == pytest.approx(0.1)
    assert found.present_worst_loss == pytest.approx(0.9)
    assert (found.lowest_minimum, found.median_minimum, found.highest_minimum) == (0.1, 1.0, 10.0)
    assert not found.at_end


def test_choice_interpolates_losses_between_thresholds():
    finer = parabola(1.0)
    rows = [0, 2, 4]
    coarse = Curve(
        "shape",
        10,
        0.0,
        *(getattr(finer, name)[rows] for name in ("threshold", "aicc", "bias", "count")),
    )
    assert choose([coarse, parabola(0.1), parabola(0.1)], 1.0).threshold == 0.1


def test_minimum_at_an_end_is_reported():
    assert choose([parabola(1.0), parabola(100.0)], 1.0).at_end
