"""What a check says."""

from collections.abc import Iterable
from dataclasses import dataclass

OK, WARN, ERROR = "ok", "warn", "error"


@dataclass(frozen=True)
class Finding:
    """One line: how bad, what, and what to do about it (nothing, if it is fine)."""

    level: str
    what: str
    do: str = ""


def ok(what: str) -> Finding:
    """All is well."""
    return Finding(OK, what)


def warn(what: str, do: str) -> Finding:
    """It works, but not as it might be expected."""
    return Finding(WARN, what, do)


def error(what: str, do: str) -> Finding:
    """It can't work like this."""
    return Finding(ERROR, what, do)


def failed(findings: Iterable[Finding]) -> bool:
    """Whether anything is an error."""
    return any(finding.level == ERROR for finding in findings)
