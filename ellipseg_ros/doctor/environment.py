"""Whether the environment is one that a node can run in and be found."""

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ellipseg_ros.doctor.findings import Finding, error, ok, warn

NAME = "ellipseg_ros"
DISTRIBUTION = "jazzy"
DOMAINS = 232  # the highest: a domain takes 250 ports, from 7400 on
SAFE_DOMAINS = 101  # beyond, the ports are among those that Linux hands out to anybody
RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
SHARED_MEMORY = 32 * 2**20  # bytes that should be free: a Docker container has 64 MiB in all
LOG_SPACE = 100 * 2**20  # bytes
XML = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")


@dataclass(frozen=True)
class Place:
    """A folder that is written to."""

    folder: str
    writable: bool
    free: int  # bytes


@dataclass(frozen=True)
class Environment:
    """What was found of the environment."""

    variables: Mapping[str, str]
    python: str  # "3.12"
    middleware: str  # that ROS has loaded; "" where it could not
    wheels: bool  # ROS comes from PyPI
    prefixes: tuple[str, ...]  # of AMENT_PREFIX_PATH, that have this package
    logs: Place
    shared_memory: Place | None  # None: there is none
    receive_buffer: int | None  # bytes, the most that a socket may have; None: not known
    missing_files: tuple[str, ...] = ()  # that variables name, and that are not there


def look(variables: Mapping[str, str], python: str, middleware: str) -> Environment:
    """Find out; middleware: that ROS has loaded."""
    prefixes = [place for place in variables.get("AMENT_PREFIX_PATH", "").split(":") if place]
    ours = [place for place in prefixes if (Path(place) / "share" / NAME).is_dir()]
    home = variables.get("ROS_HOME") or str(Path.home() / ".ros")
    named = [variables[name] for name in XML if variables.get(name)]
    if variables.get("ROS_SECURITY_ENABLE") == "true":
        named.append(variables.get("ROS_SECURITY_KEYSTORE", ""))
    return Environment(
        variables=variables,
        python=python,
        middleware=middleware,
        wheels="_ROS_WHEELS_BOOTSTRAP_COMPLETE" in variables,
        prefixes=tuple(dict.fromkeys(ours)),
        logs=place(variables.get("ROS_LOG_DIR") or f"{home}/log"),
        shared_memory=place("/dev/shm") if Path("/dev/shm").is_dir() else None,
        receive_buffer=_number("/proc/sys/net/core/rmem_max"),
        missing_files=tuple(path for path in named if not path or not os.path.exists(path)),
    )


def place(folder: str) -> Place:
    """A folder, or the nearest one above it that can be seen, in which it would be made."""
    whole = Path(folder).expanduser().absolute()
    nearest = next(one for one in (whole, *whole.parents) if os.path.exists(one))
    disk = os.statvfs(nearest)
    writable = nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)
    return Place(str(whole), writable, disk.f_bavail * disk.f_frsize)


def _number(path: str) -> int | None:
    try:
        return int(Path(path).read_text("ascii"))
    except (OSError, ValueError):
        return None


def check(found: Environment) -> Iterator[Finding]:
    """Yield what there is to say of an environment."""
    yield _distribution(found)
    yield from _mixture(found)
    yield from _domain(found.variables)
    yield from _range(found.variables)
    yield _middleware(found)
    yield from _security(found)
    yield _logs(found.logs)
    yield from _memory(found)


def _distribution(found: Environment) -> Finding:
    name = found.variables.get("ROS_DISTRO", "")
    if name and name != DISTRIBUTION:
        return error(
            f"ROS {name} is sourced; this package is for {DISTRIBUTION}",
            f"a new shell, and source /opt/ros/{DISTRIBUTION}/setup.bash",
        )
    if found.wheels and name:
        return warn(
            f"ROS comes from PyPI, and an installation of {name} is sourced too: their libraries "
            "may mix",
            "a new shell without setup.bash, or an environment without ros-jazzy-* of pip",
        )
    return ok("ROS from PyPI" if found.wheels else f"ROS {name or '(ROS_DISTRO is not set)'}")


def _mixture(found: Environment) -> Iterator[Finding]:
    if len(found.prefixes) > 1:
        yield warn(
            f"AMENT_PREFIX_PATH has {NAME} {len(found.prefixes)} times: "
            f"{', '.join(found.prefixes)}; the first is used",
            "a new shell; source only the workspace that you mean",
        )
    versions = set(re.findall(r"python(3\.\d+)", found.variables.get("PYTHONPATH", "")))
    others = sorted(versions - {found.python})
    if others:
        yield error(
            f"PYTHONPATH has packages of Python {', '.join(others)}; this is {found.python}",
            "use the Python that ROS was built for, or unset PYTHONPATH",
        )


