"""Requirements of the node with their tests and results, and the options of a test run."""

from collections.abc import Callable
from dataclasses import dataclass

from studies.report.requirements import Row, check


@dataclass(frozen=True)
class Requirement:
    """A requirement, how it was tested and what was measured; the texts are for users."""

    requirement: str
    test: str  # with counts
    measured: str
    holds: bool  # of what must hold on any machine, however busy
    within_limits: bool = True  # of time and memory, which a busy machine may exceed

    @property
    def met(self) -> bool:
        """Whether it holds and is within its limits."""
        return self.holds and self.within_limits

    def row(self) -> Row:
        """A JSON-ready row of the page."""
        return check(self.requirement, self.test, self.measured, self.met)


@dataclass(frozen=True)
class Options:
    """Length and seed of a test run, and the receiver of its progress messages."""

    quick: bool = False  # a minute or two for each subject instead of a quarter of an hour
    seed: int = 0
    log: Callable[[str], object] = lambda _: None


def first_of(problems: list[str]) -> str:
    """The first problem as the end of a sentence; empty if there is none."""
    return f"; {problems[0]}" if problems else ""
