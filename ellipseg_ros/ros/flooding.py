"""A process that calls a node's services as fast as it answers: for `ellipseg soak`.

At the end, one line of JSON on stdout: for each service, calls answered and calls that it granted.
"""

import json
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from std_srvs.srv import Trigger

from ellipseg_ros.ros.process import End, run

AT_ONCE = 4  # calls of a service that wait for their answers


class Flood:
    """Calls the services named, of the node of that name in its namespace."""

    def __init__(self, target: str, services: list[str]) -> None:
        self.node = Node("ellipseg_flood")
        self._answered: Counter[str] = Counter()
        self._granted: Counter[str] = Counter()
        self._closed = False
        for name in services:
            kind, request = REQUESTS.get(name, (Trigger, Trigger.Request))
            client = self.node.create_client(kind, f"{target}/{name}")
            client.wait_for_service()
            for _ in range(AT_ONCE):
                self._call(name, client, request)

    def _call(self, name: str, client: Any, request: Callable[[], Any]) -> None:
        def answered(future: Any) -> None:
            self._answered[name] += 1
            self._granted[name] += granted(future.result())
            if not self._closed:
                self._call(name, client, request)

        client.call_async(request()).add_done_callback(answered)

    def close(self) -> bool:
        """Call no more, and tell."""
        self._closed = True
        told = {name: [self._answered[name], self._granted[name]] for name in self._answered}
        sys.stdout.write(json.dumps(told) + "\n")
        sys.stdout.flush()
        return True


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
    """Flood until SIGINT; args: the node, the services, then `--ros-args ...`."""
    end = args.index("--ros-args")
    target, *services = args[:end]

    def make(_: End) -> Flood:
        return Flood(target, services)

    return run(make, args[end:])
