"""Fixtures for all tests."""

import itertools
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

# Domain ids whose ports are outside the range that Linux hands out to anybody.
_candidates = itertools.cycle(range(1, 102))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with the real scans, which aren't part of the repository."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real scans: there is no folder {folder}")
    return folder


@pytest.fixture
def ros_domain() -> Iterator[int]:
    """A ROS_DOMAIN_ID for this test alone, set in the environment."""
    yield from _domain()


@pytest.fixture(scope="session")
def session_ros_domain() -> Iterator[int]:
    """A ROS_DOMAIN_ID for this pytest process, for fixtures that outlive a test."""
    yield from _domain()


def _domain() -> Iterator[int]:
    with claimed_domain() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield domain


@contextmanager
def claimed_domain() -> Iterator[int]:
    """Hold a domain id that no other test on this machine holds, in whatever process.

    The lock is a name in Linux's abstract socket namespace: it goes when its owner goes.
    """
    for _ in range(os.getpid() % 101):  # other processes begin elsewhere
        next(_candidates)
    for domain in itertools.islice(_candidates, 101):
        with socket.socket(socket.AF_UNIX) as lock:
            try:
                lock.bind(f"\0ellipseg_ros_test_domain_{domain}")
            except OSError:
                continue
            yield domain
            return
    raise RuntimeError("101 tests hold all the domain ids")
