"""The machine that results were measured on, without its name."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("ellipseg_ros", "numba", "numpy", "ros-jazzy-rclpy")
BUSY = (
    " **Other programs were running**: wall-clock times are too long and CPU times slightly so; "
    "ratios of alternating runs suffer least."
)


def describe() -> dict[str, Any]:
    """Return processor, cores, memory, system, versions and the load before the study."""
    return {
        "cpu": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1),
        "system": platform.system(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in PACKAGES},
        "load_before": round(os.getloadavg()[0], 2),  # running processes, mean over a minute
    }


def machine_line(machine: dict[str, Any]) -> str:
    """The result of `describe` as a sentence."""
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    busy = BUSY if machine["load_before"] > machine["cores"] else ""
    return (
        f"Machine: {machine['cpu']}, {machine['cores']} cores, {machine['memory_gb']:g} GB; "
        f"{machine['system']}, Python {machine['python']}, {versions}. "
        f"Load average before: {machine['load_before']:g}.{busy}"
    )


def _processor() -> str:
    """Model name of the first processor in /proc/cpuinfo."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        name, _, value = line.partition(":")
        if name.strip() == "model name":
            return value.strip()
    return platform.machine()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "of a ROS installation"
