"""Checks of the environment in which a node starts: variables, files, memory, disks."""

import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ellipseg_ros.doctor.findings import Finding, error, ok, warn

NAME = "ellipseg_ros"
DISTRIBUTION = "jazzy"
MAX_DOMAIN = 232  # a domain takes 250 ports, from 7400 on
MAX_SAFE_DOMAIN = 101  # Linux may assign the ports of higher domains to any program
DISCOVERY_RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
MIN_SHARED_MEMORY_BYTES = 32 * 2**20  # free; a Docker container has 64 MiB in all
MIN_STORAGE_BYTES = 200 * 2**20  # free, for logs or compiled kernels
SHARED_MEMORY = "/dev/shm"
RECEIVE_BUFFER = Path("/proc/sys/net/core/rmem_max")
XML = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")


@dataclass(frozen=True)
class Folder:
    """A folder to write to."""

    path: str
    writable: bool
    free: int  # bytes


def receive_buffer() -> int | None:
    """Maximum of a socket, in bytes; None if it can't be read."""
    with suppress(OSError):
        return int(RECEIVE_BUFFER.read_text("ascii"))
    return None


def folder_at(path: str) -> Folder:
    """A folder with the state of its nearest existing parent, if it does not exist itself."""
    whole = Path(path).expanduser().absolute()
    nearest = next(folder for folder in (whole, *whole.parents) if os.path.exists(folder))
    disk = os.statvfs(nearest)
    writable = nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)
    return Folder(str(whole), writable, disk.f_bavail * disk.f_frsize)


def check_storage(
    content: str, folder: Folder, variable: str, level: Callable[[str, str], Finding], effect: str
) -> Finding:
    """Finding about the folder of some content, which a variable sets.

    level, effect: of a folder that is not writable.
    """
    if not folder.writable:
        text = f"{content} can't be stored in {folder.path}: {effect}"
        return level(text, f"set {variable} to a writable folder")
    if folder.free < MIN_STORAGE_BYTES:
        text = f"{folder.free / 2**20:.0f} MiB left for {content} in {folder.path}"
        return warn(text, f"make room, or set {variable} to a folder on another disk")
    return ok(f"{content} in {folder.path}")


def check_environment(variables: Mapping[str, str], middleware: str) -> Iterator[Finding]:
    """Findings about an environment; middleware: loaded by ROS, "" if it could not be."""
    wheels = "_ROS_WHEELS_BOOTSTRAP_COMPLETE" in variables
    yield _distribution(variables.get("ROS_DISTRO", ""), wheels)
    yield from _mixed_paths(variables)
    yield _domain(variables.get("ROS_DOMAIN_ID", "").strip())
    yield _discovery(variables)
    yield _middleware(variables.get("RMW_IMPLEMENTATION", ""), middleware)
    yield from _security(variables)
    logs = folder_at(
        variables.get("ROS_LOG_DIR") or f"{variables.get('ROS_HOME') or '~/.ros'}/log"
    )
    yield check_storage("logs", logs, "ROS_LOG_DIR", error, "no node starts")
    yield _shared_memory()
    buffer = receive_buffer()
    if buffer is not None:
        yield ok(f"socket buffers of up to {buffer / 2**10:.0f} KiB (rmem_max)")


def _distribution(name: str, wheels: bool) -> Finding:
    """Finding about ROS_DISTRO; wheels: ROS comes from PyPI."""
    if name and name != DISTRIBUTION:
        text = f"ROS {name} is sourced; this package is for {DISTRIBUTION}"
        return error(text, f"open a new shell and source /opt/ros/{DISTRIBUTION}/setup.bash")
    if wheels and name:
        text = f"ROS comes from PyPI, and ROS {name} is sourced too: their libraries may mix"
        return warn(text, "open a new shell without setup.bash, or an environment without wheels")
    return ok("ROS from PyPI" if wheels else f"ROS {name or '(ROS_DISTRO not set)'}")


