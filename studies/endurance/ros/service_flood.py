"""A program that calls a node's services as fast as it answers.

It prints STARTED when it begins to call, and calls until stdin ends. Then it waits for pending
answers and prints a line of JSON: for each service, the calls sent, answered and granted.
"""

import json
import sys
from collections import Counter
from collections.abc import Callable
from threading import Condition, Thread
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from std_srvs.srv import Trigger

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.ros.process import End, Runnable, run

STARTED = "calling"
CONCURRENT_CALLS = 4  # of one service
SERVICE_TIMEOUT_S = 30.0  # until there is a service
ANSWER_TIMEOUT_S = 20.0  # for the last answers: a tuning takes seconds


class ServiceFlood(Runnable):
    """Calls services of the node `target` concurrently.

    Raises EllipsegError if one of them does not exist.
    """

    def __init__(self, target: str, services: list[str], end: End) -> None:
        super().__init__("ellipseg_service_flood")
        self._changed = Condition()
        self._sent: Counter[str] = Counter()
        self._answered: Counter[str] = Counter()
        self._granted: Counter[str] = Counter()
        self._closed = False
        self._end = end
        for name in services:
            kind, request = REQUESTS.get(name, (Trigger, Trigger.Request))
            client = self.node.create_client(kind, f"{target}/{name}")
            if not client.wait_for_service(SERVICE_TIMEOUT_S):
                raise EllipsegError(f"there is no service {target}/{name}")
            self._sent[name] = CONCURRENT_CALLS
            for _ in range(CONCURRENT_CALLS):
                self._call(name, client, request)
        print_line(STARTED)
        Thread(target=self._wait_for_end, name="end", daemon=True).start()

    def _call(self, name: str, client: Any, request: Callable[[], Any]) -> None:
        def on_answer(future: Any) -> None:
            with self._changed:
                self._answered[name] += 1
                self._granted[name] += is_granted(future.result())
                again = not self._closed
                self._sent[name] += again
                self._changed.notify_all()
            if again:
                self._call(name, client, request)

        client.call_async(request()).add_done_callback(on_answer)

    def _wait_for_end(self) -> None:
        sys.stdin.read()
        with self._changed:
            self._closed = True
            self._changed.wait_for(lambda: self._answered == self._sent, ANSWER_TIMEOUT_S)
        self._end(None)

    def close(self) -> bool:
        """Print the counts; returns True, as there is no thread to end."""
        counts = (self._sent, self._answered, self._granted)
        print_line(json.dumps({name: [count[name] for count in counts] for name in self._sent}))
        return True


def print_line(line: str) -> None:
    """Print a line immediately."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def is_granted(answer: Any) -> bool:
    """Whether a service did what was requested."""
    if isinstance(answer, SetParameters.Response):
        return all(result.successful for result in answer.results)
    return bool(getattr(answer, "success", True))


def _out_of_range() -> Any:
    value = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=-1)
    return SetParameters.Request(parameters=[Parameter(name="graph.neighbours", value=value)])


def _several_parameters() -> Any:
    return GetParameters.Request(names=["threshold", "criterion", "max_points"])


REQUESTS = {
    "get_parameters": (GetParameters, _several_parameters),
    "set_parameters": (SetParameters, _out_of_range),
}


def main(args: list[str]) -> int:
    """Call services until stdin ends; args: the node, the services, then `--ros-args ...`."""
    end = args.index("--ros-args")
    target, *services = args[:end]

    def make(end: End) -> ServiceFlood:
        return ServiceFlood(target, services, end)

    return run(make, args[end:])
