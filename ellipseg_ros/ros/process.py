"""Running a node as a process, from the command line to a clean end."""

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
# Ends the process: regularly (None), or by an unexpected error.
End = Callable[[BaseException | None], None]


class Runnable(Protocol):
    """An object that holds a node and threads of its own."""

    @property
    def node(self) -> Node:
        """The node whose callbacks are to be run."""

    @property
    def pauses(self) -> Pauses | None:
        """Pauses between its callbacks, if any."""

    def close(self) -> bool:
        """Publish last messages and end the threads; False if one of them is still working."""


class Spinner:
    """Runs the callbacks of a node in a thread of its own.

    The main thread stays free to wait for signals: Python runs signal handlers only there, and
    not while it waits inside DDS. Errors raised by this package go to `end`. Errors that rclpy
    itself raises for invalid messages (a parameter of type 200, a negative /clock) are logged and
    the message is dropped; otherwise any other node could end this one.
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
        """Finish the running callback and start no other."""
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
            self._log.warning(f"invalid message, rejected by rclpy: {error}", **throttled())


def run(make: Callable[[End], Runnable], args: list[str] | None = None) -> int:
    """Run a node until SIGINT, SIGTERM or its own end; return the exit code.

    make: creates it, given the call that ends it. Invalid arguments, and an EllipsegError at any
    time, are reported in one line with exit code 2.
    Further signals have no effect; the process ends within 2 s of the first.
    """
    ending: SimpleQueue[BaseException | None] = SimpleQueue()  # reentrant: for signal handlers
    shutdown = ShutdownHandler(0, on_signal=lambda: ending.put(None))
    try:
        # rclpy's own handlers would shut the context down before the last messages are sent.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (RCLError, UnknownROSArgsError) as error:
        return _report(EllipsegError(in_one_line(error)))
    try:
        runnable = make(ending.put)
    except EllipsegError as error:
        code = _report(error)
        rclpy.shutdown()
        return code
    spinner = Spinner(runnable.node, ending.put, runnable.pauses)
    cause = ending.get()
    finished = runnable.close()
    spinner.stop()
    runnable.node.destroy_node()
    rclpy.shutdown()
    code = 0 if cause is None else _report(cause)
    if not finished:
        os._exit(code)  # a kernel that is compiled or runs can't be interrupted
    return shutdown.finish(code)


def _is_ours(error: Exception) -> bool:
    """Whether this package is in the traceback, apart from the spinner."""
    _, *frames = traceback.extract_tb(error.__traceback__)
    return any(Path(frame.filename).is_relative_to(PACKAGE) for frame in frames)


def _report(error: BaseException) -> int:
    """Log an EllipsegError and return the exit code; other errors keep their traceback."""
    if not isinstance(error, EllipsegError):
        raise error
    get_logger("ellipseg").fatal(str(error))
    return 2


def in_one_line(error: RuntimeError) -> str:
    """Format what ROS reports of invalid arguments or environments, without source locations."""
    if isinstance(error, UnknownROSArgsError):
        return f"ROS knows no arguments {error}; after --ros-args there may be -p, -r and the like"
    text = " ".join(str(error).split()).replace(" ,", ",").replace(". Error: error not set", "")
    text = re.sub(r", at [^\s,]+:\d+", "", text)
    return f"ROS does not start: {text.removeprefix('failed to initialize rcl: ')}"
