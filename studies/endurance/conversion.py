"""Odd clouds through the conversion and the segmenter: an update or a reason, and no more."""

import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.messages import MarkerStream
from ellipseg_ros.io.pointcloud2 import read_sweep
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.records import Segmentation, Sweep
from ellipseg_ros.segmenter import Segmenter
from studies.endurance.clouds import Cloud, odd_cloud
from studies.endurance.update_account import faults, unreadable

STREAM = 250  # cases that one segmenter gets
LONGEST = 300  # characters of a reason
READ_BACK = 10  # one update of so many is decoded
CONFIGS = (
    Config(window_duration=2.0, update_period=0.3),
    Config("density", window_duration=1.0, update_period=0.1, max_points=3000),
    Config("parsimony", window_duration=3.0, update_period=0.5, max_points_per_second=2000),
    Config(threshold=0.0, window_duration=0.5, update_period=1.0),
)


@dataclass
class Tally:
    """What came of some clouds."""

    cases: int = 0
    rejected: Counter[str] = field(default_factory=Counter)  # by reason
    points: int = 0  # of the clouds that were accepted
    updates: int = 0
    decoded: int = 0  # updates of which the messages were read back
    restarts: int = 0
    late: int = 0  # points
    evicted: int = 0  # points
    last: Segmentation | None = None
    faults: list[str] = field(default_factory=list)  # whatever must not be, in words
    slowest: float = 0.0  # s, the conversion, and what update it closes, of one cloud

    @property
    def accepted(self) -> int:
        """Clouds."""
        return self.cases - self.rejected.total()


class Consumer:
    """What the node does with clouds, but without it; and a look at everything that comes out."""

    def __init__(self, config: Config, tally: Tally) -> None:
        self._config = config
        self._tally = tally
        self._begin()

    def _begin(self) -> None:
        self._grouping = Grouping(self._config)
        self._segmenter = Segmenter(self._config)
        self._markers = MarkerStream(NodeConfig())
        self._before: Segmentation | None = None

    def take(self, name: str, cloud: Cloud) -> None:
        """One message."""
        started = time.perf_counter()
        self._tally.cases += 1
        try:
            sweep = read_sweep(cloud)
            groups = self._grouping.push(sweep)
            updates = [(group, self._segmenter.process(group)) for group in groups]
        except InputError as error:
            self._tally.rejected[error.reason] += 1
            if len(str(error)) > LONGEST or not str(error).isprintable():
                self._complain(name, f"a reason that is no short line: {error}")
            return
        except Exception:
            self._complain(name, traceback.format_exc())
            self._begin()
            return
        finally:
            self._tally.slowest = max(self._tally.slowest, time.perf_counter() - started)
        self._tally.points += len(sweep)
        for group, found in updates:
            self._look_at(name, group, found)

    def _look_at(self, name: str, group: Sweep, found: Segmentation) -> None:
        tally = self._tally
        tally.updates += 1
        tally.restarts += bool(found.restart)
        tally.late += found.late
        tally.evicted += found.evicted
        tally.last = found
        before = None if found.restart else self._before
        self._before = found
        for fault in faults(before, group, found, self._config):
            self._complain(name, fault)
        if found.sequence % READ_BACK == 0:
            tally.decoded += 1
            for fault in unreadable(found, self._markers):
                self._complain(name, fault)

    def _complain(self, name: str, fault: str) -> None:
        self._tally.faults.append(f"case {name}: {fault}")


def convert(seed: int, cases: Iterable[int]) -> Tally:
    """Give the clouds of these cases to what the node consists of; a warning is a fault, too."""
    tally = Tally()
    consumer = Consumer(CONFIGS[0], tally)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number, case in enumerate(cases):
            if number % STREAM == 0:
                consumer = Consumer(CONFIGS[number // STREAM % len(CONFIGS)], tally)
            consumer.take(str(case), odd_cloud(seed, case))
    return tally
