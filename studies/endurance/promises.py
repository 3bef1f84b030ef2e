"""What is promised, how it was tried, and what came of it."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Promise:
    """A row of docs/reliability.md; the texts are for users."""

    promise: str
    tried: str  # how, with counts
    figure: str  # what was measured
    holds: bool  # what must be so on any machine, however busy
    in_limits: bool = True  # of time and memory: what else runs on a machine may break them

    @property
    def kept(self) -> bool:
        """All of it."""
        return self.holds and self.in_limits

    def row(self) -> dict[str, str | bool]:
        """JSON-ready."""
        texts = {"promise": self.promise, "tried": self.tried, "figure": self.figure}
        return {**texts, "kept": self.kept}


@dataclass(frozen=True)
class Trial:
    """How long and hard to try, and whom to tell of what is being done."""

    quick: bool = False  # a minute or two for each subject, not a quarter of an hour
    seed: int = 0
    say: Callable[[str], object] = lambda _: None
