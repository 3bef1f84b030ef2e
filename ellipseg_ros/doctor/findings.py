"""The result of a check."""

from dataclasses import dataclass

OK, WARN, ERROR = "ok", "warn", "error"


@dataclass(frozen=True)
class Finding:
    """A fact about the system, its level, and a remedy (empty if it is fine)."""

    level: str
    text: str
    remedy: str = ""


def ok(text: str) -> Finding:
    """A fact that is as it should be."""
    return Finding(OK, text)


def warn(text: str, remedy: str) -> Finding:
    """A fact that may have unwanted effects."""
    return Finding(WARN, text, remedy)


def error(text: str, remedy: str) -> Finding:
    """A fact that prevents correct operation."""
    return Finding(ERROR, text, remedy)
