"""Bounds on the content of messages, checked before anything is allocated for them."""

from typing import Any

from ellipseg_ros.errors import InputError
from ellipseg_ros.records import SECOND

MAX_NAME_LENGTH = 255  # characters of a frame or field, which markers and headers repeat
MAX_STAMP_S = 2**31 - 10**5  # int32, less the longest point time offset and window
SHOWN_LENGTH = 40  # characters of a name in an error


def read_stamp(stamp: Any) -> int:
    """Convert a builtin_interfaces/Time to ns; InputError if it is invalid or before 1970."""
    if not (0 <= stamp.sec <= MAX_STAMP_S and 0 <= stamp.nanosec < SECOND):
        problem = f"the stamp is {stamp.sec} s and {stamp.nanosec} ns"
        valid = f"0 to {MAX_STAMP_S} s and less than {SECOND} ns"
        raise InputError(f"{problem}; it must be {valid}", "stamp")
    return nanoseconds(stamp)


def nanoseconds(stamp: Any) -> int:
    """Convert a builtin_interfaces/Time to ns without checking it."""
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def check_name(what: str, name: str) -> None:
    """Raise InputError for a frame or field name that is too long or not printable."""
    if len(name) <= MAX_NAME_LENGTH and (not name or name.isprintable()):
        return
    problem = f"{what} {name[:SHOWN_LENGTH]!r} has {len(name)} characters"
    raise InputError(f"{problem}; it must have at most {MAX_NAME_LENGTH}, all printable", "name")
