"""Errors of wrong input and settings, and one-line texts for those of other libraries."""

# Optional packages, by the extra of setup.py that installs them.
EXTRAS = {
    "files": ("laspy", "lazrs", "pypcd4", "trimesh"),
    "plots": ("PIL", "matplotlib"),
    "odometry": ("kiss_icp",),
    "dask": ("dask", "distributed"),
}


class EllipsegError(Exception):
    """Base class; the text is one line: what is wrong, and what would be right."""


class ConfigError(EllipsegError):
    """A setting out of range, or of the wrong type."""


class InputError(EllipsegError):
    """Data that cannot be read as points.

    reason: a short key to count it by, as in /diagnostics ("no_xyz", "short_data", ...).
    """

    def __init__(self, message: str, reason: str = "bad_input") -> None:
        super().__init__(message)
        self.reason = reason


def missing_package(error: ModuleNotFoundError) -> str:
    """The package that could not be imported, with the command that installs it."""
    package = (error.name or "").partition(".")[0]
    if package == "rclpy":
        return "needs ROS 2: source its setup.bash, or pip install ros-jazzy-rclpy"
    extra = next((extra for extra, packages in EXTRAS.items() if package in packages), None)
    target = f"'ellipseg_ros[{extra}]'" if extra else package
    return f"needs the package {package}: pip install {target}"


def reason(error: Exception) -> str:
    """The message of a library's error, in one line of at most 200 characters."""
    if isinstance(error, MemoryError):
        return "it claims more than the memory holds"
    return " ".join(str(error).split())[:200] or type(error).__name__
