"""Runs a node as a process: from the command line to a clean end."""

import os
import re
import traceback
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Protocol

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

import ellipseg_ros
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.shutdown import ShutdownHandler
from ellipseg_ros.ros.limits import Pauses, throttled

PACKAGE = Path(ellipseg_ros.__file__).parent
# Ends the process: in peace (None), or by an error that nobody expected.
End = Callable[[BaseException | None], None]


class Runnable(Protocol):
    """What has a node, and threads of its own."""

    @property
    def node(self) -> Node:
        """Its node."""

    @property
    def pauses(self) -> Pauses | None:
        """What holds its callbacks back, if something does."""

    def close(self) -> bool:
        """Say farewell and end the threads; False if one of them is still busy."""


class Spinner:
    """Runs the callbacks of a node in a thread of its own.

    So the main thread is free to wait for signals: Python runs their handlers only there, and not
    while it waits inside DDS. What callbacks of this package raise goes to `end`. What rclpy
    raises by itself, of a message with values that cannot be (a parameter of type 200, a negative
    /clock), is logged, and the message is lost: else any stranger could end the node.
    """

    def __init__(self, node: Node, end: End, pauses: Pauses | None = None) -> None:
        self._pauses = pauses
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._log = node.get_logger()
        self._end = end
        self._stopped = False
        self._thread = Thread(target=self._spin, name="callbacks", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Finish the running callback and begin no other."""
        self._stopped = True
        self._executor.create_task(lambda: None)  # `wake` alone doesn't end spin_once
        self._thread.join()
        self._executor.shutdown()

    def _spin(self) -> None:
        try:
            while not self._stopped:
                self._spin_once()
                if self._pauses is not None:
                    self._pauses.take()
        except Exception as error:
            self._end(error)

    def _spin_once(self) -> None:
        try:
            self._executor.spin_once()
        except (ValueError, TypeError, OverflowError) as error:
            if _is_ours(error):
                raise
            self._log.warning(f"a message that rclpy does not take: {error}", **throttled())


def run(make: Callable[[End], Runnable], args: list[str] | None = None) -> int:
    """Keep a node until SIGINT, SIGTERM or its own end; return the exit code.

    make: makes it, given the call that ends it. What is wrong with the arguments, and an
    EllipsegError, then or later, is said in one line, code 2.
    A second signal changes nothing, and the process ends within 2 s of the first.
    """
    ending: SimpleQueue[BaseException | None] = SimpleQueue()  # may be filled by signal handlers
    shutdown = ShutdownHandler(0, on_signal=lambda: ending.put(None))
    try:
        # rclpy's own handlers would end the context before the node can say farewell.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (RCLError, UnknownROSArgsError) as error:
        return _failed(EllipsegError(in_one_line(error)))
    try:
        running = make(ending.put)
    except EllipsegError as error:
        code = _failed(error)
        rclpy.shutdown()
        return code
    spinner = Spinner(running.node, ending.put, running.pauses)
    reason = ending.get()
    finished = running.close()
    spinner.stop()
    running.node.destroy_node()
    rclpy.shutdown()
    code = 0 if reason is None else _failed(reason)
    if not finished:
        os._exit(code)  # a kernel that compiles or runs can't be interrupted: it delays the end
    return shutdown.finish(code)


def _is_ours(error: Exception) -> bool:
    """Whether code of this package raised it, or called what did; but for the spinner."""
    _, *frames = traceback.extract_tb(error.__traceback__)
    return any(Path(frame.filename).is_relative_to(PACKAGE) for frame in frames)


def _failed(reason: BaseException) -> int:
    """Say what ends the node; the exit code. What nobody expected keeps its traceback."""
    if not isinstance(reason, EllipsegError):
        raise reason
    get_logger("ellipseg").fatal(str(reason))
    return 2


def in_one_line(error: RuntimeError) -> str:
    """What ROS says of arguments or an environment that it doesn't take, without where."""
    if isinstance(error, UnknownROSArgsError):
        return f"ROS knows no arguments {error}; after --ros-args there may be -p, -r and the like"
    text = " ".join(str(error).split()).replace(" ,", ",").replace(". Error: error not set", "")
    text = re.sub(r", at [^\s,]+:\d+", "", text)
    return f"ROS does not start: {text.removeprefix('failed to initialize rcl: ')}"
