"""What a message may ask for, looked at before anything is allocated or built on it."""

from typing import Any

from ellipseg_ros.errors import InputError
from ellipseg_ros.records import SECOND

LONGEST_NAME = 255  # characters: of a frame and of a field, which go into every marker and header
LAST_STAMP = 2**31 - 10**5  # s: int32, less the points' own times and the longest window
SHOWN = 40  # characters of a name in an error


def read_stamp(stamp: Any) -> int:
    """A builtin_interfaces/Time in ns; InputError for what is none, or before 1970, as in ROS."""
    if not (0 <= stamp.sec <= LAST_STAMP and 0 <= stamp.nanosec < SECOND):
        raise InputError(
            f"the stamp is {stamp.sec} s and {stamp.nanosec} ns; it must be 0 to {LAST_STAMP} s "
            f"and less than {SECOND} ns",
            "stamp",
        )
    return nanoseconds(stamp)


def nanoseconds(stamp: Any) -> int:
    """A builtin_interfaces/Time in ns, whatever it says."""
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def check_name(what: str, name: str) -> None:
    """Refuse names of frames and fields that are too long, or not to be shown."""
    if len(name) <= LONGEST_NAME and (not name or name.isprintable()):
        return
    raise InputError(
        f"{what} {name[:SHOWN]!r} has {len(name)} characters; it may have {LONGEST_NAME}, and "
        "only printable ones",
        "name",
    )
