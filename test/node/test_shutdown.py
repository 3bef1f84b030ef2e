"""ShutdownHandler: a signalled process ends soon, cleanly and with the right exit code."""

import signal
import subprocess
import sys

import pytest

from ellipseg_ros.node.shutdown import SHUTDOWN_TIMEOUT_S

BUSY = """
print("ready", flush=True)
while True: pass"""
BLOCKED = """
import threading, time
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # of the main thread
threading.Timer(0.3, print, ["ready"], {"flush": True}).start()  # while the main thread sleeps
time.sleep(30)"""
CLEANS_UP = """
try:
    try:
        print("ready", flush=True)
        while True: pass
    finally:
        print("cleaned")
except KeyboardInterrupt:
    shutdown.finish(3)"""
LOSES_INTERRUPT = """
class Loses:
    def __del__(self):
        print("ready", flush=True)
        while True: pass
Loses()
while True: pass"""
OTHER_HANDLER = """
signal.signal(signal.SIGUSR1, lambda *_: print("other", flush=True))
print("ready", flush=True)
while True: pass"""


def run_and_signal(body, on_signal, numbers=(signal.SIGINT,)):
    """Exit code, stdout and stderr of a process that is signalled and then ends by itself.

    Without the handler each body would run for 30 s or for ever.
    """
    code = (
        "import signal\nfrom ellipseg_ros.node.shutdown import ShutdownHandler\n"
        "def interrupt(): raise KeyboardInterrupt\n"
        f"shutdown = ShutdownHandler(7, 'last message', {on_signal})\n{body}"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "ready\n"
        for number in numbers:
            process.send_signal(number)
        out, err = process.communicate(timeout=20)
    return process.returncode, out, err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_without_callback_the_process_exits_immediately(number):
    assert run_and_signal(BUSY, None, [number]) == (7, "", "")


def test_timeout_leaves_a_margin_to_the_promised_2_s():
    # Measured with a clock, this would fail on a busy machine: the endurance study does it.
    assert SHUTDOWN_TIMEOUT_S <= 1.5


def test_blocked_main_thread_is_ended_by_the_watchdog_with_the_message():
    assert run_and_signal(BLOCKED, None) == (7, "", "last message")


def test_cleanup_runs_even_if_more_signals_arrive():
    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGINT]
    assert run_and_signal(CLEANS_UP, "interrupt", numbers) == (7, "cleaned\n", "")


def test_interrupt_lost_in_a_destructor_still_ends_the_process():
    assert run_and_signal(LOSES_INTERRUPT, "interrupt") == (7, "", "last message")


def test_other_signal_handlers_stay_in_place():
    assert run_and_signal(OTHER_HANDLER, None, [signal.SIGUSR1, signal.SIGTERM])[::2] == (7, "")
