"""Progress of a study, step by step."""

from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ellipseg_ros.cli.report import print_status, progress_bar


@contextmanager
def progress_steps(total: int, unit: str, args: Namespace) -> Iterator[Callable[[str], None]]:
    """A progress bar; yields a function to call with a description before each step."""
    with progress_bar(total, unit, args) as bar:

        def begin(description: str) -> None:
            bar.set_description(description)
            bar.update()
            if bar.disable:  # no terminal: lines instead of a bar
                print_status(f"{description} ...", args)

        yield begin
