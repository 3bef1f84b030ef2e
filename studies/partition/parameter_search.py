"""Search for the value of a parameter that gives a target number of segments."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

from studies.partition.methods import CountParameter

CLOSE = 0.04  # relative difference of counts that ends a search
TOLERANCE = 0.1  # relative difference beyond which the target is not reached
MAX_RUNS = 8  # per target
STRIDE = 4.0  # factor of the value until the target is bracketed
MARGIN = 0.15  # smallest step from either end of a bracket, as a share of it


@dataclass
class Search:
    """Counts of segments at the values tried so far; counts mostly fall as the value rises."""

    parameter: CountParameter
    count: Callable[[float], int]  # runs the method
    known: dict[float, int] = field(default_factory=dict)

    def evaluate(self, value: float) -> int:
        """Return the count at a value; each value is run once."""
        value = self._rounded(value)
        if value not in self.known:
            self.known[value] = self.count(value)
        return self.known[value]

    def seek(self, target: int) -> float:
        """Return the value whose count is nearest to `target`, after at most MAX_RUNS runs."""
        for _ in range(MAX_RUNS):
            value = self._next(target)
            if value is None:
                break
            self.evaluate(value)
        return min(self.known, key=lambda value: (self._miss(value, target), value))

    def _next(self, target: int) -> float | None:
        """The value to try next; None if the target is met or cannot be approached further."""
        values = sorted(self.known)
        if min(self._miss(value, target) for value in values) <= CLOSE:
            return None
        brackets = [
            (low, high)
            for low, high in pairwise(values)
            if self.known[low] > target > self.known[high]
        ]
        if brackets:
            low, high = brackets[-1]
            value = low * (high / low) ** self._part(low, high, target)
        elif self.known[values[-1]] > target:
            value = min(values[-1] * STRIDE, self.parameter.high)
        else:
            value = max(values[0] / STRIDE, self.parameter.low)
        value = self._rounded(value)
        return None if value in self.known else value

    def _part(self, low: float, high: float, target: int) -> float:
        """Position of the target in a bracket if log count is linear in log value, 0 to 1."""
        fall = math.log(self.known[low] / max(self.known[high], 0.5))
        part = math.log(self.known[low] / target) / fall
        return min(max(part, MARGIN), 1.0 - MARGIN)

    def _miss(self, value: float, target: int) -> float:
        return abs(math.log(max(self.known[value], 0.5) / target))

    def _rounded(self, value: float) -> float:
        return float(round(value)) if self.parameter.integer else value


def reached(count: int, target: int) -> bool:
    """Whether a count is near enough to the target."""
    return abs(count - target) <= TOLERANCE * target
