"""Atomic writing: a file is complete or absent, even if writing is interrupted."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ellipseg_ros.errors import InputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` at the end, or is removed after an error.

    Raises InputError if the file can't be written.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        with write_errors(path):
            yield part
            part.replace(path)
    finally:
        with suppress(OSError):  # the folder may not exist
            part.unlink(missing_ok=True)


@contextmanager
def write_errors(path: Path) -> Iterator[None]:
    """Turn an OSError into an InputError, in one line: `path` can't be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path} can't be written: {error.strerror or error}", "write") from error


def write_text(path: Path, text: str) -> None:
    """Write a text file; raises InputError if it can't be written."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")
