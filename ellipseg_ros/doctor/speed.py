"""Speed of the segmentation on this machine, in points per second."""

import time

from ellipseg_ros.config import Config
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import simulate

SCENE = "mixed"
DRIVE_S = 9.0  # of simulated driving
WINDOW_S = 5.0  # shorter than the default, so that it is full after five updates
TIME_LIMIT_S = 15.0  # after which no further update is begun


def measure_speed() -> float:
    """Points per second that the segmenter processes in a simulated drive.

    Only updates with a full window count, if there are any within TIME_LIMIT_S. Kernels should be
    compiled (`warm_up`) before.
    """
    config = Config(window_duration=WINDOW_S)
    segmenter = Segmenter(config)
    started = time.perf_counter()
    speeds = []
    for sweep in updates(simulate(SCENE, duration=DRIVE_S), config):
        before = time.perf_counter()
        segmenter.process(sweep)
        after = time.perf_counter()
        speeds.append((len(sweep), after - before))
        if after - started > TIME_LIMIT_S:
            break
    full = speeds[int(WINDOW_S / config.update_period) :] or speeds[-1:]
    return sum(points for points, _ in full) / sum(seconds for _, seconds in full)
