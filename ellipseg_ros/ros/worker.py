"""The thread that segments, so that arriving clouds never wait for it."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from threading import Thread

from rclpy.impl.rcutils_logger import RcutilsLogger

from ellipseg_ros.config import Config
from ellipseg_ros.errors import InputError
from ellipseg_ros.node.backlog import Backlog, ListAll, Reset, ShowAll, Task, Update
from ellipseg_ros.node.health import Health
from ellipseg_ros.ros.limits import Quota, throttled
from ellipseg_ros.ros.outputs import Outputs
from ellipseg_ros.ros.process import End
from ellipseg_ros.ros.tuner import Tuner
from ellipseg_ros.segmenter import Segmenter, warm_up

RESTARTS = (10, 60.0)  # lines of the log about them in so many s; /diagnostics count them all
IDLE = 4.0  # s without a task after which all markers are sent again: they live 10 s


@dataclass(frozen=True)
class Around:
    """What the worker works with."""

    backlog: Backlog
    outputs: Outputs
    health: Health
    tuner: Tuner
    logger: RcutilsLogger
    ready: Callable[[], None]  # called when the kernels are compiled
    end: End


class Worker(Thread):
    """Takes one task after the other: segments, and publishes what was found."""

    def __init__(self, config: Config, around: Around) -> None:
        super().__init__(name="segmenter", daemon=True)
        self._config = config
        self._segmenter = Segmenter(config)
        self._restarts = Quota(*RESTARTS)
        self._around = around

    def run(self) -> None:
        """Work until the backlog is closed."""
        backlog = self._around.backlog
        try:
            self._around.logger.info(
                "loading the kernels; the first start compiles them, which takes half a minute"
            )
            warm_up()
            self._around.ready()
            while not backlog.closed:
                task = backlog.get(timeout=IDLE)
                with self._around.health.work():
                    self._do(task)
        except Exception as error:
            self._around.end(error)

    def _do(self, task: Task | None) -> None:
        if isinstance(task, Update):
            self._update(task)
        elif isinstance(task, Reset):
            self._segmenter.reset(task.reason)
            self._around.tuner.forget()
            self._around.outputs.clear()
        elif isinstance(task, ListAll):
            self._around.outputs.list_all()
        elif isinstance(task, ShowAll):
            self._around.outputs.greet()
        elif not self._around.backlog.closed:
            self._around.outputs.show_all()

    def _update(self, task: Update) -> None:
        started = time.monotonic()
        try:
            if task.config != self._config:
                self._segmenter.configure(task.config, task.reason)
                self._config = task.config
            found = self._segmenter.process(task.sweep)
            processed = time.monotonic()
            if self._around.backlog.closed:
                return
            if found.restart:
                self._tell_restart(found.restart)
            self._around.outputs.publish(found, task.shown)
        except InputError as error:
            self._start_anew(error)
            return
        self._around.tuner.look(found, task.config, task.shown.auto_tune_period)
        self._around.health.updated(
            found, processed - started, time.monotonic() - task.arrived, task.config.update_period
        )

    def _tell_restart(self, reason: str) -> None:
        """Each one, unless a broken source restarts all the time."""
        if self._restarts.take():
            self._around.logger.warning(f"the window begins anew: {reason}")

    def _start_anew(self, error: InputError) -> None:
        self._around.health.group_rejected(error.reason)
        self._around.logger.warning(f"clouds rejected: {error}", **throttled())
        self._segmenter.reset(str(error))
        self._around.tuner.forget()
        self._around.outputs.clear()
