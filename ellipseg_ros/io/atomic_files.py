"""Files that are written whole or not at all, whatever stops the writing."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ellipseg_ros.errors import InputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to, which takes the place of `path` if all goes well and else vanishes.

    Raises InputError if the file can't be written.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise InputError(f"{path} can't be written: {error.strerror or error}", "write") from error
    finally:
        with suppress(OSError):  # where nothing can be, nothing is
            part.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a file of text; InputError if that can't be done."""
    with replacing(path) as part:
        part.write_text(text, encoding="utf-8")
