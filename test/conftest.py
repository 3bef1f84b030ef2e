"""Fixtures for all tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from ellipseg_ros.cli.isolation import reserved_domain

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with real scans, which are not part of the repository."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"needs real scans in {folder}")
    return folder


@pytest.fixture
def ros_domain() -> Iterator[int]:
    """A ROS_DOMAIN_ID that only this test uses, set in the environment."""
    yield from _domain()


@pytest.fixture(scope="session")
def session_ros_domain() -> Iterator[int]:
    """A ROS_DOMAIN_ID that only this pytest process uses, for fixtures of a wider scope."""
    yield from _domain()


def _domain() -> Iterator[int]:
    with reserved_domain() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield domain
