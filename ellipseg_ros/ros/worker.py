"""The work of the thread that segments, so that the reception of clouds never waits for it."""

import time
from dataclasses import dataclass

from rclpy.impl.rcutils_logger import RcutilsLogger

from ellipseg_ros.config import Config
from ellipseg_ros.errors import InputError
from ellipseg_ros.node.backlog import Backlog, Resend, Reset, Task, Update
from ellipseg_ros.node.health import Health
from ellipseg_ros.ros.limits import Quota, throttled
from ellipseg_ros.ros.outputs import Outputs
from ellipseg_ros.ros.tuner import Tuner
from ellipseg_ros.segmenter import Segmenter

RESTART_LOG_QUOTA = (10, 60.0)  # log lines within s; /diagnostics count all restarts
IDLE_TIMEOUT_S = 4.0  # without a task, before all markers are sent again: they live 10 s


@dataclass
class Worker:
    """Processes the tasks of the backlog: segments, and publishes the result."""

    config: Config
    backlog: Backlog
    outputs: Outputs
    health: Health
    tuner: Tuner
    log: RcutilsLogger

    def __post_init__(self) -> None:
        self._segmenter = Segmenter(self.config)
        self._restart_quota = Quota(*RESTART_LOG_QUOTA)

    def run(self) -> None:
        """Work until the backlog is closed."""
        while not self.backlog.closed:
            task = self.backlog.get(timeout=IDLE_TIMEOUT_S)
            with self.health.work():
                self._process(task)

    def _process(self, task: Task | None) -> None:
        if isinstance(task, Update):
            self._update(task)
        elif isinstance(task, Reset):
            self._reset(task.reason)
        elif isinstance(task, Resend):
            self.outputs.resend(task.topic)
        elif not self.backlog.closed:
            self.outputs.refresh_markers()

    def _update(self, task: Update) -> None:
        started = time.monotonic()
        try:
            if task.config != self.config:
                self._segmenter.configure(task.config, task.threshold_change)
                self.config = task.config
            segmentation = self._segmenter.process(task.sweep)
            processed = time.monotonic()
            if self.backlog.closed:
                return
            if segmentation.restart and self._restart_quota.take():
                self.log.warning(f"the window restarts: {segmentation.restart}")
            self.outputs.publish(segmentation, task.node_config)
        except InputError as error:
            self.health.rejected(error.reason, group=True)
            self.log.warning(f"clouds rejected: {error}", **throttled())
            self._reset(str(error))
            return
        self.tuner.observe(segmentation, task.config, task.node_config.auto_tune_period)
        self.health.updated(
            segmentation,
            processing=processed - started,
            latency=time.monotonic() - task.arrival,
            period=task.config.update_period,
        )

    def _reset(self, reason: str) -> None:
        self._segmenter.reset(reason)
        self.tuner.reset()
        self.outputs.clear()
