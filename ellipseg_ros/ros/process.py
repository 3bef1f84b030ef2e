"""Running a node as a process, from the command line to a clean end."""

import os
import re
import traceback
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from threading import Thread

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

import ellipseg_ros
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.shutdown import ShutdownHandler
from ellipseg_ros.ros.limits import Pauses, throttled
from ellipseg_ros.ros.parameters import Parameters
from ellipseg_ros.settings import Checked

PACKAGE = Path(ellipseg_ros.__file__).parent
# Ends the process: regularly (None), or by an unexpected error.
End = Callable[[BaseException | None], None]
OnError = Callable[[Exception], object]  # gets an unexpected error of a thread, in that thread


class Runnable:
    """A node with parameters that runs as a process.

    Holds an rclpy node and is not derived from it, as attributes would clash with rclpy's own.
    defaults: records of its parameters. Raises ConfigError for invalid initial values.
    """

    pauses: Pauses | None = None  # between its callbacks

    def __init__(self, name: str, *defaults: Checked, context: Context | None = None) -> None:
        self.node = Node(
            name, context=context, automatically_declare_parameters_from_overrides=True
        )
        self.log = self.node.get_logger()
        self.parameters = Parameters(self.node, *defaults)

    def close(self) -> bool:
        """Publish last messages and end the threads; False if one of them is still working."""
        return True


def start_thread(name: str, work: Callable[[], object], end: OnError) -> Thread:
    """Start a daemon thread; an error of its work goes to `end`."""

    def guarded() -> None:
        try:
            work()
        except Exception as error:
            end(error)

    thread = Thread(target=guarded, name=name, daemon=True)
    thread.start()
    return thread


class Spinner:
    """Runs the callbacks of a node in a thread of its own.

    The main thread stays free to wait for signals: Python runs signal handlers only there, and
    not while it waits inside DDS. Errors raised by this package go to `end`. Errors that rclpy
    itself raises for invalid messages (a parameter of type 200, a negative /clock) are logged and
    the message is dropped; otherwise any other node could end this one.
    """

    def __init__(self, node: Node, end: OnError, pauses: Pauses | None = None) -> None:
        self._pauses = pauses
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._log = node.get_logger()
        self._stopped = False
        self._thread = start_thread("callbacks", self._spin, end)

    def stop(self) -> None:
        """Finish the running callback and start no other."""
        self._stopped = True
        self._executor.create_task(lambda: None)  # `wake` alone doesn't end spin_once
        self._thread.join()
        self._executor.shutdown()

    def _spin(self) -> None:
        while not self._stopped:
            try:
                self._executor.spin_once()
            except (ValueError, TypeError, OverflowError) as error:
                if _is_ours(error):
                    raise
                self._log.warning(f"invalid message, rejected by rclpy: {error}", **throttled())
            if self._pauses is not None:
                self._pauses.take()


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
