"""Isolation of nodes from other ROS programs: a domain, a namespace and this machine only."""

import itertools
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from ellipseg_ros.errors import EllipsegError

DOMAINS = range(1, 102)  # Linux assigns the ports of higher ones to any program; 0 is the default
LOCALHOST_ONLY = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}

_candidates = itertools.cycle(DOMAINS)


@contextmanager
def reserved_domain() -> Iterator[int]:
    """Hold a ROS_DOMAIN_ID that no other process of this package on this machine holds.

    The lock is a name in Linux's abstract socket namespace, which ends with its process.
    Raises EllipsegError if all are held.
    """
    for _ in range(os.getpid() % len(DOMAINS)):  # processes start at different numbers
        next(_candidates)
    for domain in itertools.islice(_candidates, len(DOMAINS)):
        with socket.socket(socket.AF_UNIX) as lock:
            try:
                lock.bind(f"\0ellipseg_ros_domain_{domain}")
            except OSError:
                continue
            yield domain
            return
    raise EllipsegError(f"all {len(DOMAINS)} ROS domains are in use; end other runs of ellipseg")


@contextmanager
def environment_variables(values: dict[str, str]) -> Iterator[None]:
    """Set environment variables for this block and for the processes that it starts."""
    before = dict(os.environ)
    os.environ.update(values)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
