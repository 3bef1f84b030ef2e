"""AbortableCondition: waiting for changes made by other threads."""

from threading import Thread

import pytest

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.abortable_condition import AbortableCondition


def test_notification_ends_the_wait():
    condition, items = AbortableCondition(), []
    waiter = Thread(target=lambda: condition.wait_until(lambda: bool(items), 60.0, "no item"))
    waiter.start()
    with condition:
        items.append("item")
        condition.notify_all()
    waiter.join(10.0)
    assert not waiter.is_alive()


@pytest.mark.parametrize("problem", ["1 of 2 arrived", lambda: "1 of 2 arrived"])
def test_timeout_is_an_error(problem):
    with pytest.raises(EllipsegError, match=r"^1 of 2 arrived within 0\.01 s$"):
        AbortableCondition().wait_until(lambda: False, 0.01, problem)


def test_abort_fails_present_and_future_waits_with_the_first_reason():
    condition, errors = AbortableCondition(), []

    def wait():
        try:
            condition.wait_until(lambda: False, 60.0, "no item")
        except EllipsegError as error:
            errors.append(str(error))

    waiter = Thread(target=wait)
    waiter.start()
    condition.abort("the sender has died")
    condition.abort("a later reason")
    waiter.join(10.0)
    assert errors == ["the sender has died"]
    with pytest.raises(EllipsegError, match="has died"):
        condition.wait_until(lambda: True, 1.0, "no item")
