"""Diagnostics of a node that has processed everything."""

from typing import Protocol

REPORT_TIMEOUT_S = 30.0
IDLE_REPORTS = 3  # equal reports in a row, one a second, after which a node counts as idle
COUNTS = ("clouds received", "clouds rejected", "updates", "updates coalesced", "updates dropped")


class Reports(Protocol):
    """A source of /diagnostics, such as SubscriberProcess."""

    def next_report(self, timeout_s: float) -> dict[str, str]:
        """Wait for the next /diagnostics."""


def idle_report(
    reports: Reports, max_reports: int, timeout_s: float = REPORT_TIMEOUT_S
) -> dict[str, str]:
    """/diagnostics once no update waits or runs and no count changes, else the last of them.

    max_reports: one a second. Raises EllipsegError if no report comes within `timeout_s`.
    """
    counts: list[str] = []
    equal = 0
    for _ in range(max_reports):
        report = reports.next_report(timeout_s)
        earlier, counts = counts, [report[name] for name in COUNTS]
        idle = (
            report["updates in backlog"] == "0" and report["current update duration [s]"] == "0.0"
        )
        equal = equal + 1 if idle and counts == earlier else int(idle)
        if equal == IDLE_REPORTS:
            break
    return report
