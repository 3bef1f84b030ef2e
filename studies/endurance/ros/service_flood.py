"""A process that calls a node's services as fast as it answers: for `ellipseg soak`.

It says BEGUN on stdout when it calls, until stdin ends. Then it waits for the answers that are
due, and tells in one line of JSON: for each service, calls asked, answered, and granted.
"""

import json
import sys
from collections import Counter
from collections.abc import Callable
from threading import Condition, Thread
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from std_srvs.srv import Trigger

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.ros.process import End, run

BEGUN = "calling"
AT_ONCE = 4  # calls of a service that wait for their answers
START = 30.0  # s until there is a service
PATIENCE = 20.0  # s for the last answers: a tuning takes seconds


class Flood:
    """Calls the services named, of the node of that name in its namespace.

    Raises EllipsegError if one of them is not there.
    """

    pauses = None

    def __init__(self, target: str, services: list[str], end: End) -> None:
        self.node = Node("ellipseg_flood")
        self._changed = Condition()
        self._asked: Counter[str] = Counter()
        self._answered: Counter[str] = Counter()
        self._granted: Counter[str] = Counter()
        self._closed = False
        self._end = end
        for name in services:
            kind, request = REQUESTS.get(name, (Trigger, Trigger.Request))
            client = self.node.create_client(kind, f"{target}/{name}")
            if not client.wait_for_service(START):
                raise EllipsegError(f"there is no service {target}/{name}")
            self._asked[name] = AT_ONCE
            for _ in range(AT_ONCE):
                self._call(name, client, request)
        say(BEGUN)
        Thread(target=self._wait_for_end, name="end", daemon=True).start()

    def _call(self, name: str, client: Any, request: Callable[[], Any]) -> None:
        def answered(future: Any) -> None:
            with self._changed:
                self._answered[name] += 1
                self._granted[name] += granted(future.result())
                again = not self._closed
                self._asked[name] += again
                self._changed.notify_all()
            if again:
                self._call(name, client, request)

        client.call_async(request()).add_done_callback(answered)

    def _wait_for_end(self) -> None:
        sys.stdin.read()
        with self._changed:
            self._closed = True
            self._changed.wait_for(lambda: self._answered == self._asked, PATIENCE)
        self._end(None)

    def close(self) -> bool:
        """Tell."""
        counts = (self._asked, self._answered, self._granted)
        say(json.dumps({name: [count[name] for count in counts] for name in self._asked}))
        return True


def say(line: str) -> None:
    """To who has started this."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def granted(answer: Any) -> bool:
    """Whether a service did what was asked."""
    if isinstance(answer, SetParameters.Response):
        return all(result.successful for result in answer.results)
    return bool(getattr(answer, "success", True))


def _out_of_range() -> Any:
    value = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=-1)
    return SetParameters.Request(parameters=[Parameter(name="graph.neighbours", value=value)])


def _all_parameters() -> Any:
    return GetParameters.Request(names=["threshold", "criterion", "max_points"])


REQUESTS = {
    "get_parameters": (GetParameters, _all_parameters),
    "set_parameters": (SetParameters, _out_of_range),
}


def main(args: list[str]) -> int:
    """Flood until stdin ends; args: the node, the services, then `--ros-args ...`."""
    end = args.index("--ros-args")
    target, *services = args[:end]

    def make(end: End) -> Flood:
        return Flood(target, services, end)

    return run(make, args[end:])