def _mixed_paths(variables: Mapping[str, str]) -> Iterator[Finding]:
    prefixes = dict.fromkeys(variables.get("AMENT_PREFIX_PATH", "").split(":"))
    ours = [path for path in prefixes if path and (Path(path) / "share" / NAME).is_dir()]
    if len(ours) > 1:
        text = f"AMENT_PREFIX_PATH has {NAME} {len(ours)} times: {', '.join(ours)}"
        yield warn(f"{text}; the first is used", "open a new shell and source only one workspace")
    python = f"3.{sys.version_info.minor}"
    versions = set(re.findall(r"python(3\.\d+)", variables.get("PYTHONPATH", ""))) - {python}
    if versions:
        text = f"PYTHONPATH has packages of Python {', '.join(sorted(versions))}"
        remedy = "use the Python that ROS was built for, or unset PYTHONPATH"
        yield error(f"{text}; this is {python}", remedy)


def _domain(text: str) -> Finding:
    safe = f"0 to {MAX_SAFE_DOMAIN}"
    if text and (not text.isascii() or not text.isdigit() or int(text) > MAX_DOMAIN):
        return error(f"ROS_DOMAIN_ID is {text!r}", f"set it to {safe}, or unset it")
    if text and int(text) > MAX_SAFE_DOMAIN:
        problem = f"ROS_DOMAIN_ID is {text}: its ports may be taken by other programs"
        return warn(problem, f"use {safe}, on all machines")
    return ok(f"ROS_DOMAIN_ID {text or '0 (not set)'}; it must be the same on all machines")


def _discovery(variables: Mapping[str, str]) -> Finding:
    name = "ROS_AUTOMATIC_DISCOVERY_RANGE"
    if variables.get("ROS_LOCALHOST_ONLY", "0") == "1":
        text = "ROS_LOCALHOST_ONLY is set: only this machine is discovered"
        return warn(text, f"unset it; {name} replaces it")
    value = variables.get(name, "") or "SUBNET"
    if value.upper() not in DISCOVERY_RANGES:
        return error(f"{name} is {value!r}", f"use one of {', '.join(DISCOVERY_RANGES)}")
    if value.upper() == "OFF":
        text = f"{name} is OFF: no node is discovered, not even on this machine"
        return error(text, "unset it, or use LOCALHOST or SUBNET")
    scope = "this machine only" if value.upper() == "LOCALHOST" else "the local network"
    return ok(f"discovery range {value.upper()}: {scope}")


def _middleware(requested: str, loaded: str) -> Finding:
    if not loaded:
        text = f"no middleware could be loaded (RMW_IMPLEMENTATION {requested or 'not set'})"
        return error(text, "unset RMW_IMPLEMENTATION, or install the package of that name")
    if requested and requested != loaded:
        text = f"RMW_IMPLEMENTATION is {requested}, but {loaded} is used"
        return warn(text, f"install {requested}, or unset the variable on all machines")
    return ok(f"middleware {loaded}; it should be the same on all machines")


def _security(variables: Mapping[str, str]) -> Iterator[Finding]:
    secure = variables.get("ROS_SECURITY_ENABLE") == "true"
    files = [variables[name] for name in XML if variables.get(name)]
    if secure:
        files.append(variables.get("ROS_SECURITY_KEYSTORE", ""))
    remedy = f"correct {', '.join(XML)}, ROS_SECURITY_ENABLE and ROS_SECURITY_KEYSTORE"
    for path in files:
        if not path or not os.path.exists(path):
            name = path or "ROS_SECURITY_KEYSTORE"
            yield error(f"a file named in the environment is missing: {name}", remedy)
    if secure and variables.get("ROS_SECURITY_STRATEGY") == "Enforce":
        yield ok("DDS security is on, and enforced")
    elif secure:
        text = "DDS security is on, but a node without keys starts unsecured"
        yield warn(text, "export ROS_SECURITY_STRATEGY=Enforce")


def _shared_memory() -> Finding:
    memory = folder_at(SHARED_MEMORY)
    if not (Path(SHARED_MEMORY).is_dir() and memory.writable):
        text = "no shared memory (/dev/shm): clouds go through sockets, which is slower"
        return warn(text, "mount a tmpfs at /dev/shm")
    text = f"{memory.free / 2**20:.0f} MiB of shared memory left (/dev/shm)"
    if memory.free < MIN_SHARED_MEMORY_BYTES:
        remedy = "docker run --shm-size=512m or --ipc=host; after crashes: `fastdds shm clean`"
        return warn(text, remedy)
    return ok(text)
