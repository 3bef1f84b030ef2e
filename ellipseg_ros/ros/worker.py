"""The thread that segments, so that the reception of clouds never waits for it."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from threading import Thread

from rclpy.impl.rcutils_logger import RcutilsLogger

from ellipseg_ros.config import Config
from ellipseg_ros.errors import InputError
from ellipseg_ros.node.backlog import Backlog, Resend, Reset, Task, Update
from ellipseg_ros.node.health import Health
from ellipseg_ros.ros.limits import Quota, throttled
from ellipseg_ros.ros.outputs import Outputs
from ellipseg_ros.ros.process import End
from ellipseg_ros.ros.tuner import Tuner
from ellipseg_ros.segmenter import Segmenter, warm_up

RESTART_LOG_QUOTA = (10, 60.0)  # log lines within s; /diagnostics count all restarts
IDLE_TIMEOUT_S = 4.0  # without a task, before all markers are sent again: they live 10 s


@dataclass(frozen=True)
class Collaborators:
    """What the worker reads from, writes to and notifies."""

    backlog: Backlog
    outputs: Outputs
    health: Health
    tuner: Tuner
    logger: RcutilsLogger
    on_ready: Callable[[], None]  # called when the kernels are compiled
    end: End


class Worker(Thread):
    """Processes the tasks of the backlog: segments, and publishes the result."""

    def __init__(self, config: Config, node: Collaborators) -> None:
        super().__init__(name="segmenter", daemon=True)
        self._config = config
        self._segmenter = Segmenter(config)
        self._restart_quota = Quota(*RESTART_LOG_QUOTA)
        self._node = node

    def run(self) -> None:
        """Compile the kernels, then work until the backlog is closed."""
        backlog = self._node.backlog
        try:
            self._node.logger.info(
                "loading the kernels; the first start compiles them, which takes half a minute"
            )
            warm_up()
            self._node.on_ready()
            while not backlog.closed:
                task = backlog.get(timeout=IDLE_TIMEOUT_S)
                with self._node.health.work():
                    self._process(task)
        except Exception as error:
            self._node.end(error)

    def _process(self, task: Task | None) -> None:
        if isinstance(task, Update):
            self._update(task)
        elif isinstance(task, Reset):
            self._reset(task.reason)
        elif isinstance(task, Resend):
            self._node.outputs.resend(task.topic)
        elif not self._node.backlog.closed:
            self._node.outputs.refresh_markers()

    def _update(self, task: Update) -> None:
        started = time.monotonic()
        try:
            if task.config != self._config:
                self._segmenter.configure(task.config, task.threshold_change)
                self._config = task.config
            segmentation = self._segmenter.process(task.sweep)
            processed = time.monotonic()
            if self._node.backlog.closed:
                return
            if segmentation.restart and self._restart_quota.take():
                self._node.logger.warning(f"the window restarts: {segmentation.restart}")
            self._node.outputs.publish(segmentation, task.node_config)
        except InputError as error:
            self._node.health.group_rejected(error.reason)
            self._node.logger.warning(f"clouds rejected: {error}", **throttled())
            self._reset(str(error))
            return
        self._node.tuner.observe(segmentation, task.config, task.node_config.auto_tune_period)
        self._node.health.updated(
            segmentation,
            processing=processed - started,
            latency=time.monotonic() - task.arrival,
            period=task.config.update_period,
        )

    def _reset(self, reason: str) -> None:
        self._segmenter.reset(reason)
        self._node.tuner.reset()
        self._node.outputs.clear()
