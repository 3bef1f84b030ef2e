"""The work of the thread that segments, so that the reception of clouds never waits for it."""

import time

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


class Worker:
    """Processes the tasks of the backlog: segments, and publishes the result."""

    def __init__(
        self,
        config: Config,
        backlog: Backlog,
        outputs: Outputs,
        health: Health,
        tuner: Tuner,
        log: RcutilsLogger,
    ) -> None:
        self._config = config
        self._backlog = backlog
        self._outputs = outputs
        self._health = health
        self._tuner = tuner
        self._log = log
        self._segmenter = Segmenter(config)
        self._restart_quota = Quota(*RESTART_LOG_QUOTA)

    def run(self) -> None:
        """Work until the backlog is closed."""
        while not self._backlog.closed:
            task = self._backlog.get(timeout=IDLE_TIMEOUT_S)
            with self._health.work():
                self._process(task)

    def _process(self, task: Task | None) -> None:
        if isinstance(task, Update):
            self._update(task)
        elif isinstance(task, Reset):
            self._reset(task.reason)
        elif isinstance(task, Resend):
            self._outputs.resend(task.topic)
        elif not self._backlog.closed:
            self._outputs.refresh_markers()

    def _update(self, task: Update) -> None:
        started = time.monotonic()
        try:
            if task.config != self._config:
                self._segmenter.configure(task.config, task.threshold_change)
                self._config = task.config
            segmentation = self._segmenter.process(task.sweep)
            processed = time.monotonic()
            if self._backlog.closed:
                return
            if segmentation.restart and self._restart_quota.take():
                self._log.warning(f"the window restarts: {segmentation.restart}")
            self._outputs.publish(segmentation, task.node_config)
        except InputError as error:
            self._health.group_rejected(error.reason)
            self._log.warning(f"clouds rejected: {error}", **throttled())
            self._reset(str(error))
            return
        self._tuner.observe(segmentation, task.config, task.node_config.auto_tune_period)
        self._health.updated(
            segmentation,
            processing=processed - started,
            latency=time.monotonic() - task.arrival,
            period=task.config.update_period,
        )

    def _reset(self, reason: str) -> None:
        self._segmenter.reset(reason)
        self._tuner.reset()
        self._outputs.clear()
