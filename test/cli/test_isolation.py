"""ROS domains are reserved for one program at a time."""

import itertools
import os
from contextlib import ExitStack

import pytest

from ellipseg_ros.cli import isolation
from ellipseg_ros.cli.isolation import DOMAINS, reserved_domain
from ellipseg_ros.errors import EllipsegError
from studies.report.isolated_nodes import isolated_ros_args


def test_concurrent_reservations_have_different_domains(ros_domain):
    with isolated_ros_args(), reserved_domain() as third:
        assert len({ros_domain, int(os.environ["ROS_DOMAIN_ID"]), third}) == 3
        assert third in DOMAINS
    assert os.environ["ROS_DOMAIN_ID"] == str(ros_domain)


def test_released_domain_can_be_reserved_and_more_than_all_are_an_error(monkeypatch):
    few = range(1, 4)
    monkeypatch.setattr(isolation, "DOMAINS", few)
    monkeypatch.setattr(isolation, "_candidates", itertools.cycle(few))

    def reserve_more_than_all():
        with ExitStack() as stack:
            for _ in (*few, "one more"):
                stack.enter_context(reserved_domain())

    for _ in range(2):
        with pytest.raises(EllipsegError, match="all 3 ROS domains are in use"):
            reserve_more_than_all()
