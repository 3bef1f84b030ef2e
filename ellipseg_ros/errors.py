"""What this package raises when the fault is in what it was given."""


class EllipsegError(Exception):
    """Base of all; its text is one line: what is wrong, and what would be right."""


class ConfigError(EllipsegError):
    """A setting out of range, or of the wrong type."""


class InputError(EllipsegError):
    """Data that cannot be read as points.

    reason: a short key to count it by, as in /diagnostics ("no_xyz", "short_data", ...).
    """

    def __init__(self, message: str, reason: str = "bad_input") -> None:
        super().__init__(message)
        self.reason = reason


def reason(error: Exception) -> str:
    """What a library says of damaged data, in one line of at most 200 characters."""
    if isinstance(error, MemoryError):
        return "it claims more than the memory holds"
    return " ".join(str(error).split())[:200] or type(error).__name__
