"""What a node says of itself when it has come to rest."""

from studies.endurance.listener_process import Listening

PATIENCE = 30.0  # s for one report
STILL = 3  # reports in a row that say the same, one a second
COUNTS = ("clouds received", "clouds rejected", "updates", "updates coalesced", "updates dropped")


def last_word(listener: Listening, reports: int, patience: float = PATIENCE) -> dict[str, str]:
    """/diagnostics when no update waits or is under way and no count moves, or the last one.

    reports: how many, one a second, at most.

    Raises EllipsegError if no report comes within `patience` s.
    """
    before: list[str] = []
    same = 0
    for _ in range(reports):
        said = listener.next_report(patience)
        counts = [said[name] for name in COUNTS]
        idle = said["updates in backlog"] == "0" and said["current update duration [s]"] == "0.0"
        same = same + 1 if idle and counts == before else int(idle)
        before = counts
        if same == STILL:
            break
    return said
