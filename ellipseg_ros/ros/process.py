"""Runs a node as a process: from the command line to a clean end."""

import os
from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread
from typing import Protocol

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.farewell import Farewell

# Ends the process: in peace (None), or by an error that nobody expected.
End = Callable[[BaseException | None], None]


class Runnable(Protocol):
    """What has a node, and threads of its own."""

    @property
    def node(self) -> Node:
        """Its node."""

    def close(self) -> bool:
        """Say farewell and end the threads; False if one of them is still busy."""


class Spinner:
    """Runs the callbacks of a node in a thread of its own.

    So the main thread is free to wait for signals: Python runs their handlers only there, and not
    while it waits inside DDS.
    """

    def __init__(self, node: Node, end: End) -> None:
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
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
                self._executor.spin_once()
        except Exception as error:
            self._end(error)


def run(make: Callable[[End], Runnable], args: list[str] | None = None) -> int:
    """Keep a node until SIGINT, SIGTERM or its own end; return the exit code.

    make: makes it, given the call that ends it; an EllipsegError is said in one line, code 2.
    A second signal changes nothing, and the process ends within 2 s of the first.
    """
    ending: SimpleQueue[BaseException | None] = SimpleQueue()  # may be filled by signal handlers
    farewell = Farewell(0, do=lambda: ending.put(None))
    # rclpy's own handlers would end the context before the node can say farewell.
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    try:
        running = make(ending.put)
    except EllipsegError as error:
        get_logger("ellipseg").fatal(str(error))
        rclpy.shutdown()
        return 2
    spinner = Spinner(running.node, ending.put)
    reason = ending.get()
    finished = running.close()
    spinner.stop()
    running.node.destroy_node()
    rclpy.shutdown()
    if reason is not None:
        raise reason
    if not finished:
        os._exit(0)  # a kernel that compiles or runs can't be interrupted, and would delay the end
    return farewell.end(0)
