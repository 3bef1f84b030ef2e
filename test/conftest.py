"""Fixtures for all tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from ellipseg_ros.cli.isolation import reserved_domain

ROOT = Path(__file__).resolve().parents[1]


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
    with reserved_domain() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield domain
