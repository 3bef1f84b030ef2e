"""The result of a check."""

from dataclasses import dataclass
from functools import partial

OK, WARN, ERROR = "ok", "warn", "error"


@dataclass(frozen=True)
class Finding:
    """A fact about the system, its level, and a remedy (empty if it is fine)."""

    level: str
    text: str
    remedy: str = ""


ok = partial(Finding, OK)  # a fact that is as it should be
warn = partial(Finding, WARN)  # one that may have unwanted effects
error = partial(Finding, ERROR)  # one that prevents correct operation
