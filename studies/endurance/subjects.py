"""The subjects of the endurance study, by name on the command line."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

from ellipseg_ros.errors import EllipsegError
from studies.endurance.caches import caches
from studies.endurance.determinism import determinism
from studies.endurance.disks import disks
from studies.endurance.endurance import endurance
from studies.endurance.files import files
from studies.endurance.hostile_clients import hostile_clients
from studies.endurance.inputs import inputs
from studies.endurance.kills import kills
from studies.endurance.multi_node import multi_node
from studies.endurance.overload import overload
from studies.endurance.requirements import Options, Requirement
from studies.endurance.signals import signals
from studies.endurance.stamps import stamps
from studies.report.machine import describe
from studies.report.requirements import MET


class Subject(NamedTuple):
    """A title for the page, and the function that runs the tests."""

    title: str
    test: Callable[[Options], list[Requirement]]


SUBJECTS: dict[str, Subject] = {
    "endurance": Subject("An hour of driving", endurance),
    "overload": Subject("Overload", overload),
    "inputs": Subject("Odd input", inputs),
    "stamps": Subject("Time stamps", stamps),
    "files": Subject("Damaged files", files),
    "kills": Subject("Killed programs", kills),
    "signals": Subject("SIGINT and SIGTERM", signals),
    "disks": Subject("Full disks and read-only folders", disks),
    "caches": Subject("Cache of compiled kernels", caches),
    "multi-node": Subject("Several nodes and subscribers", multi_node),
    "hostile-clients": Subject("Floods of service calls", hostile_clients),
    "determinism": Subject("Determinism", determinism),
}


def run_subject(name: str, options: Options) -> dict[str, Any]:
    """Run the tests of a subject; JSON-ready: machine, options, minutes, requirements.

    An EllipsegError, such as of a node that ended or stopped publishing, becomes a requirement
    that is not met.
    """
    machine = describe()
    started = time.monotonic()
    try:
        requirements = SUBJECTS[name].test(options)
    except EllipsegError as error:
        requirements = [Requirement("the test runs to its end", "the subject", f"{error}", False)]
    return {
        "machine": machine,
        "quick": options.quick,
        "seed": options.seed,
        "minutes": round((time.monotonic() - started) / 60.0, 1),
        "requirements": [requirement.row() for requirement in requirements],
    }


def all_met(result: dict[str, Any]) -> bool:
    """Whether all requirements of a result of `run_subject` are met."""
    return all(row["result"] == MET for row in result["requirements"])
