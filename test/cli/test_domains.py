"""No two programs share a ROS domain by chance."""

import itertools
import os
from contextlib import ExitStack

import pytest

from ellipseg_ros.cli import domains
from ellipseg_ros.cli.domains import DOMAINS, claimed_domain
from ellipseg_ros.cli.running import domain
from ellipseg_ros.errors import EllipsegError


def test_a_trial_beside_a_test_has_another_domain(ros_domain):
    with domain(), claimed_domain() as third:
        assert len({ros_domain, int(os.environ["ROS_DOMAIN_ID"]), third}) == 3
        assert third in DOMAINS
    assert os.environ["ROS_DOMAIN_ID"] == str(ros_domain)


def test_what_was_held_can_be_held_again_and_too_many_are_an_error(monkeypatch):
    few = range(1, 4)
    monkeypatch.setattr(domains, "DOMAINS", few)
    monkeypatch.setattr(domains, "_candidates", itertools.cycle(few))

    def hold_more_than_there_are():
        with ExitStack() as stack:
            for _ in (*few, "one more"):
                stack.enter_context(claimed_domain())

    for _ in range(2):
        with pytest.raises(EllipsegError, match="all 3 ROS domains are in use"):
            hold_more_than_there_are()
