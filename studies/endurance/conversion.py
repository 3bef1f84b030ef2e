"""Odd clouds through conversion and segmenter, which must give an update or a short error."""

import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from ellipseg_ros.config import Config, NodeConfig
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.messages import MarkerStream
from ellipseg_ros.io.pointcloud2 import read_sweep
from ellipseg_ros.node.grouping import Grouping
from ellipseg_ros.records import Segmentation, Sweep
from ellipseg_ros.segmenter import Segmenter
from studies.endurance.cloud_messages import Cloud
from studies.endurance.odd_clouds import odd_cloud
from studies.endurance.update_check import contradictions, unreadable

CASES_PER_SEGMENTER = 250
MAX_MESSAGE_LENGTH = 300  # characters of an error message
DECODED_EVERY = 10  # updates of which the messages of one are read
CONFIGS = (
    Config(window_duration=2.0, update_period=0.3),
    Config("density", window_duration=1.0, update_period=0.1, max_points=3000),
    Config("parsimony", window_duration=3.0, update_period=0.5, max_points_per_second=2000),
    Config(threshold=0.0, window_duration=0.5, update_period=1.0),
)


@dataclass
class Tally:
    """Results of odd input."""

    cases: int = 0
    rejected: Counter[str] = field(default_factory=Counter)  # by reason
    points: int = 0  # of accepted clouds
    updates: int = 0
    decoded: int = 0  # updates of which the messages were read
    restarts: int = 0
    late: int = 0  # points
    evicted: int = 0  # points
    last: Segmentation | None = None
    faults: list[str] = field(default_factory=list)  # descriptions of all that must not happen
    slowest_s: float = 0.0  # conversion of one cloud, with the update that it completes

    @property
    def accepted(self) -> int:
        """Clouds that were not rejected."""
        return self.cases - self.rejected.total()

    @contextmanager
    def case(self, name: str) -> Iterator[None]:
        """Count a case: the block accepts input, or raises InputError with a short message."""
        self.cases += 1
        try:
            yield
        except InputError as error:
            self.rejected[error.reason] += 1
            if len(str(error)) > MAX_MESSAGE_LENGTH or not str(error).isprintable():
                self.add_fault(name, f"a reason that is no short line: {error}")
        except Exception:
            self.add_fault(name, traceback.format_exc())

    def add_fault(self, name: str, fault: str) -> None:
        """Note a fault of a case."""
        self.faults.append(f"case {name}: {fault}")


class Consumer:
    """What the node does with clouds, without ROS, and checks of all results."""

    def __init__(self, config: Config, tally: Tally) -> None:
        self._config = config
        self._tally = tally
        self._start()

    def _start(self) -> None:
        self._grouping = Grouping(self._config)
        self._segmenter = Segmenter(self._config)
        self._markers = MarkerStream(NodeConfig())
        self._before: Segmentation | None = None

    def process(self, name: str, cloud: Cloud) -> None:
        """Process one message; name: of the case."""
        tally = self._tally
        faults = len(tally.faults)
        updates: list[tuple[Sweep, Segmentation]] = []
        started = time.perf_counter()
        with tally.case(name):
            sweep = read_sweep(cloud)
            groups = self._grouping.push(sweep)
            updates = [(group, self._segmenter.process(group)) for group in groups]
            tally.points += len(sweep)
        tally.slowest_s = max(tally.slowest_s, time.perf_counter() - started)
        if len(tally.faults) > faults:
            self._start()
        for group, update in updates:
            self._check(name, group, update)

    def _check(self, name: str, group: Sweep, update: Segmentation) -> None:
        tally = self._tally
        tally.updates += 1
        tally.restarts += bool(update.restart)
        tally.late += update.late
        tally.evicted += update.evicted
        tally.last = update
        before = None if update.restart else self._before
        self._before = update
        for fault in contradictions(before, group, update, self._config):
            tally.add_fault(name, fault)
        if update.sequence % DECODED_EVERY == 0:
            tally.decoded += 1
            for fault in unreadable(update, self._markers):
                tally.add_fault(name, fault)


def convert(seed: int, cases: Iterable[int]) -> Tally:
    """Process the odd clouds of these cases; warnings count as faults."""
    tally = Tally()
    consumer = Consumer(CONFIGS[0], tally)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number, case in enumerate(cases):
            if number % CASES_PER_SEGMENTER == 0:
                index = number // CASES_PER_SEGMENTER
                consumer = Consumer(CONFIGS[index % len(CONFIGS)], tally)
            consumer.process(str(case), odd_cloud(seed, case))
    return tally
