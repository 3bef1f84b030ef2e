"""ROS domains that no two programs of this package share by chance."""

import itertools
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from ellipseg_ros.errors import EllipsegError

DOMAINS = range(1, 102)  # whose ports Linux hands out to nobody; 0 is everybody's

_candidates = itertools.cycle(DOMAINS)


@contextmanager
def claimed_domain() -> Iterator[int]:
    """Hold a ROS_DOMAIN_ID that nobody else on this machine holds, in whatever process.

    The lock is a name in Linux's abstract socket namespace: it goes when its owner goes.
    Raises EllipsegError if all are held.
    """
    for _ in range(os.getpid() % len(DOMAINS)):  # other processes begin elsewhere
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
