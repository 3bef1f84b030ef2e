"""Waiting for what other threads bring about."""

from threading import Thread

import pytest

from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.node.abortable_condition import News


def test_who_waits_is_woken_by_what_he_waits_for():
    news, came = News(), []
    waiter = Thread(target=lambda: news.expect(lambda: bool(came), 60.0, "nothing came"))
    waiter.start()
    with news:
        came.append("it")
        news.notify_all()
    waiter.join(10.0)
    assert not waiter.is_alive()


@pytest.mark.parametrize("otherwise", ["1 of 2 came", lambda: "1 of 2 came"])
def test_what_does_not_come_in_time_is_an_error(otherwise):
    with pytest.raises(EllipsegError, match=r"^1 of 2 came within 0\.01 s$"):
        News().expect(lambda: False, 0.01, otherwise)


def test_who_waits_learns_at_once_why_nothing_will_come():
    news, heard = News(), []

    def wait():
        try:
            news.expect(lambda: False, 60.0, "nothing came")
        except EllipsegError as error:
            heard.append(str(error))

    waiter = Thread(target=wait)
    waiter.start()
    news.give_up("the sender has died")
    news.give_up("and was buried")
    waiter.join(10.0)
    assert heard == ["the sender has died"]
    with pytest.raises(EllipsegError, match="has died"):  # whoever comes later, too
        news.expect(lambda: True, 1.0, "nothing came")
