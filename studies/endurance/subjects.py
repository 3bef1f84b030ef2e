"""All that can be tried, by name."""

import time
from collections.abc import Callable
from typing import Any

from ellipseg_ros.errors import EllipsegError
from studies.endurance.determinism import sameness
from studies.endurance.endurance import hour
from studies.endurance.fault_signals import signals
from studies.endurance.fault_subjects import caches, company, disks, kills
from studies.endurance.files import files
from studies.endurance.hostile_clients import strangers
from studies.endurance.inputs import inputs
from studies.endurance.overload import overload
from studies.endurance.promises import Promise, Trial
from studies.endurance.times import times
from studies.report.machine import describe

SUBJECTS: dict[str, tuple[str, Callable[[Trial], list[Promise]]]] = {
    "hour": ("An hour of driving", hour),
    "overload": ("More points than the machine can do", overload),
    "inputs": ("Odd input", inputs),
    "times": ("Stamps", times),
    "files": ("Spoiled files", files),
    "kills": ("Killed programs", kills),
    "signals": ("SIGINT and SIGTERM", signals),
    "disks": ("Full disks and forbidden places", disks),
    "caches": ("Compiled kernels on the disk", caches),
    "company": ("Other nodes and subscribers", company),
    "strangers": ("Calls of strangers", strangers),
    "sameness": ("The same results", sameness),
}


def soak(name: str, trial: Trial) -> dict[str, Any]:
    """Try a subject; JSON-ready: machine, duration, promises.

    A node that ends or is silent, which ends the trial, is a promise that was not kept.
    """
    machine = describe()
    started = time.monotonic()
    try:
        promises = SUBJECTS[name][1](trial)
    except EllipsegError as error:
        promises = [Promise("the trial comes to its end", "all of the subject", f"{error}", False)]
    return {
        "machine": machine,
        "quick": trial.quick,
        "seed": trial.seed,
        "minutes": round((time.monotonic() - started) / 60.0, 1),
        "promises": [promise.row() for promise in promises],
    }