def _domain(variables: Mapping[str, str]) -> Iterator[Finding]:
    text = variables.get("ROS_DOMAIN_ID", "").strip()
    if text and (not text.isascii() or not text.isdigit() or int(text) > DOMAINS):
        yield error(
            f"ROS_DOMAIN_ID is {text!r}", f"give a number from 0 to {SAFE_DOMAINS}, or unset it"
        )
    elif text and int(text) > SAFE_DOMAINS:
        yield warn(
            f"ROS_DOMAIN_ID is {text}: its ports may be taken by other programs",
            f"use 0 to {SAFE_DOMAINS}, on all machines",
        )
    else:
        yield ok(f"ROS_DOMAIN_ID {text or '0 (not set)'}; it must be the same everywhere")


def _range(variables: Mapping[str, str]) -> Iterator[Finding]:
    if variables.get("ROS_LOCALHOST_ONLY", "0") == "1":
        yield warn(
            "ROS_LOCALHOST_ONLY is set: only this machine is seen, whatever the discovery range",
            "unset it; it is deprecated for ROS_AUTOMATIC_DISCOVERY_RANGE",
        )
        return
    reach = variables.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "") or "SUBNET"
    if reach.upper() not in RANGES:
        yield error(
            f"ROS_AUTOMATIC_DISCOVERY_RANGE is {reach!r}", f"use one of {', '.join(RANGES)}"
        )
    elif reach.upper() == "OFF":
        yield error(
            "ROS_AUTOMATIC_DISCOVERY_RANGE is OFF: nobody is found, not even on this machine",
            "unset it, or use LOCALHOST or SUBNET",
        )
    else:
        seen = "this machine only" if reach.upper() == "LOCALHOST" else "the local network"
        yield ok(f"discovery range {reach.upper()}: {seen}")


def _middleware(found: Environment) -> Finding:
    wanted = found.variables.get("RMW_IMPLEMENTATION", "")
    if not found.middleware:
        return error(
            f"no middleware could be loaded (RMW_IMPLEMENTATION {wanted or 'not set'})",
            "unset RMW_IMPLEMENTATION, or install the package of that name",
        )
    if wanted and wanted != found.middleware:
        return warn(
            f"RMW_IMPLEMENTATION is {wanted}, and {found.middleware} is used",
            f"install {wanted}, or unset the variable on all machines",
        )
    return ok(f"middleware {found.middleware}: it should be the same everywhere")


def _security(found: Environment) -> Iterator[Finding]:
    for path in found.missing_files:
        yield error(
            f"a file that the environment names is not there: {path or 'ROS_SECURITY_KEYSTORE'}",
            f"mend or unset {', '.join(XML)}, ROS_SECURITY_ENABLE and ROS_SECURITY_KEYSTORE",
        )
    if found.variables.get("ROS_SECURITY_ENABLE") == "true":
        strategy = found.variables.get("ROS_SECURITY_STRATEGY", "")
        if strategy == "Enforce":
            yield ok("DDS security is on, and enforced")
        else:
            yield warn(
                "DDS security is on, but a node without keys starts unsecured",
                "export ROS_SECURITY_STRATEGY=Enforce",
            )


def _logs(logs: Place) -> Finding:
    if not logs.writable:
        return error(
            f"logs can't be written to {logs.folder}: no node starts",
            "set ROS_LOG_DIR to a folder that can be written to",
        )
    if logs.free < LOG_SPACE:
        return warn(
            f"{logs.free / 2**20:.0f} MiB left for logs in {logs.folder}",
            "remove old logs, or set ROS_LOG_DIR to a folder on another disk",
        )
    return ok(f"logs in {logs.folder}")


def _memory(found: Environment) -> Iterator[Finding]:
    shared = found.shared_memory
    if shared is None or not shared.writable:
        yield warn(
            "no shared memory (/dev/shm): clouds go through sockets, which is slower",
            "mount a tmpfs at /dev/shm",
        )
    elif shared.free < SHARED_MEMORY:
        yield warn(
            f"{shared.free / 2**20:.0f} MiB of shared memory left (/dev/shm)",
            "docker run --shm-size=512m or --ipc=host; of crashed nodes: `fastdds shm clean`",
        )
    else:
        yield ok(f"{shared.free / 2**20:.0f} MiB of shared memory left")
    if found.receive_buffer is not None:
        yield ok(f"socket buffers of up to {found.receive_buffer / 2**10:.0f} KiB (rmem_max)")
