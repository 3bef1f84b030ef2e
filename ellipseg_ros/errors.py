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
