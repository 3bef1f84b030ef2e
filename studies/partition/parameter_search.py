"""Finds the setting that gives a wanted number of segments."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

from studies.partition.methods import Dial

CLOSE = 0.04  # relative difference of counts that ends a search
FAR = 0.1  # beyond which the wanted count is not reached
TRIES = 8  # runs for one count
STRIDE = 4.0  # factor of the setting until the wanted count lies between two
EDGE = 0.15  # share of the way between two settings that a step goes at least


@dataclass
class Search:
    """What is known of the counts that a dial gives; counts fall as the value rises, mostly."""

    dial: Dial
    count: Callable[[float], int]  # runs the method
    known: dict[float, int] = field(default_factory=dict)

    def begin(self, value: float) -> int:
        """The count at a value; remembered."""
        value = float(round(value)) if self.dial.whole else value
        if value not in self.known:
            self.known[value] = self.count(value)
        return self.known[value]

    def seek(self, wanted: int) -> float:
        """The value whose count comes nearest to `wanted`, in 8 runs at most."""
        for _ in range(TRIES):
            value = self._next(wanted)
            if value is None:
                break
            self.begin(value)
        return min(self.known, key=lambda value: (self._miss(value, wanted), value))

    def _part(self, low: float, high: float, wanted: int) -> float:
        """How far from low to high to go, if the logarithm of the count falls evenly."""
        fall = math.log(self.known[low] / max(self.known[high], 0.5))
        part = math.log(self.known[low] / wanted) / fall
        return min(max(part, EDGE), 1.0 - EDGE)

    def _miss(self, value: float, wanted: int) -> float:
        return abs(math.log(max(self.known[value], 0.5) / wanted))

    def _next(self, wanted: int) -> float | None:
        """The value to try next; None if there is nothing to gain."""
        values = sorted(self.known)
        if min(self._miss(value, wanted) for value in values) <= CLOSE:
            return None
        between = [
            (low, high)
            for low, high in pairwise(values)
            if self.known[low] > wanted > self.known[high]
        ]
        if between:
            low, high = between[-1]
            value = low * (high / low) ** self._part(low, high, wanted)
        elif self.known[values[-1]] > wanted:
            value = min(values[-1] * STRIDE, self.dial.high)
        else:
            value = max(values[0] / STRIDE, self.dial.low)
        value = float(round(value)) if self.dial.whole else value
        return None if value in self.known else value


def reached(count: int, wanted: int) -> bool:
    """Whether a count is as good as the wanted one."""
    return abs(count - wanted) <= FAR * wanted
