"""What is promised, how it was tried, and what came of it."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Promise:
    """A row of docs/reliability.md; the texts are for users."""

    promise: str
    tried: str  # how, with counts
    figure: str  # what was measured
    kept: bool


@dataclass(frozen=True)
class Trial:
    """How long and hard to try, and whom to tell of what is being done."""

    quick: bool = False  # a minute or two for each subject, not half an hour
    seed: int = 0
    say: Callable[[str], object] = lambda _: None
