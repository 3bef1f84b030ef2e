"""Runs a node as a process: from the command line to a clean end."""

import os
import signal
from abc import abstractmethod
from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ellipseg_ros.errors import EllipsegError

# Ends the process: in peace (None), or by an error that nobody expected.
End = Callable[[BaseException | None], None]


class ClosableNode(Node):  # type: ignore[misc]  # rclpy is untyped in part
    """A node with threads of its own."""

    @abstractmethod
    def close(self) -> bool:
        """Say farewell and end the threads; False if one of them is still busy."""


class Spinner:
    """Runs the callbacks of a node in a thread of its own.

    So the main thread is free to wait for signals: Python runs their handlers only there, and not
    while it waits inside DDS.
    """

    def __init__(self, node: Node, context: Context, end: End) -> None:
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(node)
        self._end = end
        self._stopped = False
        self._thread = Thread(target=self._spin, name="callbacks", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Finish the running callback and begin no other."""
        self._stopped = True
        self._executor.wake()
        self._thread.join()
        self._executor.shutdown()

    def _spin(self) -> None:
        try:
            while not self._stopped:
                self._executor.spin_once()
        except Exception as error:
            self._end(error)


def run(make: Callable[[End], ClosableNode], args: list[str] | None = None) -> int:
    """Keep a node until SIGINT, SIGTERM or its own end; return the exit code.

    make: makes the node, given the call that ends it; its EllipsegError is one line and code 2.
    A second signal changes nothing.
    """
    ending: SimpleQueue[BaseException | None] = SimpleQueue()  # may be filled by signal handlers
    _on_signals(lambda *_: ending.put(None))
    # rclpy's own handlers would end the context before the node can say farewell.
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = make(ending.put)
    except EllipsegError as error:
        get_logger("ellipseg").fatal(str(error))
        rclpy.shutdown()
        return 2
    spinner = Spinner(node, node.context, ending.put)
    reason = ending.get()
    finished = node.close()
    spinner.stop()
    node.destroy_node()
    rclpy.shutdown()
    if reason is not None:
        raise reason
    if not finished:
        os._exit(0)  # a kernel that compiles or runs can't be interrupted, and would delay the end
    return 0


def _on_signals(handler: Callable[..., Any]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, handler)
